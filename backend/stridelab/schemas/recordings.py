"""Recordings and subjects of the HTTP contract."""

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


class SubjectFields(Contract):
    """What a user may state about a person; ``name`` is a pseudonym of the user's own choice."""

    name: Annotated[str, Field(max_length=80)] | None = None
    height_m: HeightM | None = None
    mass_kg: MassKg | None = None
    sex: Sex | None = None
    age_years: AgeYears | None = None


class SubjectInput(SubjectFields):
    """Body of ``POST /subjects`` and ``PATCH /subjects/{subject_id}``."""


class Subject(SubjectFields):
    """A pseudonymous person."""

    subject_id: str
    created_at: datetime
    n_recordings: int = Field(default=0, description="how many recordings are linked to the subject")


class PlateInfo(Contract):
    """A force plate of a recording."""

    index: int
    type: int
    corners_m: list[list[float]]
    loaded_s: list[Interval]
    use: bool = True
    threshold_n: float = 20.0


class PlateSwitch(Contract):
    """What a user may set per plate."""

    use: bool | None = None
    threshold_n: Annotated[float, Field(ge=1.0, le=500.0)] | None = None


class RecordingPatch(Contract):
    """Body of ``PATCH /recordings/{id}``; only the given fields change.

    ``marker_map`` maps the service's landmark names to labels of the file, or of its static trial; ``plates`` maps a
    plate index to switches. ``session_id`` states the session; null lets the service find it by itself.
    """

    subject_id: str | None = None
    subject: SubjectFields | None = None
    static_recording_id: str | None = None
    marker_map: dict[str, str] | None = None
    plates: dict[int, PlateSwitch] | None = None
    session_id: SessionId | None = None


class TrialClock(Contract):
    """How late the force is against the markers, from this file and its switches alone; > 0: the force is late."""

    latency_s: float
    sd_s: float


class RecordingFacts(Contract):
    """What parsing a file yields; the answer of the parsing child, stored with the row."""

    duration_s: float
    n_frames: int
    marker_rate_hz: float
    force_rate_hz: float
    marker_set: str | None
    n_markers: int
    subject: SubjectFields
    mass_from_force_kg: float | None = None
    mass_from_force_sd_kg: float | None = None
    clock: TrialClock | None = Field(default=None, description="null where force and markers cannot be compared")
    recorded_on: date | None = Field(default=None, description="day of the recording, where the file states it")
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
    """Whether a method of ``estimate-com`` can be tried on a recording."""

    method: Method
    possible: bool = Field(description="false: what is stored of the recording says that the method refuses it")
    code: str | None = Field(default=None, description="code of the refusal; null where the method can be tried")
    reason: str | None = Field(default=None, description="the refusal in a sentence")


class Recording(RecordingFacts):
    """A stored recording: what parsing its file yielded, and what the service and its users know of it."""

    id: str
    sha256: str
    filename: str
    bytes: int
    created_at: datetime
    subject_id: str | None = None
    marker_map: dict[str, str]
    static_recording_id: str | None = None
    session_id: str | None = Field(default=None, description="session of trials with one clock and one body mass")
    session_stated: bool = Field(default=False, description="stated by the user, not found by the service")
    estimates: list[EstimateOffer] = Field(default_factory=list, description="every method of `estimate-com`")
    bundled: bool = False
    truth_job_id: str | None = None
    owner: str | None = None
