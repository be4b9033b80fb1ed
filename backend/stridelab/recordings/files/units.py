"""Units of length and moment in files, and a plausibility check of the stated unit of length.

``moment_units`` checks the stated unit of moment.
"""

from typing import Final

import numpy as np

from stridelab.recordings.files.raw import Cloud
from stridelab.recordings.recording import Remark

LENGTH_SCALE: Final = {
    "mm": 1e-3,
    "millimeters": 1e-3,
    "millimetres": 1e-3,
    "cm": 1e-2,
    "centimeters": 1e-2,
    "centimetres": 1e-2,
    "m": 1.0,
    "meters": 1.0,
    "metres": 1.0,
    "dm": 0.1,
    "in": 0.0254,
}
MOMENT_SCALE: Final = {"nmm": 1e-3, "nm": 1.0, "ncm": 1e-2, "nmeter": 1.0, "newtonmm": 1e-3}
_BODY_M = (0.3, 3.0)


def length_scale(stated: str, cloud: Cloud) -> tuple[float, tuple[Remark, ...]]:
    """Factor to metres, and a remark if the stated unit is implausible.

    A marker set spans 0.3 to 3 m of the body. If it does not in the stated unit (mm if none is stated) but does in
    another, the other one is used.
    """
    unit = stated.strip().lower()
    scale = LENGTH_SCALE.get(unit, 1e-3)
    extent = _body_extent(cloud)
    if np.isnan(extent) or cloud.shape[1] < 4 or _BODY_M[0] <= extent * scale <= _BODY_M[1]:
        return scale, ()
    other = unit_of_body(cloud)
    if other is not None:
        message = f"The file says its lengths are in {stated or 'no unit'}, but the markers span a body in {other}."
        return LENGTH_SCALE[other], (Remark("unit-corrected", message),)
    return scale, (Remark("unit-implausible", "The markers span no human body in any unit of length."),)


def unit_of_body(cloud: Cloud) -> str | None:
    """Unit among mm, m and cm in which the markers span 0.3 to 3 m; None if there is none, or fewer than 4 markers.

    The three ranges do not overlap.
    """
    extent = _body_extent(cloud)
    fits = [unit for unit in ("mm", "m", "cm") if _BODY_M[0] <= extent * LENGTH_SCALE[unit] <= _BODY_M[1]]
    return fits[0] if fits else None


def moment_scale(stated: str, metres_per_unit: float) -> float:
    """Factor to Nm from the stated unit of moment; if it is unknown, newtons times the file's unit of length."""
    return MOMENT_SCALE.get(stated.lower().replace(".", "").replace("*", "").replace(" ", ""), metres_per_unit)


def _body_extent(cloud: Cloud) -> float:
    """Median over the frames of the longest side of the marker cloud; NaN without frames with at least 4 markers."""
    seen = (~np.isnan(cloud[:, :, 0])).sum(axis=1) >= 4
    if not seen.any():
        return float("nan")
    frames = cloud[seen]
    return float(np.median((np.nanmax(frames, axis=1) - np.nanmin(frames, axis=1)).max(axis=1)))
