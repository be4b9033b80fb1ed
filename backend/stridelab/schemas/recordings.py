"""Schemas of recordings and subjects."""

from datetime import date, datetime
from typing import Annotated, Literal

from pydantic import Field

from stridelab.schemas.base import Contract, Interval, Remark
from stridelab.schemas.methods import Method
from stridelab.schemas.sessions import SessionId

HeightM = Annotated[float, Field(ge=0.4, le=2.6, description="stature in metres")]
MassKg = Annotated[float, Field(ge=2.0, le=400.0, description="body mass in kilograms")]
AgeYears = Annotated[float, Field(ge=0.0, le=120.0)]
Sex = Literal["female", "male"]


BeltSpeed = Annotated[float, Field(gt=0.0, le=12.0, description="speed of the treadmill belt on this plate")]
OffsetAlongAxis = Annotated[float, Field(ge=-0.5, le=0.5)]
MomentOffset = Annotated[
    tuple[OffsetAlongAxis, OffsetAlongAxis, OffsetAlongAxis],
    Field(
        description="from the point that the plate's moments refer to by the file to the one they refer to indeed, m, "
        "axes of the recording"
    ),
]


class SubjectFields(Contract):
    """Fields of a subject that a user may state; ``name`` is a pseudonym chosen by the user."""

    name: Annotated[str, Field(max_length=80)] | None = None
    height_m: HeightM | None = None
    mass_kg: MassKg | None = None
    sex: Sex | None = None
    age_years: AgeYears | None = None


class SubjectInput(SubjectFields):
    """Body of ``POST /subjects`` and ``PATCH /subjects/{subject_id}``."""


class Subject(SubjectFields):
    """A pseudonymous subject."""

    subject_id: str
    created_at: datetime
    n_recordings: int = Field(default=0, description="number of recordings linked to the subject")


class TreadmillBelts(Contract):
    """Treadmill of a recording: the speed of the belt under each foot, and the frame of the result's positions."""

    left_m_s: float
    right_m_s: float
    source: Literal["stated", "feet"] = Field(description="stated by the user, or estimated from the standing feet")
    frame: Literal["laboratory", "belt"] = Field(
        description="laboratory: positions do not move with the belts; belt: relative to the belts' mean motion"
    )


class PlateInfo(Contract):
    """A force plate of a recording."""

    index: int
    type: int
    corners_m: list[list[float]]
    loaded_s: list[Interval]
    use: bool = True
    threshold_n: float = 20.0
    belt_speed_m_s: float | None = Field(default=None, description="stated speed of the treadmill belt on this plate")
    zero: list[float] | None = Field(
        default=None,
        description="force (N) and moment (Nm, about the origin) of the unloaded plate, which were subtracted; null if "
        "it is never unloaded",
    )
    moment_offset_m: MomentOffset | None = None


class PlateSwitch(Contract):
    """User settings of one force plate."""

    use: bool | None = None
    threshold_n: Annotated[float, Field(ge=1.0, le=500.0)] | None = None
    belt_speed_m_s: BeltSpeed | None = None
    moment_offset_m: MomentOffset | None = None


class RecordingPatch(Contract):
    """Body of ``PATCH /recordings/{id}``; only the given fields change.

    ``marker_map`` maps the service's landmark names to labels of the file, or of its static trial; ``plates`` maps a
    plate index to switches. ``session_id`` states the session; null lets the service determine it.
    """

    subject_id: str | None = None
    subject: SubjectFields | None = None
    static_recording_id: str | None = None
    marker_map: dict[str, str] | None = None
    plates: dict[int, PlateSwitch] | None = None
    session_id: SessionId | None = None


class TrialClock(Contract):
    """Latency of the force with respect to the markers, estimated from this file alone; > 0: the force is late."""

    latency_s: float
    sd_s: float


class EventDelay(Contract):
    """How late events by markers are against those of plates; as a fact, with the latency of the force in it."""

    late_s: float
    sd_s: float


class EventDelays(Contract):
    """Mean delays of the strikes and lift-offs in whole stances on plates; null without one."""

    strike: EventDelay | None = None
    lift_off: EventDelay | None = None


class RecordingFacts(Contract):
    """Result of parsing a file, stored with the row of the recording."""

    duration_s: float
    n_frames: int
    marker_rate_hz: float
    force_rate_hz: float
    marker_set: str | None
    marker_set_id: str | None = Field(default=None, description="id of the set if a user stored it")
    n_markers: int
    subject: SubjectFields
    mass_from_force_kg: float | None = None
    mass_from_force_sd_kg: float | None = None
    clock: TrialClock | None = Field(default=None, description="null if force and markers cannot be compared")
    event_delays: EventDelays = Field(default_factory=EventDelays, description="calibrate the events of its session")
    recorded_on: date | None = Field(default=None, description="day of the recording, if the file states it")
    still: bool = Field(default=False, description="the person stands still: a static trial")
    simulated: bool = Field(default=False, description="the file carries the segment table of a simulated body")
    plates: list[PlateInfo]
    windows_s: list[Interval]
    up_axis: str
    walking_direction: list[float] | None
    labels: list[str]
    landmarks: dict[str, str]
    missing_landmarks: list[str]
    warnings: list[Remark]


class EstimateOffer(Contract):
    """Whether a method of ``estimate-com`` is applicable to a recording."""

    method: Method
    possible: bool = Field(description="false: the method would reject the recording, according to the stored facts")
    code: str | None = Field(default=None, description="error code; null if the method is applicable")
    reason: str | None = Field(default=None, description="explanation of the error")


class Recording(RecordingFacts):
    """A stored recording: the result of parsing its file, and the fields added by the service and its users."""

    id: str
    sha256: str
    filename: str
    bytes: int
    created_at: datetime
    subject_id: str | None = None
    marker_map: dict[str, str]
    static_recording_id: str | None = None
    session_id: str | None = Field(default=None, description="session of trials with one clock and one body mass")
    session_stated: bool = Field(
        default=False, description="true: stated by the user; false: determined by the service"
    )
    estimates: list[EstimateOffer] = Field(
        default_factory=list, description="applicability of every method of `estimate-com`"
    )
    bundled: bool = False
    truth_job_id: str | None = None
    owner: str | None = None
