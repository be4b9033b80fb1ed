"""The recording of one trial: markers, plates, events, subject. World frame, SI, NaN where a marker is missing."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from stridelab.conventions import Corners, Mask, Points, Series, Vector3
from stridelab.recordings.remark import Remark as Remark

Sex = Literal["female", "male"]
Side = Literal["left", "right"]
EventKind = Literal["foot_strike", "foot_off"]


@dataclass(frozen=True)
class Subject:
    """Known properties of the subject, None if unknown. The name in the file is never read."""

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
    """A force plate and its measured wrench.

    ``index`` counts from 1 as labs do. ``force_n`` and ``moment_nm`` (at the world origin) act on the body and have
    the force rate's samples, tare removed. ``use``, ``threshold_n`` and ``belt_speed_m_s`` are the switches a user can
    set; the last is the speed of the treadmill belt on the plate, None if it is not stated. ``tare_moment_nm`` (at the
    world origin) was removed with ``tare_force_n``; ``zero_is_known`` if the plate was seen unloaded, in this trial or
    in another one of its session. ``moment_offset_m`` is the switch of that name; the moments have it already.
    ``clipped_s`` are the times, from first to last sample, at which the plate is overloaded and its force is wrong.
    """

    index: int
    type: int
    corners_m: Corners
    force_n: Points
    moment_nm: Points
    tare_force_n: Vector3
    use: bool = True
    threshold_n: float = 20.0
    belt_speed_m_s: float | None = None
    tare_moment_nm: Vector3 = field(default_factory=lambda: np.zeros(3))
    zero_is_known: bool = False
    moment_offset_m: tuple[float, float, float] | None = None
    clipped_s: tuple[tuple[float, float], ...] = ()

    @property
    def loaded(self) -> Mask:
        """Samples at which the plate carries more than its threshold."""
        norm = np.linalg.norm(self.force_n, axis=1)
        return np.asarray(norm > self.threshold_n)


@dataclass(frozen=True)
class PlateSwitches:
    """User settings of a plate: exclude it, change its loading threshold, state its belt's speed; None: default.

    ``moment_offset_m`` leads from the point that the plate's moments refer to by the file to the one they refer to
    indeed, in the axes of the recording.
    """

    use: bool | None = None
    threshold_n: float | None = None
    belt_speed_m_s: float | None = None
    moment_offset_m: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Window:
    """An interval in which *all* contact force is measured, in seconds of the recording's time axis."""

    start_s: float
    end_s: float

    @property
    def duration_s(self) -> float:
        """Length in seconds."""
        return self.end_s - self.start_s


@dataclass(frozen=True)
class SegmentMotion:
    """Mass and centre of mass of one segment of a body model that is part of the recording."""

    mass_kg: float
    com_m: Points


@dataclass(frozen=True)
class Recording:
    """One trial in the world frame.

    ``markers_m`` maps a label (prefix stripped) to its track at ``marker_rate_hz``. ``plates`` may be empty.
    ``up_axis`` is the axis of the *file* that points up ("+z", "+y", ...); data here are already z up.
    ``walking_direction`` is a horizontal unit vector, or None without walking. ``carried`` holds metadata embedded in a
    simulated recording (its own segment table), else it is empty. ``model_points_m`` are positions in the file that a
    gait model computed (joint centres, a CoM); they are not used as markers. ``filled`` marks, per label, the frames
    whose position was interpolated over a short gap. ``joint_widths_m`` are calliper widths by "l_knee", "r_ankle" ...
    ``recorded_on`` is the day of the recording as YYYY-MM-DD, empty if the file does not contain it. ``segments`` are
    those of the body model of the recording by name, empty without one; ``markers_m`` are then origins of its bodies.
    ``belts_m_s`` are stated speeds of the belts of a treadmill without plates, by number.
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
    segments: Mapping[str, SegmentMotion] = field(default_factory=dict)
    belts_m_s: Mapping[int, float] = field(default_factory=dict)

    @property
    def n_frames(self) -> int:
        """Number of marker frames; 0 without markers."""
        return 0 if not self.markers_m else len(next(iter(self.markers_m.values())))

    @property
    def time_s(self) -> Series:
        """Instants of the marker frames, from 0."""
        return np.arange(self.n_frames) / self.marker_rate_hz

    @property
    def duration_s(self) -> float:
        """Number of frames over their rate."""
        return self.n_frames / self.marker_rate_hz


@dataclass(frozen=True)
class WrenchTrack:
    """Total contact wrench (2.5) at the marker instants, at the world origin.

    ``complete`` marks the samples inside a window, where the sum over the plates is the whole contact wrench;
    elsewhere the values must not be used. ``latency_applied_s`` > 0 means that the force was read that much later.
    ``clocks_compared`` states that its latency has been estimated from this recording, applied or not.
    ``clock_sd_s`` is the standard deviation of what then remains; None if it is not known.
    ``withheld`` marks samples whose wrench an estimator must predict instead of using it, although all contact is on
    the plates; their values are placeholders computed from the geometry.
    """

    time_s: Series
    force_n: Points
    moment_nm: Points
    complete: Mask
    windows: tuple[Window, ...]
    latency_applied_s: float = 0.0
    clocks_compared: bool = False
    withheld: Mask | None = None
    clock_sd_s: float | None = None
