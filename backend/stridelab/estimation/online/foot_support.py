"""Feet on the ground frame by frame: contact from the speed of the foot markers and from the plates, and the base.

A marker of a standing foot is slow. As in ``recordings.foot_contact``, a foot lands when its slowest marker falls below
0.4 of the walking speed and lifts off above 1.3 of it; here the speed is a difference to the frame 30 ms before. The
load of a plate under this foot alone decides instead. The base of support is the outline of the standing feet.

The plates measure all contact force if every standing foot rests on them with all its resting parts.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from stridelab.conventions import Corners, Points, Vector3
from stridelab.recordings.foot_contact import (
    FOOT_LANDMARKS,
    LANDING_SPEED_SHARE,
    LIFT_OFF_SPEED_SHARE,
    SIDES,
    Foot,
    foot_outline,
)
from stridelab.recordings.recording import Recording, Side

MIN_SPEED_M_S: Final = 0.3
"""Walking speed below which the limits of contact no longer fall."""
SPEED_SPAN_S: Final = 0.03
LOADED_N: Final = 20.0
HELD_S: Final = 0.5
"""Longest time for which a standing foot with hidden markers is taken to stand where it was."""
LARGEST_FORCE_N: Final = 50_000.0


class PlateReading(NamedTuple):
    """Force on the body and its moment about the origin, of one plate at one frame."""

    force_n: Vector3
    moment_nm: Vector3


@dataclass(frozen=True)
class TotalWrench:
    """Total contact wrench of a frame; ``reading`` is None where it is not measured, ``reason`` then says why."""

    reading: PlateReading | None
    reason: str | None = None


@dataclass
class FootState:
    """One foot: whether it stands (None if its markers are hidden) and its outline on the floor (5 x 3)."""

    side: Side
    names: tuple[str, ...]
    is_down: bool = True
    contact: bool | None = None
    outline_m: Float[np.ndarray, "5 3"] | None = None
    resting: Bool[np.ndarray, "5"] = field(default_factory=lambda: np.ones(5, dtype=bool))
    seen_s: float = -np.inf
    recent: deque[tuple[float, Points]] = field(default_factory=deque)


class FootSupport:
    """Contact and outline of both feet, frame by frame.

    ``landmarks`` maps a landmark to its label; a foot needs a heel (or ankle) and a forefoot landmark.
    """

    def __init__(self, landmarks: Mapping[str, str], plates_m: Sequence[Corners] = ()) -> None:
        self._landmarks = landmarks
        self._plates = [_PlateArea(corners) for corners in plates_m]
        self.feet: dict[Side, FootState] = {}
        for side, prefix in SIDES:
            rear = next((prefix + n for n in ("heel", "ankle_lateral") if prefix + n in landmarks), None)
            fore = tuple(prefix + n for n in FOOT_LANDMARKS[1:] if prefix + n in landmarks)
            if rear is not None and fore:
                self.feet[side] = FootState(side, (rear, *fore))

    def update_feet(
        self,
        time_s: float,
        window: Recording,
        walking_m_s: float,
        ground_m_s: Vector3,
        readings: Sequence[PlateReading | None],
    ) -> None:
        """Contact and outline at the last frame of ``window``, against a ground that moves with ``ground_m_s``."""
        reference = max(walking_m_s, MIN_SPEED_M_S)
        for foot in self.feet.values():
            markers = np.stack([window.markers_m[self._landmarks[name]] for name in foot.names], axis=1)
            self._update_outline(foot, time_s, window, markers)
            speeds = _marker_speeds(foot.recent, time_s, markers[-1], ground_m_s)
            if np.isfinite(speeds).any():
                slowest = float(np.nanmin(speeds))
                limit = LIFT_OFF_SPEED_SHARE if foot.is_down else LANDING_SPEED_SHARE
                foot.is_down = slowest <= limit * reference
                slow = np.nan_to_num(speeds, nan=np.inf) < LIFT_OFF_SPEED_SHARE * reference
                foot.resting = np.array([slow[0], slow[0], *[slow[1:].any()] * 3])
            foot.contact = foot.is_down if foot.outline_m is not None else None
        self._apply_loads(readings)

    def _update_outline(self, foot: FootState, time_s: float, window: Recording, markers: np.ndarray) -> None:
        shape = markers.shape[:2]
        nothing = np.zeros(shape, dtype=bool)
        posed = Foot(foot.side, markers, nothing, nothing[:, 0], nothing[:, 0])
        outline = foot_outline(window, self._landmarks, posed)[-1]
        if np.isfinite(outline).all():
            foot.outline_m, foot.seen_s = outline, time_s
        elif not foot.is_down or time_s - foot.seen_s > HELD_S:
            foot.outline_m = None

    def _apply_loads(self, readings: Sequence[PlateReading | None]) -> None:
        """A plate under one foot alone decides on its contact."""
        for plate, reading in zip(self._plates, readings, strict=False):
            above = [
                foot for foot in self.feet.values() if foot.outline_m is not None and plate.touches(foot.outline_m)
            ]
            if reading is None or len(above) != 1 or not plate.covers(above[0].outline_m).all():
                continue
            above[0].is_down = bool(abs(reading.force_n[2]) > LOADED_N)
            above[0].contact = above[0].is_down

    def total_wrench(self, readings: Sequence[PlateReading | None]) -> TotalWrench:
        """Sum over the plates if they carry all contact, else the reason why the total force is not measured."""
        if not self._plates:
            return TotalWrench(None, "no-plates")
        standing = [foot for foot in self.feet.values() if foot.contact]
        if len(self.feet) < len(SIDES):
            return TotalWrench(None, "feet-not-marked")
        if any(foot.contact is None for foot in self.feet.values()):
            return TotalWrench(None, "feet-hidden")
        if not standing:
            return TotalWrench(None, "no-contact")
        known = [reading for reading in readings if reading is not None]
        for foot in standing:
            under: Bool[np.ndarray, "plates 5"] = np.array([plate.covers(foot.outline_m) for plate in self._plates])
            if not under[:, foot.resting].any(axis=0).all():
                return TotalWrench(None, "foot-beside-plates")
            if any(readings[k] is None for k in range(len(self._plates)) if under[k].any()):
                return TotalWrench(None, "plate-late")
        force = np.sum([reading.force_n for reading in known], axis=0)
        moment = np.sum([reading.moment_nm for reading in known], axis=0)
        if not np.abs(np.concatenate([force, moment])).max() < LARGEST_FORCE_N:
            return TotalWrench(None, "force-not-finite")
        if force[2] < -LOADED_N:
            return TotalWrench(None, "force-points-down")
        return TotalWrench(PlateReading(force, moment))


class _PlateArea:
    """A plate seen from above."""

    def __init__(self, corners_m: Corners) -> None:
        flat = corners_m[:, :2]
        self._centre = flat.mean(axis=0)
        edges = np.array([flat[0] - flat[1], flat[0] - flat[3]])
        self._half = np.linalg.norm(edges, axis=1) / 2.0
        self._axes = edges / np.maximum(2.0 * self._half[:, None], 1e-9)

    def covers(self, points_m: Float[np.ndarray, "n 3"] | None) -> Bool[np.ndarray, "n"]:
        """Whether each point is above the plate."""
        if points_m is None:
            return np.zeros(5, dtype=bool)
        return np.asarray((np.abs((points_m[:, :2] - self._centre) @ self._axes.T) <= self._half).all(axis=1))

    def touches(self, outline_m: Float[np.ndarray, "5 3"]) -> bool:
        """Whether any part of the outline, or its middle, is above the plate."""
        return bool(self.covers(np.vstack([outline_m, outline_m.mean(axis=0)])).any())


def _marker_speeds(
    recent: deque[tuple[float, Points]], time_s: float, markers: Points, ground_m_s: Vector3
) -> Float[np.ndarray, "markers"]:
    """Speed of each marker against the ground since about ``SPEED_SPAN_S`` before; NaN where it is not known."""
    while len(recent) > 1 and time_s - recent[1][0] >= SPEED_SPAN_S - 1e-6:
        recent.popleft()
    then = recent[0] if recent else None
    recent.append((time_s, markers))
    if then is None or time_s <= then[0]:
        return np.full(len(markers), np.nan)
    return np.asarray(np.linalg.norm((markers - then[1]) / (time_s - then[0]) - ground_m_s, axis=1))
