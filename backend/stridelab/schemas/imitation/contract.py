"""Input and result of ``imitate``: a person's recorded walk carried out by a robot."""

from typing import Annotated, Literal

from pydantic import Field

from stridelab.schemas.base import Contract, Remark
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.plans import CertificateSummary, PlanMotionSummary, ReplaySummary
from stridelab.schemas.quality import Quality
from stridelab.schemas.scenarios import Scenario
from stridelab.schemas.tasks import EstimateComTask


class ImitateInput(EstimateComInput):
    """Input of ``imitate``: a recorded walk, level or on stairs, with the fields of ``estimate-com``, and the robot."""

    robot: Annotated[str, Field(min_length=1, max_length=60)]
    step_share: Annotated[float, Field(ge=0.1, le=1.5)] | None = Field(
        default=None, description="length of the steps over the scaled ones; null searches the longest that pass"
    )
    pace: Annotated[float, Field(ge=0.1, le=2.0)] | None = Field(
        default=None, description="pace over the scaled one; null searches the fastest that passes"
    )
    wheel: bool = Field(
        default=True,
        description="plan the walk a second time with the acceleration of the person's rolling wheel as reference, and "
        "compare both plans",
    )


class ImitateTask(EstimateComTask):
    """Task of ``imitate``."""

    input: ImitateInput


class ImitationAttempt(Contract):
    """One plan of the walk: its steps over the scaled ones, its pace over the scaled one, and how far it came."""

    step_share: float = Field(description="length of the steps over that scaled by the height of the hips")
    pace: float = Field(description="1 at the Froude number of the person, if the steps were not shortened")
    step_length_m: float
    speed_m_s: float = Field(description="distance over the time between the two rests")
    certified: bool
    completed: bool = Field(description="whether the replay in physics was completed")
    com_error_max_m: float | None = None
    reason: str = Field(description="empty if certified and completed")

    @property
    def passed(self) -> bool:
        """Whether the motion was certified and its replay completed."""
        return self.certified and self.completed


class ComparedQuantity(Contract):
    """A quantity of the person, measured on the recording, and of the robot, as replayed in physics.

    ``scaled`` is the value of a robot that walked exactly as the person: lengths times the ratio of the heights of the
    hips, times and speeds times its root. Both sides are computed by the same functions; the mean over ``n`` steps.
    """

    name: str
    unit: str
    person: float | None
    scaled: float | None
    robot: float | None
    n_person: int
    n_robot: int


class WheelTrial(Contract):
    """One plan at the steps and the pace of the imitation: costs, margins and errors."""

    wheel: Literal["none", "thesis", "reversed"] = Field(
        description="reference: none; the wheel of (3.1), slowest at its lowest point; the one that is fastest there"
    )
    certified: bool
    completed: bool
    reason: str = Field(description="empty if certified and completed")
    r_m: float | None = Field(default=None, description="radius of the reference's point, for the robot")
    lowest_share: float | None = Field(default=None, description="share of a step at its lowest point")
    com_excursion_m: float | None = Field(default=None, description="of the plan, vertical, over the steady steps")
    acceleration_m2_s3: float | None = Field(default=None, description="int |c''|^2 dt of the plan")
    torque_squared_nm2s: float | None = Field(default=None, description="sum over joints of int tau^2 dt, motion")
    joint_work_j: float | None = Field(default=None, description="sum over joints of int |tau omega| dt, motion")
    momentum_mismatch_nms: float | None = Field(default=None, description="certificate, largest")
    com_error_max_m: float | None = Field(default=None, description="replay")
    com_error_rms_m: float | None = Field(default=None, description="replay")
    torque_ratio_max: float | None = Field(default=None, description="replay")


class ImitateSummary(Contract):
    """Summary of ``imitate``.

    The walk has the longest steps and the fastest pace, among those tried, that are certified and completed.
    ``scenario`` can be planned anew by ``plan-motion``.
    """

    scenario: Scenario
    certificate: CertificateSummary
    replay: ReplaySummary
    comparison: list[ComparedQuantity]
    robot: str
    filename: str
    step_share: float
    pace: float
    speed_share: float = Field(description="speed of the robot's steady steps over the person's, scaled")
    length_scale: float = Field(description="height of the hips, robot over person")
    time_scale: float
    hip_height_person_m: float
    hip_height_robot_m: float
    widened_m: float = Field(description="mean distance by which steps are wider than the scaled ones")
    recorded_footholds: int
    repeated_footholds: int = Field(description="footholds that repeat the last recorded stride")
    attempts: list[ImitationAttempt]
    wheel: list[WheelTrial] = Field(description="plans of the same scenario without and with a wheel as reference")
    plan: PlanMotionSummary
    quality: Quality
    warnings: list[Remark]
