"""Computes the wrench on the body at the file's origin from the channels of a force plate (types 1 to 4).

In the plate's axes the channels give F and the moment about the sensor M_s. With o the vector from the sensor to the
centre of the surface and R the plate's axes, taken from its corners,

    M_c = M_s - o x F,    f = s R F,    nu = s R M_c + c x f,

c the centre of the corners and s = +1, or -1 if the channels must be reversed for the plate to push the body upwards.
The offset of the unloaded plate (tare) is subtracted first.

Checks the stated unit of the plates' moments by the centre of pressure.

In the plate's axes the centre of pressure is (-M_y, M_x) / F_z about the surface. A unit that is 1000 times too large
puts it hundreds of metres beside the plate; one that is 1000 times too small keeps it within a millimetre of the
sensor's axis. The true unit is the largest one under which the centre of pressure lies inside the plate's corners.
Files of several vendors state Nm but contain N mm.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Corners, Mask, Points, Rotation, Series, Vector3
from stridelab.recordings.clipped_force import clipped_intervals_s
from stridelab.recordings.files.metadata import moment_scale
from stridelab.recordings.files.raw import Channels, FilePlate, PlateSignals
from stridelab.recordings.gap_filling import true_runs
from stridelab.recordings.recording import Recording, Remark

CHANNELS = {1: 6, 2: 6, 3: 8, 4: 6}
"""Analog channels per plate type."""
LOADED_N = 50.0
_PULL_N = 100.0
MIN_ON_PLATE_SHARE = 0.01
"""A plate is excluded if a smaller share of its loaded centre of pressure lies inside its corners."""
_MIN_LOADED = 20
"""Minimum number of loaded samples for a meaningful share."""
COP_NEVER_ON_PLATE = "cop-never-on-plate"
_MIN_SIDE_M, _MAX_SIDE_M = 0.1, 10.0

Calibration = Float[np.ndarray, "6 6"]


def sensor_wrench(
    kind: int,
    channels: Channels,
    origin_m: Vector3,
    calibration: Calibration | None,
    moment_scale: float,
    length_scale: float,
) -> tuple[Points, Points, Vector3]:
    """Force in N, moment about the sensor in Nm, and the vector from the sensor to the surface centre in metres.

    Channels per type, in the plate's axes: 1: Fx Fy Fz Px Py Mz (centre of pressure and free moment); 2: Fx Fy Fz Mx
    My Mz; 3: Fx12 Fx34 Fy14 Fy23 Fz1 Fz2 Fz3 Fz4 (Kistler, sensors at (+-a, +-b)); 4: type 2 behind a calibration
    matrix. ``moment_scale`` and ``length_scale`` convert the file's moments and lengths to Nm and m.
    """
    if kind == 4 and calibration is not None:
        channels = channels @ calibration.T
    if kind in (2, 4):
        return channels[:, :3], channels[:, 3:6] * moment_scale, origin_m
    if kind == 1:
        force = channels[:, :3]
        cop_m = np.column_stack([channels[:, 3:5] * length_scale, np.zeros(len(channels))])
        free = np.column_stack([np.zeros((len(channels), 2)), channels[:, 5] * moment_scale])
        return force, np.cross(cop_m, force) + free, np.zeros(3)
    x12, x34, y14, y23, z1, z2, z3, z4 = channels.T
    a, b = abs(origin_m[0]), abs(origin_m[1])
    force = np.column_stack([x12 + x34, y14 + y23, z1 + z2 + z3 + z4])
    moment = np.column_stack([b * (z1 + z2 - z3 - z4), a * (-z1 + z2 + z3 - z4), b * (-x12 + x34) + a * (y14 - y23)])
    return force, moment, np.array([0.0, 0.0, origin_m[2]])


def plate_axes(corners_m: Corners) -> Rotation:
    """Plate axes as columns, from corners in the order of its quadrants (+x+y, -x+y, -x-y, +x-y)."""
    c1, c2, c3, c4 = corners_m
    x = (c1 + c4) - (c2 + c3)
    y = (c1 + c2) - (c3 + c4)
    x /= np.linalg.norm(x)
    y = y - (y @ x) * x
    y /= np.linalg.norm(y)
    return np.column_stack([x, y, np.cross(x, y)])


def corners_fault(corners_m: Corners) -> str | None:
    """Reason why the corners are invalid, or None for four finite points, sides of 0.1 to 10 m, nearly a rectangle."""
    if not np.isfinite(corners_m).all():
        return "its corners are not numbers"
    sides = np.linalg.norm(np.roll(corners_m, -1, axis=0) - corners_m, axis=1)
    if sides.min() < _MIN_SIDE_M or sides.max() > _MAX_SIDE_M:
        return f"its sides are {sides.min():.3g} to {sides.max():.3g} m long"
    if np.linalg.norm(corners_m[0] - corners_m[1] + corners_m[2] - corners_m[3]) > 0.1 * sides.max():
        return "its corners do not form a rectangle"
    return None


def inside_fraction(force_n: Points, moment_nm: Points, origin_m: Vector3, corners_m: Corners) -> float:
    """Share of the loaded samples whose centre of pressure lies on the plate (2 cm tolerance); NaN when unloaded."""
    loaded = np.abs(force_n[:, 2]) > LOADED_N
    F, M = force_n[loaded], moment_nm[loaded] - np.cross(origin_m, force_n[loaded])
    if len(F) == 0:
        return float("nan")
    half_x = 0.5 * np.linalg.norm(corners_m[0] - corners_m[1]) + 0.02
    half_y = 0.5 * np.linalg.norm(corners_m[0] - corners_m[3]) + 0.02
    px, py = -M[:, 1] / F[:, 2], M[:, 0] / F[:, 2]
    return float(np.mean((np.abs(px) <= half_x) & (np.abs(py) <= half_y)))


def repair_origin(
    signals: PlateSignals, force_n: Points, moment_nm: Points, up: Vector3
) -> tuple[Vector3, float, bool]:
    """Correct the sign of ORIGIN; returns the origin, the share of the loaded COP on the plate, whether x, y changed.

    The surface lies above the sensor, which fixes the sign of z; if z has the wrong sign, the whole vector is negated
    (Vicon writes the vector from the surface to the sensor). Of both signs of x and y, the one that puts the loaded COP
    inside the plate's corners is used; the file's sign is preferred in a tie.
    """
    o = signals.origin_m
    rises = float((plate_axes(signals.corners_m) @ np.array([0.0, 0.0, o[2]])) @ up)
    own = -o if rises < 0.0 else o
    other = own * [-1.0, -1.0, 1.0]
    shares = [inside_fraction(force_n, moment_nm, origin, signals.corners_m) for origin in (own, other)]
    if shares[1] > shares[0] + 0.1:
        return other, shares[1], True
    return own, shares[0], False


def plate_wrench(signals: PlateSignals, up: Vector3, rate_hz: float) -> tuple[FilePlate, tuple[Remark, ...]]:
    """Tare and repair one plate, and compute the wrench on the body about the file's origin, in the file's axes."""
    where = f"Plate {signals.index}"
    remarks: list[Remark] = []
    R = plate_axes(signals.corners_m)
    s = upward_sign(signals, up)
    if s < 0.0:
        remarks.append(
            Remark("plate-sign-reversed", f"{where}: its channels pull the body down; their sign was reversed.")
        )
    upward_n: Series = s * (signals.force_n @ (R.T @ up))
    tare = find_tare(signals.force_n, signals.moment_nm, upward_n, signals.zero_samples, rate_hz)
    force_n, moment_nm = signals.force_n - tare.force_n, signals.moment_nm - tare.moment_nm
    if tare.never_unloaded:
        remarks.append(
            Remark("tare-refused", f"{where} is never unloaded for long enough, so its zero could not be checked.")
        )
    elif abs(s * (R @ tare.force_n) @ up) > 2.0:
        offset_n = float(s * (R @ tare.force_n) @ up)
        remarks.append(Remark("plate-tared", f"{where} read {offset_n:+.1f} N while unloaded; this was subtracted."))
    origin_m, share, negated = repair_origin(signals, force_n, moment_nm, up)
    if negated:
        remarks.append(
            Remark(
                "plate-origin-negated", f"{where}: its ORIGIN has the opposite sign; the centre of pressure decided."
            )
        )
    loaded = np.abs(force_n[:, 2]) > LOADED_N
    n_loaded = int(np.count_nonzero(loaded))
    usable = not (share < MIN_ON_PLATE_SHARE and n_loaded >= _MIN_LOADED)
    if not usable:
        message = (
            f"{where} was left out: its loaded centre of pressure lies inside its corners for {share:.0%} of the time, "
            "whatever the unit of its moments. Its corners, its channels or its calibration are wrong."
        )
        remarks.append(Remark(COP_NEVER_ON_PLATE, message))
    elif share < 0.5:
        remarks.append(
            Remark(
                "cop-off-plate", f"{where}: only {share:.0%} of its loaded centre of pressure lies inside its corners."
            )
        )
    c = signals.corners_m.mean(axis=0)

    def at_origin(force_n: Points, moment_nm: Points) -> tuple[Points, Points]:
        f = s * force_n @ R.T
        return f, s * (moment_nm - np.cross(origin_m, force_n)) @ R.T + np.cross(c, f)

    f, nu = at_origin(force_n, moment_nm)
    (zero_n,), (zero_nm,) = at_origin(tare.force_n[None], tare.moment_nm[None])
    plate = FilePlate(signals.index, signals.type, signals.corners_m, f, nu, zero_n, usable, zero_nm)
    clipped_s = clipped_intervals_s(signals.channels, loaded, rate_hz, signals.ranges)
    return replace(plate, zero_is_known=not tare.never_unloaded, clipped_s=clipped_s), tuple(remarks)


def with_session_zeros(recording: Recording, zeros: Mapping[int, Sequence[float]]) -> Recording:
    """Subtract what plates that are never unloaded in ``recording`` read unloaded in other trials of its session.

    ``zeros`` has force (N) and moment (Nm) about the world origin by the index of the plate.
    """
    plates, remarks = [], list(recording.remarks)
    for plate in recording.plates:
        if plate.index not in zeros or plate.zero_is_known:
            plates.append(plate)
            continue
        zero = np.asarray(zeros[plate.index], dtype=np.float64)
        plates.append(
            replace(
                plate,
                force_n=plate.force_n - zero[:3],
                moment_nm=plate.moment_nm - zero[3:],
                tare_force_n=zero[:3],
                tare_moment_nm=zero[3:],
                zero_is_known=True,
            )
        )
        message = (
            f"Plate {plate.index} reads {zero[2]:+.1f} N unloaded in other trials of the session; this is its zero."
        )
        remarks.append(Remark("tare-from-session", message))
    return replace(recording, plates=tuple(plates), remarks=tuple(remarks))


def upward_sign(signals: PlateSignals, up: Vector3) -> float:
    """+1 if the channels push the body upwards (the convention of ezc3d), -1 if they pull it down.

    Only a lasting pull counts (2 % of the samples beyond 100 N) that is not an offset: if the file names the samples at
    which the plate was empty, the pull must remain after subtracting them.
    """
    upward = signals.force_n @ (plate_axes(signals.corners_m).T @ up)
    readings = [upward]
    if signals.zero_samples is not None and 1 <= signals.zero_samples[0] < signals.zero_samples[1] <= len(upward):
        readings.append(upward - upward[signals.zero_samples[0] - 1 : signals.zero_samples[1]].mean())
    pulls = [float(np.mean(u < -_PULL_N)) >= 0.02 and np.mean(u < -_PULL_N) > np.mean(u > _PULL_N) for u in readings]
    return -1.0 if all(pulls) else 1.0


def rough_total_force(plates: tuple[PlateSignals, ...]) -> Vector3 | None:
    """Sum over the loaded samples in the file's axes; None unless a plate is loaded (in 2 % of the samples)."""
    total = np.zeros(3)
    for signals in plates:
        force = signals.force_n @ plate_axes(signals.corners_m).T
        loaded = np.linalg.norm(force, axis=1) > _PULL_N
        if loaded.mean() >= 0.02:
            total += force[loaded].sum(axis=0)
    return total if total.any() else None


def rough_normal(plates: tuple[PlateSignals, ...]) -> Vector3 | None:
    """Normal of the first plate, of either sign: the vertical axis of a file with unloaded plates."""
    return plate_axes(plates[0].corners_m)[:, 2] if plates else None


MAX_TARE_N = 60.0
"""A steady upward reading above this is a standing subject, unless the file marks these samples as unloaded."""
_BAND_N = 6.0
_LOAD_N = 100.0
_MIN_STRETCH, _MIN_STRETCH_S = 40, 0.04
_SMOOTH, _SMOOTH_S = 21, 0.02
"""Samples, and seconds at rates of which fewer samples last as long: the flight of a run lasts 0.06 s and more."""


@dataclass(frozen=True)
class Tare:
    """Offset in the plate's axes (moment about the sensor); ``never_unloaded`` if the plate is never unloaded."""

    force_n: Vector3
    moment_nm: Vector3
    never_unloaded: bool


def find_tare(
    force_n: Points, moment_nm: Points, upward_n: Series, zero_samples: tuple[int, int] | None, rate_hz: float
) -> Tare:
    """Median of the unloaded samples: those of FORCE_PLATFORM:ZERO if they are unloaded, else detected ones.

    ``upward_n`` is the plate's upward force. A load only adds to it, so the unloaded level is its lowest steady level
    (5th percentile of the smoothed signal); stretches of at least 40 samples, or 40 ms, within 6 N of it count as
    unloaded.
    """
    if not upward_n.any():
        return Tare(np.zeros(3), np.zeros(3), never_unloaded=False)
    n = min(_SMOOTH, max(round(_SMOOTH_S * rate_hz), 1), len(upward_n))
    smooth = np.convolve(np.pad(upward_n, (n // 2, (n - 1) // 2), "symmetric"), np.full(n, 1.0 / n), "valid")
    floor_n = float(np.percentile(smooth, 5.0))
    named = _named_unloaded(smooth, floor_n, zero_samples)
    if named is not None:
        unloaded = named
    else:
        if not abs(floor_n) <= MAX_TARE_N:
            return Tare(np.zeros(3), np.zeros(3), never_unloaded=True)
        unloaded = np.zeros(len(smooth), dtype=bool)
        for i, j in true_runs(np.abs(smooth - floor_n) <= _BAND_N):
            if j - i >= min(_MIN_STRETCH, max(_MIN_STRETCH_S * rate_hz, 4)):
                unloaded[i:j] = True
    if not unloaded.any():
        return Tare(np.zeros(3), np.zeros(3), never_unloaded=True)
    return Tare(np.median(force_n[unloaded], axis=0), np.median(moment_nm[unloaded], axis=0), never_unloaded=False)


def _named_unloaded(smooth: Series, floor_n: float, zero_samples: tuple[int, int] | None) -> Mask | None:
    """Mask of the samples that FORCE_PLATFORM:ZERO names, if they are at the lowest level of the signal, else None.

    Above ``MAX_TARE_N`` they are accepted only if a load is added later; otherwise a subject stands on the plate
    throughout.
    """
    if zero_samples is None:
        return None
    first, last = zero_samples
    if not 1 <= first < last <= len(smooth):
        return None
    level_n = float(np.mean(smooth[first - 1 : last]))
    if level_n > floor_n + 2.0 * _BAND_N:
        return None
    if level_n > MAX_TARE_N and float(np.percentile(smooth, 98.0)) < level_n + _LOAD_N:
        return None
    mask = np.zeros(len(smooth), dtype=bool)
    mask[first - 1 : last] = True
    return mask


AS_STATED, THOUSANDTH, THOUSANDFOLD = 1.0, 1e-3, 1e3
"""Factors on the stated unit: files confuse metres and millimetres."""
REJECTED_BELOW_SHARE: Final = 0.5
"""Share inside the corners below which the stated unit is rejected, if a smaller unit exceeds it."""
ACCEPTED_ABOVE_SHARE: Final = 0.9
"""Share inside the corners above which the larger of two possible units is taken."""
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
        loaded = np.abs(self.force_n[:, 2]) > LOADED_N
        force_z = self.force_n[loaded, 2]
        p = factor * self.moment_nm[loaded, :2] / force_z[:, None]
        return float(np.median(np.linalg.norm(p - p.mean(axis=0), axis=1))) > _MOVES_M


def with_true_moment_units(
    plates: Sequence[PlateSignals], up: Vector3, rate_hz: float
) -> tuple[tuple[PlateSignals, ...], tuple[Remark, ...]]:
    """The plates with moments in Nm, and a remark for each corrected unit.

    Plates with the same stated unit are checked together, so that an unloaded plate gets the unit of the others. If no
    unit puts the centre of pressure on the plates, the stated one is used.
    """
    converted = {signals.index: signals for signals in plates}
    remarks = []
    for unit in dict.fromkeys(signals.moment_unit for signals in plates if signals.moment_unit is not None):
        group = [signals for signals in plates if signals.moment_unit == unit]
        factor, shares = _unit_factor([_tared_plate(signals, up, rate_hz) for signals in group], up)
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


def _tared_plate(signals: PlateSignals, up: Vector3, rate_hz: float) -> _TaredPlate:
    R = plate_axes(signals.corners_m)
    upward_n = upward_sign(signals, up) * (signals.force_n @ (R.T @ up))
    tare = find_tare(signals.force_n, signals.moment_nm, upward_n, signals.zero_samples, rate_hz)
    force_n = signals.force_n - tare.force_n
    n = int(np.count_nonzero(np.abs(force_n[:, 2]) > LOADED_N))
    return _TaredPlate(signals, force_n, signals.moment_nm - tare.moment_nm, n)


def _correction_message(stated: str, factor: float, shares: dict[float, float]) -> str:
    known = moment_scale(stated, 0.0)
    used = {1.0: "Nm", 1e-3: "N mm"}.get(known * factor, f"{factor:g} times that")
    return (
        f"The file says that the plates' moments are in {stated or 'no unit'}; {used} is used, because then "
        f"{shares[factor]:.0%} of the loaded centre of pressure lies inside the plates' corners, as stated "
        f"{shares[AS_STATED]:.0%}."
    )
