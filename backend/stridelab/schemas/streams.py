"""Messages of ``/stream/com`` (configuration, samples, estimates) and ``/stream/markers`` (header, frames, answers)."""

from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from stridelab.schemas.base import Contract, Problem, Remark
from stridelab.schemas.marker_sets import SourceMarkerSet
from stridelab.schemas.recordings import HeightM, MassKg, Sex

Triple = tuple[float, float, float]
Sd = Annotated[float, Field(ge=1e-9, le=1000.0)]
Component = Annotated[float, Field(ge=-1e6, le=1e6)]
MIN_DIRECTION: Final = 1e-6
"""Minimum of the largest component of a direction."""

PACKED_TIME: Final = "<d"
"""Header of a packed message: time in seconds, little-endian float64, to which the times in its rows are relative."""
PACKED_ROW: Final = "<10f"
"""Row of a packed message, ten little-endian float32: the time relative to the header, then three vectors.

They are ``geometry_m, force_n, moment_nm`` of a sample, or ``com_m, velocity_m_s, sd_m`` of an estimate; a missing
vector is three NaN.
"""


class StreamPriors(Contract):
    """Standard deviations of the errors of the inputs.

    They determine the standard deviation of the estimate, and in the smoother also the weight of each input.
    """

    geometry_m: tuple[Sd, Sd, Sd] = Field(
        default=(0.008, 0.008, 0.02), description="CoM of the segment model, per axis"
    )
    marker_m: Sd = Field(default=0.001, description="noise of the CoM from marker noise")
    acceleration_m_s2: tuple[Sd, Sd, Sd] = Field(
        default=(0.05, 0.05, 0.15), description="constant error of force / mass, per axis"
    )
    moment_nm: Sd = Field(default=2.0, description="constant error of each horizontal moment at the body")
    momentum_rate_nm_kg: tuple[Sd, Sd] = Field(
        default=(0.12, 0.33), description="change of angular momentum per kilogram, RMS, about walking and lateral axis"
    )
    step_hz: Annotated[float, Field(ge=0.1, le=10.0)] = Field(default=1.8, description="steps per second")
    clock_s: Sd = Field(default=0.005, description="delay between force and markers")


class StreamConfiguration(Contract):
    """Configuration of a stream: its first message, as text."""

    mass_kg: Annotated[float, Field(gt=1.0, lt=1000.0)]
    rate_hz: Annotated[float, Field(gt=0.0)] = Field(description="number of samples per second")
    method: Literal["complementary", "smoother"] = "complementary"
    cutoffs: Literal["auto", "thesis"] | tuple[float, float] = Field(
        default="auto", description="low and high cut-off in Hz (2.24-2.27); for the complementary filter only"
    )
    ahead: tuple[Component, Component] | None = Field(
        default=None, description="walking direction along x and y, if known; for the smoother only"
    )
    priors: StreamPriors = Field(default_factory=StreamPriors)
    velocity_m_s: tuple[Component, Component, Component] | None = Field(
        default=None, description="CoM velocity at the first sample, if known"
    )
    format: Literal["json", "float32"] = Field(default="json", description="format of all following messages")

    @field_validator("ahead")
    @classmethod
    def _is_a_direction(cls, ahead: tuple[float, float] | None) -> tuple[float, float] | None:
        if ahead is not None and max(map(abs, ahead)) < MIN_DIRECTION:
            raise ValueError("a direction must not be zero")
        return ahead


class StreamSample(Contract):
    """One sample. Null: hidden markers (geometry) or contact force not fully measured; in flight, the force is zero."""

    time_s: float
    geometry_m: Triple | None = None
    force_n: Triple | None = None
    moment_nm: Triple | None = None

    @model_validator(mode="after")
    def _wrench_is_whole(self) -> "StreamSample":
        if (self.force_n is None) != (self.moment_nm is None):
            raise ValueError("force_n and moment_nm must be given together")
        return self


class StreamEstimate(Contract):
    """Estimate for one sample; ``sd_m`` is the standard deviation of the position per axis."""

    time_s: float
    com_m: Triple
    velocity_m_s: Triple
    sd_m: Triple


class StreamReady(Contract):
    """Response to the configuration: the estimator and its parameters."""

    method: str
    rate_hz: float
    format: Literal["json", "float32"]
    low_hz: float | None = None
    high_hz: float | None = None
    references: list[str]


class StreamSamples(Contract):
    """A message with samples."""

    samples: list[StreamSample]


class StreamAnswer(Contract):
    """A text message of the service; exactly one field is set."""

    ready: StreamReady | None = None
    samples: list[StreamEstimate] | None = None
    problem: Problem | None = None


MarkerLabel = Annotated[str, Field(min_length=1, max_length=100)]
Coordinate = float | None


class MarkerPlate(Contract):
    """A force plate of a stream of markers; its corners in the units and axes of the markers, in order around it."""

    corners: tuple[Triple, Triple, Triple, Triple]


class MarkerPerson(Contract):
    """The person who is measured; without ``mass_kg`` forces are not used."""

    mass_kg: MassKg | None = None
    height_m: HeightM | None = None
    sex: Sex | None = None


class MarkerStreamConfiguration(Contract):
    """Header of a stream of markers: its first message. Every frame then has one marker per label, in this order.

    Without ``labels``, they are those of ``marker_set``, in the order of the answer.
    """

    labels: Annotated[list[MarkerLabel], Field(min_length=1, max_length=500)] | None = None
    marker_set: Annotated[str, Field(max_length=80)] | None = Field(
        default=None, description="only this marker set is considered: a shipped one, or one of yours"
    )
    marker_map: dict[str, MarkerLabel] = Field(default_factory=dict, description="landmark to label")
    rate_hz: Annotated[float, Field(ge=20.0)] = Field(description="frames per second")
    units: Literal["m", "mm"] = Field(default="m", description="of marker positions, corners, centres of pressure")
    up_axis: Literal["+x", "-x", "+y", "-y", "+z", "-z"] = "+z"
    person: MarkerPerson = Field(default_factory=MarkerPerson)
    plates: Annotated[list[MarkerPlate], Field(max_length=16)] = Field(default_factory=list)
    belt_speed_m_s: Annotated[float, Field(ge=0.0, le=12.0)] = Field(default=0.0, description="of a treadmill")
    static_pose: dict[MarkerLabel, Triple] = Field(
        default_factory=dict, description="positions by label while the same person stands still, as in a frame"
    )
    static_recording_id: str | None = Field(default=None, description="a stored static trial, instead of a pose")
    title: Annotated[str, Field(max_length=80)] = Field(default="", description="shown where streams are listed")

    @model_validator(mode="after")
    def _names_its_markers(self) -> "MarkerStreamConfiguration":
        if self.labels is None and self.marker_set is None:
            raise ValueError("labels or marker_set must be given")
        if self.labels is not None and len(set(self.labels)) < len(self.labels):
            raise ValueError("every label must be given once")
        return self


class MarkerStreamTask(Contract):
    """First task of the child process of a stream of markers; ``static_world_m`` is the pose of a stored recording."""

    configuration: MarkerStreamConfiguration
    marker_sets: list[SourceMarkerSet] = Field(default_factory=list)
    static_world_m: dict[str, Triple] = Field(default_factory=dict)


class PlateForce(BaseModel):
    """Force of one plate on the person, and where it acts: the centre of pressure, or its moment about the origin."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=True, frozen=True)

    force_n: tuple[Coordinate, Coordinate, Coordinate]
    cop: tuple[Coordinate, Coordinate, Coordinate] | None = None
    moment_nm: tuple[Coordinate, Coordinate, Coordinate] | None = None


class MarkerFrame(BaseModel):
    """One frame. A marker that is null, has a null or NaN, or is at exactly (0, 0, 0) is hidden.

    A plate that is null has not been read; without ``plates`` none has.
    """

    model_config = ConfigDict(extra="forbid", allow_inf_nan=True, frozen=True)

    t_s: Annotated[float, Field(ge=-1e9, le=1e9)]
    markers: list[tuple[Coordinate, Coordinate, Coordinate] | None]
    plates: list[PlateForce | None] | None = None


class FrameMargin(Contract):
    """Margin of stability in metres, positive inside the base of support: ahead, and sideways."""

    ap: float
    ml: float


class FrameContact(Contract):
    """Whether each foot stands; null where its markers are hidden."""

    left: bool | None = None
    right: bool | None = None


class FrameBridged(Contract):
    """What was missing in a frame, and how it was bridged.

    ``geometry`` says where the centre of mass of the segment model comes from: ``measured`` markers, with hidden
    landmarks ``substituted``, ``coasted`` from force or velocity, or ``none``. ``force`` is the reason why no force was
    used, null where it was. ``restarted`` after a jump of time.
    """

    frames_lost: int = 0
    markers_hidden: list[str] = Field(default_factory=list)
    geometry: Literal["measured", "substituted", "coasted", "none"]
    force: str | None = None
    restarted: bool = False


class FrameEstimate(Contract):
    """Answer to one frame, in metres and in the axes of the frame; null where there is no estimate, with the reason."""

    t_s: float
    com_m: Triple | None = None
    com_sd_m: Triple | None = None
    velocity_m_s: Triple | None = None
    xcom_m: Triple | None = None
    height_m: float | None = Field(default=None, description="of the centre of mass above the floor")
    speed_m_s: float | None = Field(default=None, description="horizontal, against the ground")
    reason: str | None = None
    margin_m: FrameMargin | None = None
    margin_reason: str | None = None
    contact: FrameContact
    bridged: FrameBridged


class MarkerStreamReady(Contract):
    """Answer to the header: what was recognised, what is missing, and what it costs.

    ``landmarks`` maps a landmark to its label, ``unused`` are labels without one. ``remarks`` say what is substituted
    and its cost.
    """

    stream_id: str
    marker_set: str
    labels: list[str]
    landmarks: dict[str, str]
    unused: list[str]
    missing: list[str]
    remarks: list[Remark]
    force_used: bool
    low_hz: float
    high_hz: float
    references: list[str]


class MarkerStreamAnswer(Contract):
    """A text message of the service that is no ``FrameEstimate``; exactly one field is set."""

    ready: MarkerStreamReady | None = None
    problem: Problem | None = None


class LiveStream(Contract):
    """An open stream of markers."""

    stream_id: str
    title: str
    marker_set: str
    rate_hz: float
    n_watching: int


class LiveStreams(Contract):
    """The open streams of markers, the newest first."""

    items: list[LiveStream]
