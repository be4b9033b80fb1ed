"""Determines the vertical axis of a file, and turns plates that are given in other axes than the markers.

Some exports write the markers z up and the corners of the plates y up. The forces then name another vertical than the
body. Where the file has the landmarks of pelvis and feet, the plates are turned by a quarter about the horizontal axis
that both have in common, and the turn is used only if the centres of pressure then lie at the feet: with n the
vertical, c the centre of a plate's corners, f the force and M_c its moment about c, the centre of pressure is

    p = c + (n x M_c) / (n . f).
"""

import itertools
from dataclasses import replace
from typing import Final

import numpy as np

from stridelab.conventions import Points, Rotation, Series, Vector3
from stridelab.recordings import orientation
from stridelab.recordings.files.raw import Cloud, FilePlate, RawTrial
from stridelab.recordings.force_plates import plate_wrench, rough_normal, rough_total_force, with_true_moment_units
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.recording import Remark

_FEET: Final = ("heel", "toe", "mt1", "mt2", "mt5", "ankle_lateral", "ankle_medial", "ankle_centre")
_LOADED_N: Final = 100.0
_MIN_LOADED: Final = 20
"""Loaded samples below which the centre of pressure decides nothing."""
_AT_FOOT_M: Final = 0.2
"""Largest median distance of the centre of pressure from the nearest foot marker: half a foot and its height."""
_FARTHER: Final = 2.0
"""How much farther the centre of pressure must lie from the feet in the axes of the file, and in those turned back."""


def up_axis_of(raw: RawTrial) -> str:
    """Axis of the file that points up, from its forces, else its body, else the hints of its format."""
    vertical: Vector3 | None
    if raw.contacts:
        vertical = np.sum([contact.force_n.sum(axis=0) for contact in raw.contacts], axis=0)
        centres = [contact.corners_m.mean(axis=0) for contact in raw.contacts]
    else:
        vertical = rough_total_force(raw.plates)
        vertical = rough_normal(raw.plates) if vertical is None else vertical
        centres = [signals.corners_m.mean(axis=0) for signals in raw.plates]
    if vertical is None and not raw.up_is_known and (axis := _axis_of_body(raw)) is not None:
        return axis
    return orientation.find_up_axis(vertical, centres, raw.points_m, raw.up_hint)


def with_common_axes(raw: RawTrial) -> tuple[RawTrial, str, tuple[Remark, ...]]:
    """The trial with its plates in the axes of its markers, the axis that points up, and a remark if they differ.

    The plates are turned only if the body stands along another axis than theirs, and the centres of pressure then lie
    at the feet, where they do not in the axes of the file.
    """
    up = up_axis_of(raw)
    body = _axis_of_body(raw) if raw.plates or raw.contacts else None
    if body is None or body[1] == up[1]:
        return raw, up, ()
    own_m = _pressure_from_feet_m(raw, up)
    turned = [_with_turned_plates(raw, R) for R in _quarter_turns(up[1], body)]
    near_m, far_m = sorted(distances_m := [_pressure_from_feet_m(trial, body) for trial in turned])
    if not near_m <= min(_AT_FOOT_M, own_m / _FARTHER, far_m / _FARTHER):
        message = (
            f"The body extends from feet to pelvis along the {body[1]} axis of the file; the vertical is its {up[1]} "
            "axis, that of the plates. Unless the person lies down, markers and plates have different axes."
        )
        return raw, up, (Remark("plate-axes-differ", message),)
    message = (
        f"The plates have other axes than the markers: their vertical is the {up[1]} axis of the file, the body stands "
        f"along its {body[1]} axis. The plates were turned; the centre of pressure now lies {100.0 * near_m:.0f} cm "
        "from the nearest foot marker (median)."
    )
    return turned[distances_m.index(near_m)], body, (Remark("plate-axes-turned", message),)


def _axis_of_body(raw: RawTrial) -> str | None:
    """Axis along which the pelvis lies above the feet on average, within 20 degrees; None without one.

    It replaces an axis that the file states only if the shoulders lie above the pelvis along it, too: those of a rower
    do not.
    """
    landmarks = identify(raw.labels).landmarks
    column = {label: i for i, label in enumerate(raw.labels)}

    def mean_of_pair(*names: str) -> Points | None:
        pairs = [[landmarks.get(f"{side}_{name}") for side in "lr"] for name in names]
        marked = next((pair for pair in pairs if None not in pair), None)
        return None if marked is None else raw.points_m[:, [column[str(label)] for label in marked]].mean(axis=1)

    feet, pelvis = mean_of_pair("heel", "ankle_lateral", "ankle_centre"), mean_of_pair("asis", "psis", "hip_centre")
    shoulders = mean_of_pair("acromion", "shoulder_centre")
    if feet is None or pelvis is None:
        return None
    parts = [pelvis - feet] + ([] if shoulders is None or raw.up_hint is None else [shoulders - pelvis])
    seen = [part[np.isfinite(part).all(axis=1)] for part in parts]
    axes = {orientation.nearest_axis(part.mean(axis=0)) for part in seen if len(part)}
    return axes.pop() if len(axes) == 1 else None


def _quarter_turns(vertical: str, up: str) -> tuple[Rotation, Rotation]:
    """Both rotations about the common horizontal axis that take ``vertical`` ("x", "y" or "z") to ``up`` or against it.

    They convert a file that is y up into one that is z up. The markers, of other axes, cannot decide between them.
    """
    to, own = orientation.axis_vector(up), orientation.axis_vector("+" + vertical)
    common = np.cross(own, to)
    quarter = np.outer(common, common) + np.outer(to, own) - np.outer(own, to)
    return quarter, quarter.T


def _with_turned_plates(raw: RawTrial, R: Rotation) -> RawTrial:
    """The trial with its plates and contacts turned about the file's origin."""
    contacts = [
        replace(
            contact,
            corners_m=contact.corners_m @ R.T,
            force_n=contact.force_n @ R.T,
            moment_nm=contact.moment_nm @ R.T,
            tare_force_n=R @ contact.tare_force_n,
            tare_moment_nm=R @ contact.tare_moment_nm,
        )
        for contact in raw.contacts
    ]
    plates = [replace(signals, corners_m=signals.corners_m @ R.T) for signals in raw.plates]
    return replace(raw, plates=tuple(plates), contacts=tuple(contacts))


def _pressure_from_feet_m(raw: RawTrial, up: str) -> float:
    """Median distance of the loaded centres of pressure from the nearest foot marker; infinite if that is unknown."""
    n = orientation.axis_vector(up)
    plates: list[FilePlate] = list(raw.contacts)
    signals, _ = with_true_moment_units(raw.plates, n, raw.force_rate_hz)
    plates += [plate_wrench(one, n, raw.force_rate_hz)[0] for one in signals]
    landmarks = identify(raw.labels).landmarks
    names = (landmarks.get(f"{side}_{name}") for side, name in itertools.product("lr", _FEET))
    feet_m = raw.points_m[:, [raw.labels.index(label) for label in names if label is not None]]
    distances_m = np.concatenate([_distances_m(plate, n, feet_m, raw) for plate in plates])
    distances_m = distances_m[np.isfinite(distances_m)]
    return float(np.median(distances_m)) if len(distances_m) >= _MIN_LOADED else float("inf")


def _distances_m(plate: FilePlate, up: Vector3, feet_m: Cloud, raw: RawTrial) -> Series:
    """Distance of the centre of pressure from the nearest visible foot marker at each loaded sample of a plate."""
    loaded = np.flatnonzero(plate.force_n @ up > _LOADED_N)
    frames = np.rint(loaded * raw.marker_rate_hz / raw.force_rate_hz).astype(int)
    loaded, frames = loaded[frames < len(feet_m)], frames[frames < len(feet_m)]
    if not len(loaded) or not feet_m.shape[1]:
        return np.zeros(0)
    centre = plate.corners_m.mean(axis=0)
    force_n = plate.force_n[loaded]
    moment_nm = plate.moment_nm[loaded] - np.cross(centre, force_n)
    pressure_m = centre + np.cross(up, moment_nm) / (force_n @ up)[:, None]
    away_m = np.linalg.norm(feet_m[frames] - pressure_m[:, None], axis=2)
    return np.asarray(np.min(np.where(np.isnan(away_m), np.inf, away_m), axis=1))
