"""Inputs and results of ``compare-estimators`` and ``com-bench``.

Errors are given per axis or horizontal and vertical, never in 3D.
"""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from stridelab.schemas.base import Contract, Interval, Remark
from stridelab.schemas.jobs import EstimateComInput, RecordingSummary
from stridelab.schemas.measures import MeasuresMember
from stridelab.schemas.methods import Method
from stridelab.schemas.population import MAX_RECORDINGS, LeftOut, SubjectOfRecording, refuse_repeated_recordings
from stridelab.schemas.quality import Quality, TrialQuality
from stridelab.schemas.tasks import EstimateComTask


class CompareEstimatorsInput(EstimateComInput):
    """Input of ``compare-estimators``: the fields of ``estimate-com``.

    ``method`` null compares all estimators of this version, and the complementary filter also with the cut-off
    frequencies of the thesis; a name compares this estimator with the geometry.
    """


class Axes(Contract):
    """One value per axis: along the walk, to its left, up; null if it cannot be computed."""

    along: float | None
    lateral: float | None
    vertical: float | None


class ErrorAgainstTruth(Contract):
    """Error with respect to the ground truth; ``lag_s`` > 0 means that the estimate is late."""

    horizontal_m: float = Field(description="RMS of the horizontal distance from the true centre of mass")
    horizontal_95_m: float = Field(description="95th percentile of that distance")
    vertical_m: float
    rms_m: Axes
    mean_m: Axes
    coverage: Axes = Field(description="share of samples inside the stated 95 % band")
    sd_m: Axes = Field(description="RMS of the stated standard deviation")
    lag_s: Axes


class FlightAgreement(Contract):
    """Agreement with free fall during flight; ``vertical_share`` is the vertical acceleration over g, minus one."""

    flights: int
    vertical_share: float
    horizontal_m_s2: float


class MomentumRateAgreement(Contract):
    """Rate of angular momentum from the plates and this estimate, compared with that of the body segments."""

    correlation: Axes
    rms_nm: Axes


class MethodAssessment(Contract):
    """Assessment of one estimator on a recording; null for checks that do not apply."""

    method: str
    offset_m: Axes = Field(description="estimate minus geometry, mean over the window")
    force_residual_n: Axes = Field(description="RMS of m (c'' - g) - f in an 8 Hz band")
    held_back_n: Axes | None = Field(description="the same at force samples withheld from the estimator")
    momentum_rate: MomentumRateAgreement | None
    flight: FlightAgreement | None
    standing_m: float | None = Field(
        description="standing on plates: horizontal distance to the mean centre of pressure"
    )
    truth: ErrorAgainstTruth | None
    warnings: list[Remark]


class CompareEstimatorsSummary(RecordingSummary):
    """All estimators on one recording: errors against the ground truth, agreement with physics, and spectra."""

    mass_kg: float
    latency_sd_s: float | None
    reference: Literal["truth", "geometry"] = Field(description="reference for the spectra of the estimators")
    methods: dict[str, MethodAssessment]
    refused: dict[str, Remark] = Field(description="estimators that reject this recording, and the reason")


class ComBenchInput(Contract):
    """Input of ``com-bench``; recordings without a subject count as different people."""

    recording_ids: list[str] = Field(min_length=1, max_length=MAX_RECORDINGS)
    subjects: list[SubjectOfRecording] = Field(default_factory=list, max_length=MAX_RECORDINGS)
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = Field(
        default=0, description="random seed of the bootstrap intervals"
    )

    @model_validator(mode="after")
    def _check_ids(self) -> "ComBenchInput":
        refuse_repeated_recordings(self.recording_ids, self.subjects)
        return self


class BenchScore(Contract):
    """Mean over people of one estimator; roots of mean squares, or shares of samples."""

    value: float
    ci95: Interval | None = Field(description="bootstrap over people; null for fewer than five")
    over_best: float | None = Field(description="ratio to the best of the column; null for a coverage")


class BenchColumn(Contract):
    """One score in one movement, over the recordings in which all estimators have it."""

    name: str = Field(description="movement and score, e.g. `grounded_force_path_along`")
    movement: Literal["standing", "grounded", "airborne"]
    unit: Literal["m", "1"]
    orders: bool = Field(description="whether the score orders estimators as the truth does, on simulated people")
    n: int = Field(description="people")
    recordings: int
    unmatched: int = Field(description="recordings left out because an estimator has no score there")
    scores: dict[Method, BenchScore]


class MethodRefusal(Contract):
    """An estimator that rejects a recording, with the reason."""

    recording_id: str
    filename: str
    method: Method
    code: str
    message: str


class MassAgreement(Contract):
    """Mass that the plates measure against the stated one, over the recordings that have both."""

    n: int = Field(description="recordings")
    rms_share: float | None
    max_share: float | None


class ComBenchSummary(Contract):
    """Scores of all estimators over many recordings, by what none of them was given."""

    columns: list[BenchColumn]
    n_recordings: int
    n_people: int
    mass: MassAgreement
    refused: list[MethodRefusal]
    left_out: list[LeftOut]
    quality: Quality
    trials: list[TrialQuality]
    warnings: list[Remark]


class CompareEstimatorsTask(EstimateComTask):
    """Task of ``compare-estimators``; ``truth`` is the file with the true motion, if it is known."""

    input: CompareEstimatorsInput
    truth: str | None = Field(default=None, description="file name inside the task's folder")


class BenchMember(MeasuresMember):
    """One recording of ``com-bench``; ``subject`` is a pseudonym, null if it is not stated."""

    subject: str | None = None


class ComBenchTask(Contract):
    """Task of ``com-bench``."""

    members: list[BenchMember]
    seed: int = 0
