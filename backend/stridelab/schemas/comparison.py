"""Input and result of ``compare-estimators``. Errors are given per axis or horizontal and vertical, never in 3D."""

from typing import Literal

from pydantic import Field

from stridelab.schemas.base import Contract, Interval, Remark
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.quality import Quality
from stridelab.schemas.recordings import TreadmillBelts
from stridelab.schemas.sessions import LatencySource, SessionValues


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


class CompareEstimatorsSummary(Contract):
    """All estimators on one recording: errors against the ground truth, agreement with physics, and spectra."""

    window_s: Interval
    rate_hz: float
    segment_table: str
    mass_kg: float
    latency_s: float | None
    latency_sd_s: float | None
    latency_applied_s: float
    latency_source: LatencySource = "trial"
    latency_n_trials: int = 1
    session: SessionValues | None = None
    treadmill: TreadmillBelts | None = Field(default=None, description="null for a walk over ground")
    reference: Literal["truth", "geometry"] = Field(description="reference for the spectra of the estimators")
    methods: dict[str, MethodAssessment]
    refused: dict[str, Remark] = Field(description="estimators that reject this recording, and the reason")
    quality: Quality | None = Field(default=None, description="null in results of versions without this check")
    warnings: list[Remark]
