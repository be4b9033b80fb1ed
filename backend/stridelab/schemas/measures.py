"""Input and result of ``gait-measures``: measures of gait per step, side and recording."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from stridelab.schemas.base import Contract, Remark
from stridelab.schemas.methods import Method
from stridelab.schemas.population import MAX_RECORDINGS, LeftOut, refuse_repeated_recordings
from stridelab.schemas.quality import Quality, TrialQuality

Bounds = tuple[float, float]
BodySide = Literal["left", "right"]


class GaitMeasuresInput(Contract):
    """Input of ``gait-measures``: recordings of one person or condition, which are pooled."""

    recording_ids: Annotated[list[str], Field(min_length=1, max_length=MAX_RECORDINGS)]
    method: Method | None = Field(
        default=None, description="estimator of the centre of mass; null selects it as in `estimate-com`"
    )

    @model_validator(mode="after")
    def _check_ids(self) -> "GaitMeasuresInput":
        refuse_repeated_recordings(self.recording_ids, ())
        return self


class MeasureValue(Contract):
    """Mean of one measure over the steps of one side, or of both (`side` null)."""

    name: str
    unit: str
    side: BodySide | None
    n: int = Field(description="number of steps or strides")
    mean: float
    between_sd: float | None = Field(description="standard deviation between the steps; null for one step")
    error_sd: float | None = Field(description="median measurement error of one step; null if it is not known")
    ci95: Bounds | None = Field(description="95 % confidence interval of the mean; null if neither is known")
    symmetry: float | None = Field(
        default=None, description="of a row over both sides: (left - right) / mean of the sides"
    )


class NotMeasured(Contract):
    """A measure that the recordings do not allow, and the reason."""

    name: str
    code: str
    message: str


class GaitMeasuresSummary(Contract):
    """Measures pooled over the recordings; `left_out` lists recordings without any."""

    steps: int = Field(description="whole steps in all recordings")
    sides: dict[BodySide, int] = Field(description="steps by the swinging foot")
    measures: list[MeasureValue]
    not_measured: list[NotMeasured]
    left_out: list[LeftOut]
    n_recordings: int
    method: Method | None = Field(description="null if the recordings have different ones")
    mass_kg: float | None
    height_m: float | None
    speed_m_s: float | None = Field(description="mean walking speed over the steps")
    quality: Quality
    trials: list[TrialQuality]
    warnings: list[Remark]
