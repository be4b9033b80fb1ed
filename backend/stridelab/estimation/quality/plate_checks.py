"""Checks of single plates: the centre of pressure, and the horizontal force beside the one that the motion needs.

The centre of pressure of a plate must lie under a standing foot and inside the plate's corners.

The horizontal force that the motion of the markers needs follows in two ways. Newton's law needs m c'' of the markers.
The balance of moments about the centre of mass needs no acceleration of it: with a plate's surface at the height h, its
pressure at p and L the angular momentum of the segments about c,

    sum_i (c_z - h_i) f_i,y = L'_x + sum_i (c_y - p_i,y) f_i,z,
    sum_i (c_z - h_i) f_i,x = sum_i (c_x - p_i,x) f_i,z - L'_y.

The right sides hold the vertical force and the centre of pressure, which do not depend on the horizontal channels. A
walking body is a pendulum over its feet: L' is the smaller part, and its error is divided by the height of the centre
of mass. Soft tissue moves c by millimetres, which c'' multiplies by the square of the frequency and the arms c - p do
not.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull, QhullError

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import GRAVITY_M_S2, Mask, Points, Rotation, Series
from stridelab.dynamics.wrench import contact_force
from stridelab.estimation.differentiation import low_pass, smoothed_derivatives, walk_frame
from stridelab.estimation.evaluation.physics_residuals import MOMENTUM_BAND_HZ, segment_momentum_rate
from stridelab.recordings.files.raw import CONTACT_TYPE
from stridelab.recordings.foot_contact import Foot, find_feet
from stridelab.recordings.force_plates import plate_axes
from stridelab.recordings.gap_filling import true_runs
from stridelab.recordings.plate_contacts import low_pass as low_pass_force
from stridelab.recordings.recording import Plate, Recording, WrenchTrack

MIN_TIME_S: Final = 0.4
"""Shortest time, beside the filter's transients, for a regression: five independent samples in the band."""
NO_TRUNK: Final = "trunk-missing"
UNMARKED_SHARE: Final = 0.49
"""Share of head, arms and trunk above the pelvis in the mass of a body."""
"""Remark of a geometric centre of mass whose trunk stands upright on the pelvis, for it is not marked."""
_PARTS_OF_TRUNK: Final = frozenset({NO_TRUNK, "trunk-simplified"})
_STRAIGHT: Final = 0.98
"""Distance over length of way: 0.98 of an arc of 40 degrees; the sway of a straight walk costs less than 0.01."""
_EDGE: Final = 0.6
_WALK_M_S: Final = 0.5
_LOADED_N: Final = 50.0

Horizontal = Float[np.ndarray, "frames 2"]
Forces = Float[np.ndarray, "plates frames 3"]
Tracks = Float[np.ndarray, "plates frames 2"]
Heights = Float[np.ndarray, " plates"]
Levers = Float[np.ndarray, " frames"]
Positions = Float[np.ndarray, "frames 3"]


@dataclass(frozen=True)
class ForceBalance:
    """Needed and measured forces in N along the walk, across it and upwards, over one stretch with all force.

    ``needed_n``, ``banded_n`` and ``levered_n`` are low-passed and without the filter's transients, the rest is whole.
    ``moment_needed_n`` is the horizontal force by the balance of moments, None where a segment is hidden or unknown;
    ``levered_n`` are the plates' horizontal forces that add up to it: f, times the ratio of levers on plates of
    different heights. ``crossed_n`` is the same with the two horizontal channels of each plate exchanged. A trunk
    without a marked neck and front sways unseen against the pelvis (``trunk_is_marked`` is False).
    """

    plates: tuple[Plate, ...]
    rate_hz: float
    weight_n: float
    speed_m_s: float
    position_m: Float[np.ndarray, "whole 3"]
    force_n: Float[np.ndarray, "plates whole 3"]
    needed_n: Positions
    banded_n: Forces
    moment_needed_n: Horizontal | None
    levered_n: Tracks
    crossed_n: Tracks
    trunk_is_marked: bool

    @property
    def is_walk(self) -> bool:
        """Whether the body moves on over the ground, so that the axes are along and across its walk."""
        return self.speed_m_s > _WALK_M_S

    @property
    def is_straight(self) -> bool:
        """Whether the body goes straight on, so that the axes of its walk are the same at all times."""
        steps_m = np.linalg.norm(np.diff(self.position_m[:, :2], axis=0), axis=1)
        way_m = float(np.linalg.norm(self.position_m[-1, :2] - self.position_m[0, :2]))
        return way_m > _STRAIGHT * float(steps_m.sum())

    @property
    def n_free(self) -> float:
        """Independent samples in the band."""
        return 2.0 * MOMENTUM_BAND_HZ * len(self.needed_n) / self.rate_hz


def force_balance(
    recording: Recording, geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float
) -> ForceBalance | None:
    """Forces over the longest stretch with all force and geometry; None if it is too short or no plate is in use."""
    known = wrench.complete & np.isfinite(wrench.force_n).all(axis=1) & np.isfinite(geometric.com_m).all(axis=1)
    plates = tuple(plate for plate in recording.plates if plate.use)
    if not known.any() or not plates:
        return None
    i, j = max(true_runs(known), key=lambda run: run[1] - run[0])
    rate_hz = (len(wrench.time_s) - 1) / (wrench.time_s[-1] - wrench.time_s[0])
    edge = int(np.ceil(_EDGE * rate_hz / MOMENTUM_BAND_HZ))
    if j - i < 2 * edge + MIN_TIME_S * rate_hz:
        return None
    velocity, acceleration = smoothed_derivatives(geometric.com_m[i:j], rate_hz, MOMENTUM_BAND_HZ)
    velocity = velocity - geometric.ground_m_s
    frame, inner = walk_frame(velocity), slice(edge, j - i - edge)
    read_at_s = wrench.time_s[i:j] + wrench.latency_applied_s

    def at_frames(tracks: list[Points]) -> Forces:
        return np.asarray(np.array([_at(read_at_s, track, recording.force_rate_hz) for track in tracks]) @ frame.T)

    def keep_band(track: Points) -> Positions:
        return np.asarray(low_pass(track, rate_hz, MOMENTUM_BAND_HZ)[inner])

    force_n = at_frames([plate.force_n for plate in plates])
    levers_m, moment_n = _moment_side(
        geometric.com_m[i:j] @ frame.T, force_n, at_frames([plate.moment_nm for plate in plates]), _heights_m(plates)
    )
    crossed_n = at_frames([plate.force_n @ _exchange_axes(plate) for plate in plates])
    rate_nm = segment_momentum_rate(geometric, mass_kg)
    needed = None
    if rate_nm is not None and np.isfinite(rate_nm[i:j]).all():
        turning_nm = rate_nm[i:j] @ frame.T
        turning_n = np.cross([0.0, 0.0, 1.0], turning_nm) / levers_m[:, None]
        needed = keep_band(moment_n + turning_n)[:, :2]
    share = _lever_shares(geometric.com_m[i:j, 2], levers_m, _heights_m(plates))
    return ForceBalance(
        plates=plates,
        rate_hz=rate_hz,
        weight_n=mass_kg * GRAVITY_M_S2,
        speed_m_s=float(np.linalg.norm(np.mean(velocity[:, :2], axis=0))),
        position_m=geometric.com_m[i:j] @ frame.T,
        force_n=force_n,
        needed_n=(contact_force(acceleration, mass_kg) @ frame.T)[inner],
        banded_n=np.array([keep_band(track) for track in force_n]),
        moment_needed_n=needed,
        levered_n=np.array([keep_band(track * s[:, None])[:, :2] for track, s in zip(force_n, share, strict=True)]),
        crossed_n=np.array([keep_band(track * s[:, None])[:, :2] for track, s in zip(crossed_n, share, strict=True)]),
        trunk_is_marked=not _PARTS_OF_TRUNK & {remark.code for remark in geometric.remarks},
    )


def _moment_side(com_m: Positions, force_n: Forces, moment_nm: Forces, heights_m: Heights) -> tuple[Levers, Positions]:
    """Lever of the total horizontal force, and that force if the body did not turn (L' = 0); 0 upwards.

    The moment about a point of the surface at the height h is free of the horizontal force that acts there.
    """
    about_x = moment_nm[:, :, 0] + heights_m[:, None] * force_n[:, :, 1]
    about_y = moment_nm[:, :, 1] - heights_m[:, None] * force_n[:, :, 0]
    load_n = force_n[:, :, 2].sum(axis=0)
    carried = np.where(np.abs(load_n) > _LOADED_N, load_n, np.inf)
    lever_m = com_m[:, 2] - (force_n[:, :, 2] * heights_m[:, None]).sum(axis=0) / carried
    needed_nm = np.zeros_like(com_m)
    needed_nm[:, 0] = about_y.sum(axis=0) + com_m[:, 0] * load_n
    needed_nm[:, 1] = com_m[:, 1] * load_n - about_x.sum(axis=0)
    return lever_m, needed_nm / lever_m[:, None]


def _lever_shares(com_height_m: Levers, lever_m: Levers, heights_m: Heights) -> Float[np.ndarray, "plates frames"]:
    return np.asarray((com_height_m[None] - heights_m[:, None]) / lever_m[None])


def _heights_m(plates: Sequence[Plate]) -> Heights:
    """Heights of the surfaces; 0 for a contact without a plate, whose pressure is on the floor."""
    return np.array([0.0 if plate.type == CONTACT_TYPE else float(plate.corners_m[:, 2].mean()) for plate in plates])


def _exchange_axes(plate: Plate) -> Rotation:
    """Matrix that exchanges the two horizontal channels of a plate; it is its own transpose."""
    axes = np.eye(3) if plate.type == CONTACT_TYPE else plate_axes(plate.corners_m)
    return np.asarray(axes @ np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) @ axes.T)


def _at(time_s: Series, track: Float[np.ndarray, "samples 3"], rate_hz: float) -> Points:
    """Low-passed track of a plate at the instants ``time_s``."""
    smooth, track_time_s = low_pass_force(track, rate_hz), np.arange(len(track)) / rate_hz
    return np.column_stack([np.interp(time_s, track_time_s, smooth[:, j]) for j in range(3)])


LOADED_N: Final = 100.0
"""Minimum load for an accurate centre of pressure."""
EDGE_M: Final = 0.02
_PRESSURE_MIN_FRAMES = 5


@dataclass(frozen=True)
class PlatePressure:
    """Centre of pressure of plate ``index`` while it is loaded.

    ``from_feet_m`` is the median horizontal distance from the standing feet's markers, NaN if the feet are not marked;
    ``off_plate`` the share of the time outside the corners, NaN for a contact without a plate.
    """

    index: int
    from_feet_m: float
    off_plate: float


def plate_pressures(
    recording: Recording, landmarks: Mapping[str, str], during: Mask, latency_s: float
) -> tuple[PlatePressure, ...]:
    """Evaluate every plate in use that is loaded in the frames ``during``; the force is read ``latency_s`` later."""
    feet = find_feet(recording, landmarks)
    pressures = []
    for plate in recording.plates:
        if not plate.use:
            continue
        pressure_m, loaded = _pressure_at_frames(recording, plate, latency_s)
        loaded &= during
        if np.count_nonzero(loaded) < _PRESSURE_MIN_FRAMES:
            continue
        apart = np.array([_distance_from_feet(feet, pressure_m[i], int(i)) for i in np.flatnonzero(loaded)])
        from_feet_m = float(np.nanmedian(apart)) if np.isfinite(apart).any() else float("nan")
        pressures.append(PlatePressure(plate.index, from_feet_m, _share_off_plate(plate, pressure_m[loaded])))
    return tuple(pressures)


def _pressure_at_frames(recording: Recording, plate: Plate, latency_s: float) -> tuple[Points, Mask]:
    """Centre of pressure on the plate's surface at the marker instants, and the mask of loaded frames."""
    read_at_s = recording.time_s + latency_s
    force_time_s = np.arange(len(plate.force_n)) / recording.force_rate_hz
    f, nu = (
        np.column_stack([np.interp(read_at_s, force_time_s, track[:, j]) for j in range(3)])
        for track in (
            low_pass_force(plate.force_n, recording.force_rate_hz),
            low_pass_force(plate.moment_nm, recording.force_rate_hz),
        )
    )
    c, n = plate.corners_m.mean(axis=0), plate_axes(plate.corners_m)[:, 2]
    normal_n = f @ n
    loaded = np.abs(normal_n) > LOADED_N
    about_centre = nu - np.cross(c, f)
    p = c + np.cross(n, about_centre) / np.where(loaded, normal_n, np.inf)[:, None]
    return p, np.asarray(loaded)


def _distance_from_feet(feet: Sequence[Foot], pressure_m: Series, frame: int) -> float:
    """Horizontal distance from the convex hull of the markers of all feet in contact; NaN without any."""
    standing = [foot.markers_m[frame, :, :2] for foot in feet if foot.contact[frame]]
    hulls = [points[np.isfinite(points).all(axis=1)] for points in standing]
    hulls = [points for points in hulls if len(points)]
    if not hulls:
        return float("nan")
    return min(_distance_from_polygon(pressure_m[:2], points) for points in (*hulls, np.concatenate(hulls)))


def _distance_from_polygon(point: Series, corners: np.ndarray) -> float:
    """Distance of a point from the convex hull of ``corners`` in the plane."""
    ring = corners
    if len(corners) > 2:
        try:
            hull = ConvexHull(corners)
        except QhullError:
            pass
        else:
            if (hull.equations[:, :2] @ point + hull.equations[:, 2]).max() <= 0.0:
                return 0.0
            ring = corners[hull.vertices]
    a, b = ring, np.roll(ring, -1, axis=0)
    along = b - a
    share = np.clip(((point - a) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-12), 0.0, 1.0)
    return float(np.linalg.norm(a + share[:, None] * along - point, axis=1).min())


def _share_off_plate(plate: Plate, pressure_m: Points) -> float:
    if plate.type == CONTACT_TYPE:
        return float("nan")
    corners = plate.corners_m
    local = (pressure_m - corners.mean(axis=0)) @ plate_axes(corners)
    half_x = 0.5 * np.linalg.norm(corners[0] - corners[1]) + EDGE_M
    half_y = 0.5 * np.linalg.norm(corners[0] - corners[3]) + EDGE_M
    return float(np.mean((np.abs(local[:, 0]) > half_x) | (np.abs(local[:, 1]) > half_y)))


def has_no_trunk(geometric: GeometricCom) -> bool:
    """Whether no marker shows how the trunk leans."""
    return any(remark.code == NO_TRUNK for remark in geometric.remarks)


def unmarked_shares(pelvis_m_s2: Points) -> Float[np.ndarray, "3"]:
    """Variation of the force over the weight, per axis of the walk, that moves an unmarked trunk as the pelvis moves.

    It need not: a trunk that leans and sways on the pelvis may move steadily. Vertically the spine carries it along.
    """
    return np.asarray(UNMARKED_SHARE / GRAVITY_M_S2 * pelvis_m_s2.std(axis=0) * [1.0, 1.0, 0.0])
