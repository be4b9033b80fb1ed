"""Messages of ``/stream/com``: configuration, samples, and estimates."""

from typing import Annotated, Final, Literal

from pydantic import Field, field_validator, model_validator

from stridelab.schemas.base import Contract, Problem

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
