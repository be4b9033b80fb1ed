"""Motion of the CoM, the feet and the segments of a walk in one frame, as input of all measures.

The axes are those of the walk: ahead, left, up. Positions are relative to the floor, which moves on a treadmill; the
height is above the floor.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import Mask, Points, Rotation, Series, Vector3
from stridelab.estimation.differentiation import low_pass, smoothed_derivatives, walk_frame
from stridelab.estimation.estimator import ComEstimate
from stridelab.estimation.evaluation.physics_residuals import MOMENTUM_BAND_HZ, SHORTEST_FLIGHT
from stridelab.estimation.markers_only import GeometryOnly
from stridelab.recordings.foot_contact import Foot, Outline, find_feet, foot_outline
from stridelab.recordings.plate_contacts import loaded_intervals, markers_on_plate, outline_off_plates
from stridelab.recordings.recording import Plate, Recording, Side
from stridelab.walking.gait_events import Contact
from stridelab.walking.steps import GaitStep, footprint_direction

AHEAD, LEFT, UP = 0, 1, 2
MARKER_SD_M: Final = 0.0008
"""Standard deviation of a foot marker at an event: noise of the cameras of 1 mm, interpolated between two frames; the
outline itself is a definition, not a measurement."""
FOOT_SKIN_SD_M: Final = 0.0012
"""Standard deviation per axis of the motion of a foot marker with the skin: at most 1.8 mm at the forefoot, 4.3 mm at
the heel (Tranberg and Karlsson 1998). It repeats with the stride and drops out of its length, not out of a step's."""
FOOT_SKIN_ALIKE: Final = 0.4
"""Share of its variance that the heels of both feet have in common at the same phase of their strides, mirrored, in the
simulated skin: half of what the markers of a foot share, and nothing of the quarter as much that each adds."""
PELVIS_SKIN_SD_M: Final = 0.003
"""The same of the mean of the pelvis markers. Assumed: single ones move by as much relative to each other on people."""
VARYING_SD_M: Final = 0.002
"""Variation of the CoM error within a step, if the estimator does not state it."""
STANDING_SHARE: Final = 0.5
"""Minimum share of a plate's loaded time in which a foot is on it to be the foot that loads it."""
MARKERS_ALONE_SD: Final = (0.004, 0.02)
"""Errors of position (m) and velocity (m/s) per axis of the CoM of the markers alone, without the part that is the same
in a whole walk. With them the sideways margins differ from those of the smoother by less than 1.96 deviations in 97 %
of 31 steps of 21 people (5.7 and 6.7 mm would be enough in the halves of the people, 7.3 mm are stated)."""
OTHER_SIDE: Final[Mapping[Side, Side]] = {"left": "right", "right": "left"}


@dataclass(frozen=True)
class FootMotion:
    """Heel and outline of one foot; the outline is that of ``foot_outline``: heel (2), ball (2), tip of the toes.

    ``force_n`` is the contact force on this foot, NaN where it is not measured separately from the other foot.
    """

    heel_m: Points
    outline_m: Outline
    force_n: Points


@dataclass(frozen=True)
class WalkMotion:
    """Tracks at the instants of the CoM estimate; ``covariance`` is that of position and velocity per axis.

    ``com_m`` and ``velocity_m_s`` have the axes ahead, left, up. ``varying_sd_m`` is the part of the CoM error that
    changes within a step (``MARKERS_ALONE_SD`` by the markers alone). ``momentum_per_kg`` is the angular momentum of
    the segments about the CoM per kilogram of body mass, as point masses, in m^2/s; NaN where a segment is hidden.
    ``frame`` has the axes of the walk as rows, and ``origin_m`` is their origin in the world frame, which moves with
    the belt of a treadmill. ``by_markers``: the CoM is that of the markers alone, whose ``covariance`` is the same
    everywhere. ``height_sd_m`` is the error of the height that is the same in the whole recording, that of the segment
    table.
    """

    time_s: Series
    com_m: Points
    velocity_m_s: Points
    covariance: Float[np.ndarray, "n 3 2 2"] | None
    varying_sd_m: float
    feet: Mapping[Side, FootMotion]
    momentum_per_kg: Points
    mass_kg: float | None
    stature_m: float | None
    frame: Rotation = field(default_factory=lambda: np.eye(3))
    origin_m: Points | Vector3 = field(default_factory=lambda: np.zeros(3))
    by_markers: bool = False
    height_sd_m: float = 0.0

    def in_world(self, track: Points) -> Points:
        """A track of shape (n, 3) in the world frame of the recording."""
        return np.asarray(track @ self.frame + self.origin_m)

    @property
    def mean_height_m(self) -> float:
        """Mean height of the CoM above the floor."""
        return float(self.com_m[:, UP].mean())

    @property
    def mean_speed_m_s(self) -> float:
        """Mean speed of the CoM along the walk."""
        return float(self.velocity_m_s[:, AHEAD].mean())

    def covers(self, start_s: float, end_s: float) -> bool:
        """Whether the estimate covers the interval."""
        slack_s = 1.5 * float(self.time_s[1] - self.time_s[0])
        return bool(self.time_s[0] - slack_s <= start_s and end_s <= self.time_s[-1] + slack_s)

    def samples(self, start_s: float, end_s: float) -> slice:
        """Samples from ``start_s`` to ``end_s``, both included."""
        first, last = np.searchsorted(self.time_s, [start_s - 1e-9, end_s + 1e-9])
        return slice(int(first), int(last))

    def find_sample(self, at_s: float) -> int:
        """The sample nearest to ``at_s``."""
        return int(np.argmin(np.abs(self.time_s - at_s)))

    def interpolate_track(self, track: Points, at_s: float) -> Vector3:
        """Linear interpolation of a track of shape (n, 3)."""
        return np.array([np.interp(at_s, self.time_s, track[:, axis]) for axis in range(3)])


def walk_motion(
    recording: Recording,
    landmarks: Mapping[str, str],
    estimate: ComEstimate,
    geometric: GeometricCom,
    contacts: Sequence[Contact],
    *,
    mass_kg: float | None,
    stature_m: float | None,
    latency_s: float = 0.0,
    feet: Sequence[Foot] | None = None,
) -> WalkMotion | None:
    """Tracks in the frame of the walk, which is that of the footprints; None if the feet are not marked.

    With fewer than three footprints the frame is that of the mean velocity of the CoM.

    ``estimate`` and ``geometric`` are in the world frame and relative to the laboratory; ``contacts`` are
    those of ``find_contacts``. ``feet`` are both by default; the force of the only marked one is not known, since the
    other may stand on the same plate.
    """
    if feet is None:
        feet = find_feet(recording, landmarks)
    if not feet:
        return None
    floor_m_s = geometric.ground_m_s
    velocity = estimate.velocity_m_s - floor_m_s
    footprints = footprint_direction(recording, feet, contacts)
    frame = walk_frame(velocity if footprints is None else footprints[None])
    time_s = estimate.time_s
    first = int(np.argmin(np.abs(recording.time_s - time_s[0])))
    used = slice(first, first + len(time_s))
    moved = floor_m_s * time_s[:, None]
    height_m = floor_height_m(recording, feet)
    origin = np.array([0.0, 0.0, height_m])

    def in_walk(track: Float[np.ndarray, "n ... 3"]) -> Float[np.ndarray, "k ... 3"]:
        shift = moved.reshape(len(time_s), *(1,) * (track.ndim - 2), 3)
        return np.asarray((track[used] - shift - origin) @ frame.T)

    com_m = estimate.com_m
    if estimate.state_covariance is None and len(com_m) > SHORTEST_FLIGHT:
        com_m = low_pass(com_m, recording.marker_rate_hz)  # as the velocity is: energies add up the noise of the height
    by_markers = estimate.method == GeometryOnly.name
    varying_sd_m = estimate.diagnostics.get("table_varying_mm", 1e3 * VARYING_SD_M) / 1e3
    forces = {foot.side: np.full((recording.n_frames, 3), np.nan) for foot in feet}
    if len(feet) > 1:
        forces = forces_by_foot(recording, landmarks, feet, contacts, latency_s)
    return WalkMotion(
        time_s=time_s,
        com_m=(com_m - moved - origin) @ frame.T,
        velocity_m_s=velocity @ frame.T,
        covariance=_horizontal_covariance(estimate, frame),
        varying_sd_m=MARKERS_ALONE_SD[0] if by_markers else varying_sd_m,
        feet={
            foot.side: FootMotion(
                in_walk(foot.markers_m[:, 0]),
                in_walk(foot_outline(recording, landmarks, foot)),
                forces[foot.side][used] @ frame.T,
            )
            for foot in feet
        },
        momentum_per_kg=_momentum_per_kg(geometric, used, frame),
        mass_kg=mass_kg,
        stature_m=stature_m,
        frame=frame,
        origin_m=np.asarray(moved + origin),
        by_markers=by_markers,
        height_sd_m=geometric.sd_m[2],
    )


def _horizontal_covariance(estimate: ComEstimate, frame: Rotation) -> Float[np.ndarray, "n 3 2 2"] | None:
    """Covariance of position and velocity along the rows of ``frame``; None if the estimator states none."""
    if estimate.method == GeometryOnly.name:
        return np.tile(np.diag(np.square(MARKERS_ALONE_SD)), (len(estimate.time_s), 3, 1, 1))
    if estimate.state_covariance is None:
        return None
    turn = frame @ estimate.state_covariance.frame.T  # whose axes are uncorrelated
    return np.asarray(np.einsum("ab,nbij->naij", turn**2, estimate.state_covariance.matrices))


def strides(steps: Sequence[GaitStep]) -> Iterator[tuple[int, GaitStep, GaitStep]]:
    """Strides from strike to strike of one foot: number of the first step, that step, and the next of its side.

    A step that hidden markers leave out between two others of its side makes no stride of them.
    """
    for number, step in enumerate(steps):
        following = next((later for later in steps[number + 1 :] if later.side == step.side), None)
        if following is not None and following.lift_off_s == step.stance_end_s:
            yield number, step, following


def floor_height_m(recording: Recording, feet: Sequence[Foot]) -> float:
    """Height of the floor: of the plates if there are any, else the lowest foot marker."""
    corners = [plate.corners_m[:, 2].mean() for plate in recording.plates if plate.use and plate.corners_m.any()]
    if corners:
        return float(np.median(corners))
    return float(np.nanmin([np.nanpercentile(foot.markers_m[..., 2], 1.0) for foot in feet]))


def forces_by_foot(
    recording: Recording,
    landmarks: Mapping[str, str],
    feet: Sequence[Foot],
    contacts: Sequence[Contact],
    latency_s: float,
) -> dict[Side, Points]:
    """Contact force of each foot at the marker instants: zero in the air, NaN where it is not measured on its own.

    It is measured while the foot stands with its whole outline on plates that carry no other foot.
    """
    time_s = recording.time_s
    forces: dict[Side, Points] = {foot.side: np.zeros((len(time_s), 3)) for foot in feet}
    measured = {foot.side: np.zeros(len(time_s), dtype=bool) for foot in feet}
    off_plates = {
        foot.side: outline_off_plates(
            recording, [p for p in recording.plates if p.use], foot, foot_outline(recording, landmarks, foot)
        )
        for foot in feet
    }
    for plate in recording.plates:
        if plate.use:
            track = _at_markers(plate, recording, latency_s)
            for start_s, end_s in loaded_intervals(plate, recording.force_rate_hz):
                loaded = (time_s >= start_s - latency_s) & (time_s <= end_s - latency_s)
                standing = _standing_feet(recording, plate, feet, loaded)
                for side in standing:
                    forces[side][loaded] += track[loaded] if len(standing) == 1 else np.nan
                    measured[side] |= loaded & ~off_plates[side]
    frame_s = 1.0 / recording.marker_rate_hz
    for contact in contacts:
        stance = (time_s > contact.start_s + frame_s) & (time_s < contact.end_s - frame_s)
        forces[contact.side][stance & ~measured[contact.side]] = np.nan
    return forces


def _at_markers(plate: Plate, recording: Recording, latency_s: float) -> Points:
    read_s = np.arange(len(plate.force_n)) / recording.force_rate_hz - latency_s
    return np.column_stack([np.interp(recording.time_s, read_s, plate.force_n[:, axis]) for axis in range(3)])


def _standing_feet(recording: Recording, plate: Plate, feet: Sequence[Foot], loaded: Mask) -> list[Side]:
    """Feet that are on the plate for most of the time in which they rest during the load."""
    sides = []
    for foot in feet:
        on_plate = (markers_on_plate(recording, plate, foot) & foot.resting).any(axis=1)
        if loaded.any() and np.mean(on_plate[loaded]) > STANDING_SHARE:
            sides.append(foot.side)
    return sides


def _momentum_per_kg(geometric: GeometricCom, used: slice, frame: Rotation) -> Points:
    """Angular momentum of the segments' point masses about the CoM, per kilogram of body mass."""
    time_s = geometric.time_s[used]
    total = np.zeros((len(time_s), 3))
    arms = [segment.com_m[used] for segment in geometric.segments.values()]
    if not arms or len(time_s) < SHORTEST_FLIGHT or not np.isfinite(arms).all():
        return np.full_like(total, np.nan)
    rate_hz = (len(time_s) - 1) / (time_s[-1] - time_s[0])
    for segment in geometric.segments.values():
        arm = segment.com_m[used] - geometric.com_m[used]
        total += segment.mass_fraction * np.cross(arm, smoothed_derivatives(arm, rate_hz, MOMENTUM_BAND_HZ)[0])
    return np.asarray(total @ frame.T)
