"""Checks the stated unit of the plates' moments by the centre of pressure.

In the plate's axes the centre of pressure is (-M_y, M_x) / F_z about the surface. A unit that is 1000 times too large
puts it hundreds of metres beside the plate; one that is 1000 times too small keeps it within a millimetre of the
sensor's axis. The true unit is the largest one under which the centre of pressure lies inside the plate's corners.
Files of several vendors state Nm but contain N mm.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stridelab.conventions import Points, Vector3
from stridelab.recordings.files.metadata import moment_scale
from stridelab.recordings.files.raw import PlateSignals
from stridelab.recordings.force_plates import find_tare, plate_axes, repair_origin, upward_sign
from stridelab.recordings.recording import Remark

AS_STATED, THOUSANDTH, THOUSANDFOLD = 1.0, 1e-3, 1e3
"""Factors on the stated unit: files confuse metres and millimetres."""
REJECTED_BELOW_SHARE: Final = 0.5
"""Share inside the corners below which the stated unit is rejected, if a smaller unit exceeds it."""
ACCEPTED_ABOVE_SHARE: Final = 0.9
"""Share inside the corners above which the larger of two possible units is taken."""
_LOADED_N = 50.0
_MOVES_M = 0.005
"""Median distance of the centre of pressure from its mean below which the unit cannot be determined."""


@dataclass(frozen=True)
class _TaredPlate:
    """Tared signals of one plate, and how many of its samples are loaded."""

    signals: PlateSignals
    force_n: Points
    moment_nm: Points
    n: int

    def share_inside(self, factor: float, up: Vector3) -> float:
        """Share of the loaded centre of pressure inside the corners with the moments times ``factor``."""
        return repair_origin(self.signals, self.force_n, factor * self.moment_nm, up)[1]

    def cop_moves(self, factor: float) -> bool:
        """Whether the centre of pressure moves as under a foot."""
        loaded = np.abs(self.force_n[:, 2]) > _LOADED_N
        force_z = self.force_n[loaded, 2]
        p = factor * self.moment_nm[loaded, :2] / force_z[:, None]
        return float(np.median(np.linalg.norm(p - p.mean(axis=0), axis=1))) > _MOVES_M


def with_true_moment_units(
    plates: Sequence[PlateSignals], up: Vector3
) -> tuple[tuple[PlateSignals, ...], tuple[Remark, ...]]:
    """The plates with moments in Nm, and a remark for each corrected unit.

    Plates with the same stated unit are checked together, so that an unloaded plate gets the unit of the others. If no
    unit puts the centre of pressure on the plates, the stated one is used.
    """
    converted = {signals.index: signals for signals in plates}
    remarks = []
    for unit in dict.fromkeys(signals.moment_unit for signals in plates if signals.moment_unit is not None):
        group = [signals for signals in plates if signals.moment_unit == unit]
        factor, shares = _unit_factor([_tared_plate(signals, up) for signals in group], up)
        if factor == AS_STATED:
            continue
        for signals in group:
            converted[signals.index] = replace(signals, moment_nm=factor * signals.moment_nm)
        remarks.append(Remark("moment-unit-corrected", _correction_message(unit, factor, shares)))
    return tuple(converted.values()), tuple(remarks)


def _unit_factor(group: Sequence[_TaredPlate], up: Vector3) -> tuple[float, dict[float, float]]:
    """Factor on the stated unit, and the share of the loaded centre of pressure on the plates under each factor."""
    loaded = [one for one in group if one.n]
    total = sum(one.n for one in loaded)
    if total == 0:
        return AS_STATED, {}

    def pooled_share(factor: float) -> float:
        return sum(one.n * one.share_inside(factor, up) for one in loaded) / total

    shares = {factor: pooled_share(factor) for factor in (AS_STATED, THOUSANDTH, THOUSANDFOLD)}
    if shares[THOUSANDFOLD] >= ACCEPTED_ABOVE_SHARE and any(one.cop_moves(THOUSANDFOLD) for one in loaded):
        return THOUSANDFOLD, shares
    if shares[AS_STATED] < REJECTED_BELOW_SHARE <= shares[THOUSANDTH] and any(
        one.cop_moves(THOUSANDTH) for one in loaded
    ):
        return THOUSANDTH, shares
    return AS_STATED, shares


def _tared_plate(signals: PlateSignals, up: Vector3) -> _TaredPlate:
    R = plate_axes(signals.corners_m)
    upward_n = upward_sign(signals, up) * (signals.force_n @ (R.T @ up))
    tare = find_tare(signals.force_n, signals.moment_nm, upward_n, signals.zero_samples)
    force_n = signals.force_n - tare.force_n
    n = int(np.count_nonzero(np.abs(force_n[:, 2]) > _LOADED_N))
    return _TaredPlate(signals, force_n, signals.moment_nm - tare.moment_nm, n)


def _correction_message(stated: str, factor: float, shares: dict[float, float]) -> str:
    known = moment_scale(stated, 0.0)
    used = {1.0: "Nm", 1e-3: "N mm"}.get(known * factor, f"{factor:g} times that")
    return (
        f"The file says that the plates' moments are in {stated or 'no unit'}; {used} is used, because then "
        f"{shares[factor]:.0%} of the loaded centre of pressure lies inside the plates' corners, as stated "
        f"{shares[AS_STATED]:.0%}."
    )
