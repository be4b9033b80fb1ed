"""The recording of one trial: markers, plates, events, subject. World frame, SI, NaN where a marker is missing."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from stridelab.conventions import Corners, Mask, Points, Series, Vector3

Sex = Literal["female", "male"]
Side = Literal["left", "right"]
EventKind = Literal["foot_strike", "foot_off"]


@dataclass(frozen=True)
class Remark:
    """Something the reader of a recording should know; ``code`` is stable, ``message`` is a sentence."""

    code: str
    message: str


@dataclass(frozen=True)
class Subject:
    """What is known of the person. ``name`` stays inside the file: the service never echoes it."""

    height_m: float | None = None
    mass_kg: float | None = None
    sex: Sex | None = None
    age_years: float | None = None


@dataclass(frozen=True)
class Event:
    """A gait event stored in the file; ``time_s`` counts from the first frame of this recording."""

    time_s: float
    kind: EventKind
    side: Side | None


@dataclass(frozen=True)
class Plate:
    """A force plate and what it measured.

    ``index`` counts from 1 as labs do. ``force_n`` and ``moment_nm`` (at the world origin) act on the body and have
    the force rate's samples, tare removed. ``use`` and ``threshold_n`` are the switches a user can set.
    """

    index: int
    type: int
    corners_m: Corners
    force_n: Points
    moment_nm: Points
    tare_force_n: Vector3
    use: bool = True
    threshold_n: float = 20.0

    @property
    def loaded(self) -> Mask:
        """Samples at which the plate carries more than its threshold."""
        norm = np.linalg.norm(self.force_n, axis=1)
        return np.asarray(norm > self.threshold_n)


@dataclass(frozen=True)
class PlateSwitches:
    """What a user may set per plate: leave it out of every sum, or move its loading threshold."""

    use: bool | None = None
    threshold_n: float | None = None


@dataclass(frozen=True)
class Window:
    """An interval in which *all* contact force is measured, in seconds of the recording's time axis."""

    start_s: float
    end_s: float

    @property
    def duration_s(self) -> float:
        """From its start to its end."""
        return self.end_s - self.start_s


@dataclass(frozen=True)
class Recording:
    """One trial in the world frame.

    ``markers_m`` maps a label (prefix stripped) to its track at ``marker_rate_hz``. ``plates`` may be empty.
    ``up_axis`` is the axis of the *file* that points up ("+z", "+y", ...); data here are already z up.
    ``walking_direction`` is a horizontal unit vector, or None where nobody walks. ``carried`` holds metadata that a
    simulated recording carries (its own segment table), else it is empty. ``model_points_m`` are positions in the file
    that a gait model computed (joint centres, a CoM): never taken for markers. ``filled`` marks, per label, the frames
    whose position was interpolated over a short gap. ``joint_widths_m`` are calliper widths by "l_knee", "r_ankle" ...
    ``recorded_on`` is the day of the recording as YYYY-MM-DD, empty where the file does not state it.
    """

    markers_m: Mapping[str, Points]
    marker_rate_hz: float
    force_rate_hz: float
    plates: tuple[Plate, ...]
    subject: Subject
    events: tuple[Event, ...]
    up_axis: str
    walking_direction: Vector3 | None
    remarks: tuple[Remark, ...] = ()
    carried: Mapping[str, str] = field(default_factory=dict)
    joint_widths_m: Mapping[str, float] = field(default_factory=dict)
    model_points_m: Mapping[str, Points] = field(default_factory=dict)
    filled: Mapping[str, Mask] = field(default_factory=dict)
    recorded_on: str = ""

    @property
    def n_frames(self) -> int:
        """Samples of every marker; 0 without markers."""
        return 0 if not self.markers_m else len(next(iter(self.markers_m.values())))

    @property
    def time_s(self) -> Series:
        """Instants of the marker frames, from 0."""
        return np.arange(self.n_frames) / self.marker_rate_hz

    @property
    def duration_s(self) -> float:
        """Frames over their rate: the last frame lasts, too."""
        return self.n_frames / self.marker_rate_hz


@dataclass(frozen=True)
class WrenchTrack:
    """Total contact wrench (2.5) at the marker instants, at the world origin.

    ``complete`` marks the samples inside a window, where the sum over the plates is the whole contact wrench;
    elsewhere the numbers must not be used. ``latency_applied_s`` > 0 means that a late force was read that much later.
    ``withheld`` marks samples whose wrench an estimator must not use although all contact is on the plates: they are to
    be predicted. What stands there is a stand-in from the geometry.
    """

    time_s: Series
    force_n: Points
    moment_nm: Points
    complete: Mask
    windows: tuple[Window, ...]
    latency_applied_s: float = 0.0
    withheld: Mask | None = None
