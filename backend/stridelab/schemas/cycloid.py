"""Input and result of ``fit-cycloid``: the rolling wheel of every step (chapter 3)."""

from typing import Literal

from pydantic import Field

from stridelab.schemas.base import Contract, Interval, Remark
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.quality import Quality
from stridelab.schemas.sessions import LatencySource, SessionValues

FootSide = Literal["left", "right"]


class FitCycloidInput(EstimateComInput):
    """Input of ``fit-cycloid``: that of ``estimate-com``, and which steps count."""

    steps: Literal["measured", "all"] = Field(
        default="measured",
        description=(
            "measured: steps during which all contact force is on plates (8 % at either end may be missing); all: "
            "also those for which the centre of mass follows from the markers alone, as far as the estimate reaches: "
            "only the smoother answers outside the window"
        ),
    )


class WheelSd(Contract):
    """Standard deviations of R, r and z0."""

    R_m: float
    r_m: float
    z0_m: float


class Wheel(Contract):
    """A wheel and how far the measured path is from its curve; ``converged`` false means: do not use it."""

    R_m: float
    r_m: float
    z0_m: float
    omega_rad_s: float = Field(description="slope of the line through theta_k")
    theta0_rad: float = Field(description="that line at the first sample of the step")
    error_mean_mm: float
    error_max_mm: float
    converged: bool


class TimedWheel(Contract):
    """The wheel as a clock, theta = theta0 + omega t (3.4); ``bounds`` names the limits that the fit ran into."""

    R_m: float
    r_m: float
    z0_m: float
    omega_rad_s: float
    theta0_rad: float
    error_mean_mm: float
    error_max_mm: float
    bounds: list[str]


class Rival(Contract):
    """One curve beside the others on the same data; AIC counts 12 independent samples per second."""

    model: str
    space: Literal["path", "time"]
    parameters: int
    rms_mm: float
    held_out_mm: float = Field(description="RMS at stretches of the step that the fit did not see")
    aic: float


class FittedStep(Contract):
    """One step, from lift-off to the other foot's lift-off, and its wheel as a path (the thesis' branch, s = +1)."""

    t0_s: float
    t1_s: float
    fitted_s: Interval = Field(description="samples that were used: of a measured step those with all force measured")
    side: FootSide = Field(description="the foot that swings")
    source: Literal["plates", "markers", "mixed"] = Field(description="where the timing comes from")
    measured: bool = Field(description="whether all contact force was on plates")
    R_m: float
    r_m: float
    z0_m: float
    omega_rad_s: float
    theta0_rad: float
    sd: WheelSd = Field(description="formal; the residuals are systematic, so the scatter between steps says more")
    error_mean_mm: float
    error_sd_mm: float
    error_max_mm: float
    theta_off_line_rad: float = Field(description="RMS distance of theta_k from a line in time")
    double_support_s: Interval = Field(description="as plates and markers time it: the answer")
    double_support_model_s: tuple[float | None, float | None] = Field(
        description="crossings of z0 (section 3.3.3), the thesis' rule; null where one is outside the step"
    )
    period_s: float
    step_length_m: float | None = Field(description="heel to heel along the walk")
    speed_m_s: float
    circumference_share: float | None = Field(description="2 pi R over the step length")
    reversed: Wheel = Field(description="the other branch, s = -1: fastest at the lowest point, as people are")
    timed: TimedWheel
    reversed_timed: TimedWheel
    rivals: list[Rival]
    flags: list[str] = Field(description="what must be known before a number of this step is used")


class OverlappingFit(Contract):
    """The wheel of an interval that overlaps with the steps: strike to strike, double and then single support."""

    t0_s: float
    t1_s: float
    R_m: float
    r_m: float
    z0_m: float
    omega_rad_s: float
    error_mean_mm: float


class StepScatter(Contract):
    """How much the wheel differs between the steps of this recording: what one recording's numbers are worth."""

    R_m: float
    r_m: float
    z0_m: float
    omega_rad_s: float
    n: int
    between: Literal["steps", "overlapping-steps"] = Field(
        description="overlapping-steps: one whole step only, so its overlap with strike-to-strike intervals is used"
    )


class FitCycloidSummary(Contract):
    """The rolling wheel of every step of a recording, how well it fits, and simpler curves beside it."""

    window_s: Interval
    rate_hz: float
    method: str
    segment_table: str
    mass_kg: float | None = Field(description="null where none is known, which only the method geometry allows")
    latency_s: float | None
    latency_applied_s: float
    latency_source: LatencySource = "trial"
    latency_n_trials: int = 1
    session: SessionValues | None = None
    ahead: tuple[float, float] = Field(description="horizontal unit vector of the walk")
    steps: list[FittedStep]
    overlapping: list[OverlappingFit]
    step_to_step_sd: StepScatter | None = Field(description="null where there is nothing to compare")
    steps_left_out: int = Field(description="whole steps that were seen but not fitted: force or markers are missing")
    quality: Quality | None = Field(default=None, description="null in results of versions that did not check")
    warnings: list[Remark]
