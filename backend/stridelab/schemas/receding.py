"""Pushed robots: ``plan-receding``, receding-horizon control, and ``push-basin``, the whole body in physics."""

from typing import Annotated, Final, Literal

from pydantic import Field, model_validator

from stridelab.schemas.base import Contract, Remark
from stridelab.schemas.methods import NODE_RATE_HZ, Formulation
from stridelab.schemas.scenarios import Scenario, ScenarioSource

PushSpeed = Annotated[float, Field(ge=-2.0, le=2.0)]


class Push(Contract):
    """A push: changes the CoM velocity by ``velocity_m_s`` at the end of the period that contains ``time_s``."""

    time_s: Annotated[float, Field(ge=0.0, le=600.0)]
    velocity_m_s: tuple[PushSpeed, PushSpeed, PushSpeed]


class PlanRecedingInput(ScenarioSource):
    """Input of ``plan-receding``: either a stored scenario or a complete one.

    Every ``period_s``, the motion over the next ``horizon_s`` is replanned from the current state and executed for one
    period. ``formulation``, ``node_rate_hz`` and ``measure`` are those of ``plan-motion``; ``warm`` enables a warm
    start from the previous solution.
    """

    horizon_s: Annotated[float, Field(ge=0.5, le=10.0)] = 2.5
    period_s: Annotated[float, Field(ge=0.02, le=1.0)] = 0.1
    pushes: list[Push] = Field(default_factory=list, max_length=50)
    warm: bool = True
    formulation: Formulation = "forces"
    node_rate_hz: Annotated[float, Field(ge=NODE_RATE_HZ[0], le=NODE_RATE_HZ[1])] = 10.0
    measure: Literal["uniform", "conditioned"] | None = None

    @model_validator(mode="after")
    def _check_period(self) -> "PlanRecedingInput":
        if self.period_s >= self.horizon_s:
            raise ValueError("period_s must be shorter than horizon_s")
        return self


class PlanRecedingSummary(Contract):
    """Summary of ``plan-receding``; times are processor times of one replan: building, solving and checking.

    ``carried_on`` is the number of periods without a solution, in which the previous plan continued; ``goal_gap_m`` is
    the distance of the final CoM to its rest position. ``solver`` is null in results of versions without this field.
    """

    scenario_name: str
    robot: str
    duration_s: float
    solver: str | None = None
    replans: int
    carried_on: int
    iterations_median: float
    iterations_max: int
    replan_median_ms: float
    replan_p99_ms: float
    replan_max_ms: float
    goal_gap_m: float
    warnings: list[Remark]


class PlanRecedingTask(Contract):
    """Task of ``plan-receding``, with the resolved scenario."""

    scenario: Scenario
    input: PlanRecedingInput


PushOutcome = Literal["survived", "proved-lost", "unexplained"]
"""``survived``: the robot does not fall. Of falls, ``proved-lost`` has a proof that no motion would have saved it."""
MAX_PUSHES: Final = 1000


class PushBasinInput(ScenarioSource):
    """Input of ``push-basin``: either a stored scenario or a complete one, and the pushes.

    The motion of ``plan-motion`` is replayed ``n`` times, each time with one push on the trunk that changes the
    velocity of the centre of mass by ``speed_m_s``, at a random time of the motion, in a random horizontal direction.
    ``seed`` determines both. ``robot`` replaces that of the scenario.
    """

    robot: Annotated[str, Field(min_length=1, max_length=60)] | None = None
    speed_m_s: Annotated[float, Field(gt=0.0, le=5.0)]
    n: Annotated[int, Field(ge=1, le=MAX_PUSHES)] = 50
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 0


class PushBasinSummary(Contract):
    """Summary of ``push-basin``: numbers of pushes by outcome, which add up to ``n``.

    ``survived_ci95`` is the 95 % confidence interval (Wilson) of the share of survived pushes. ``provable`` is false
    where the premises of the proof do not hold, so that no fall can be proved; ``certified`` whether the motion passes
    its certificate. ``arrived`` counts the survived pushes after which the robot ends on the contacts with which the
    plan ends, ``completed`` those whose replay is completed.
    """

    scenario_name: str
    robot: str
    duration_s: float
    speed_m_s: float
    impulse_ns: float
    n: int
    seed: int
    survived: int
    proved_lost: int
    unexplained: int
    arrived: int | None = Field(default=None, description="null in results of earlier versions")
    completed: int
    survived_ci95: tuple[float, float]
    provable: bool
    certified: bool
    wall_time_s: float
    processes: int
    warnings: list[Remark]


class PushBasinTask(Contract):
    """Task of ``push-basin``, with the resolved scenario."""

    scenario: Scenario
    input: PushBasinInput
