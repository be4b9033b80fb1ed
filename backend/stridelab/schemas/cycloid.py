"""Input and result of ``fit-cycloid``: the curtate cycloid of each step, drawn by a rolling wheel (chapter 3)."""

from typing import Literal

from pydantic import Field

from stridelab.schemas.base import Contract, Interval
from stridelab.schemas.jobs import EstimateComInput, RecordingSummary
from stridelab.schemas.tasks import EstimateComTask

FootSide = Literal["left", "right"]


class FitCycloidInput(EstimateComInput):
    """Input of ``fit-cycloid``: the fields of ``estimate-com``, and the selection of steps."""

    steps: Literal["measured", "all"] = Field(
        default="measured",
        description=(
            "measured: steps with all contact force on plates (8 % at either end may be missing); all: also steps in "
            "which the centre of mass is estimated from the markers alone (outside the window only by the smoother)"
        ),
    )


class WheelSd(Contract):
    """Standard deviations of R, r and z0."""

    R_m: float
    r_m: float
    z0_m: float


class Wheel(Contract):
    """A rolling wheel and the distance of the measured path to its curve; unusable if ``converged`` is false."""

    R_m: float
    r_m: float
    z0_m: float
    omega_rad_s: float = Field(description="slope of the line through theta_k")
    theta0_rad: float = Field(description="value of this line at the first sample of the step")
    error_mean_mm: float
    error_max_mm: float
    converged: bool


class TimedWheel(Contract):
    """Wheel with constant angular velocity, theta = theta0 + omega t (3.4); ``bounds`` lists the active limits."""

    R_m: float
    r_m: float
    z0_m: float
    omega_rad_s: float
    theta0_rad: float
    error_mean_mm: float
    error_max_mm: float
    bounds: list[str]


class Rival(Contract):
    """An alternative curve fitted to the same data; the AIC assumes 12 independent samples per second."""

    model: str
    space: Literal["path", "time"]
    parameters: int
    rms_mm: float
    held_out_mm: float = Field(description="RMS on parts of the step that are withheld from the fit")
    aic: float


class FittedStep(Contract):
    """One step, from lift-off to lift-off of the other foot, and its wheel fitted to the path (branch s = +1)."""

    t0_s: float
    t1_s: float
    fitted_s: Interval = Field(
        description="interval used by the fit: of a measured step, samples with all force measured"
    )
    side: FootSide = Field(description="swing foot")
    source: Literal["plates", "markers", "mixed"] = Field(description="source of the timing")
    measured: bool = Field(description="whether all contact force was on plates")
    R_m: float
    r_m: float
    z0_m: float
    omega_rad_s: float
    theta0_rad: float
    sd: WheelSd = Field(description="formal; the residuals are systematic, so prefer the scatter between steps")
    error_mean_mm: float
    error_sd_mm: float
    error_max_mm: float
    theta_off_line_rad: float = Field(description="RMS distance of theta_k from a line in time")
    double_support_s: Interval = Field(description="measured by plates and markers")
    double_support_model_s: tuple[float | None, float | None] = Field(
        description="from the crossings of z0 (section 3.3.3); null if a crossing is outside the step"
    )
    period_s: float
    step_length_m: float | None = Field(description="heel to heel, along the walking direction")
    speed_m_s: float
    circumference_share: float | None = Field(description="2 pi R divided by the step length")
    reversed: Wheel = Field(description="branch s = -1: fastest at the lowest point, as in human walking")
    timed: TimedWheel
    reversed_timed: TimedWheel
    rivals: list[Rival]
    flags: list[str] = Field(description="reservations about the values of this step")


class OverlappingFit(Contract):
    """Wheel of an interval from heel strike to heel strike (double, then single support), overlapping the steps."""

    t0_s: float
    t1_s: float
    R_m: float
    r_m: float
    z0_m: float
    omega_rad_s: float
    error_mean_mm: float


class StepScatter(Contract):
    """Standard deviation of the wheel between the steps of this recording."""

    R_m: float
    r_m: float
    z0_m: float
    omega_rad_s: float
    n: int
    between: Literal["steps", "overlapping-steps"] = Field(
        description="overlapping-steps: there is one step only, so strike-to-strike intervals are used as well"
    )


class FitCycloidSummary(RecordingSummary):
    """Rolling wheel of each step of a recording, its goodness of fit, and alternative curves."""

    method: str
    mass_kg: float | None = Field(description="null if unknown, which only the method geometry allows")
    ahead: tuple[float, float] = Field(description="horizontal unit vector of the walking direction")
    steps: list[FittedStep]
    overlapping: list[OverlappingFit]
    step_to_step_sd: StepScatter | None = Field(description="null if there are too few steps")
    steps_left_out: int = Field(description="complete steps that were not fitted because force or markers are missing")


class FitCycloidTask(EstimateComTask):
    """Task of ``fit-cycloid``."""

    input: FitCycloidInput
