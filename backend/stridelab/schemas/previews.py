"""What is answered directly: which solvers there are, and the centroidal motion of a scenario that is being changed."""

from typing import Annotated

from pydantic import Field, model_validator

from stridelab.schemas.base import Contract, FaultItem
from stridelab.schemas.plans import NODE_RATE_HZ
from stridelab.schemas.receding import PushSpeed
from stridelab.schemas.scenarios import Position, Scenario

PushForce = Annotated[float, Field(ge=-2000.0, le=2000.0)]


class PreviewPush(Contract):
    """A push at ``time_s``: a change of the CoM's velocity, or a force on the CoM for ``duration_s``, never both."""

    time_s: Annotated[float, Field(ge=0.0, le=600.0)]
    velocity_m_s: tuple[PushSpeed, PushSpeed, PushSpeed] | None = None
    force_n: tuple[PushForce, PushForce, PushForce] | None = None
    duration_s: Annotated[float, Field(gt=0.0, le=1.0)] = 0.1

    @model_validator(mode="after")
    def _one_cause(self) -> "PreviewPush":
        if (self.velocity_m_s is None) == (self.force_n is None):
            raise ValueError("give either velocity_m_s or force_n")
        return self


class PlanPreviewInput(Contract):
    """Body of ``POST /plans/preview``: a stored scenario or a whole one, never both; a push, or none."""

    scenario_id: str | None = None
    scenario: Scenario | None = None
    push: PreviewPush | None = None
    node_rate_hz: Annotated[float, Field(ge=NODE_RATE_HZ[0], le=NODE_RATE_HZ[1])] = 10.0

    @model_validator(mode="after")
    def _one_scenario(self) -> "PlanPreviewInput":
        if (self.scenario_id is None) == (self.scenario is None):
            raise ValueError("give either scenario_id or scenario")
        return self


class PreviewMotion(Contract):
    """A centroidal motion: where the CoM is at ``time_s`` of the scenario, or why there is none (``status``).

    ``objective`` is that of ``plan-motion``; ``solve_time_s`` processor time of the solver.
    """

    converged: bool
    status: str
    objective: float | None
    iterations: int
    solve_time_s: float
    time_s: list[float]
    com_m: list[Position]


class PlanPreview(Contract):
    """Answer of ``POST /plans/preview``; ``took_s`` is all of the processor time, the judge's included.

    ``errors`` is what the judge refuses, as in ``POST /scenarios/check``; there is no motion then. With a push,
    ``recovered`` is the motion from its end on; null where the motion itself has not been found.
    """

    solver: str
    duration_s: float
    took_s: float
    errors: list[FaultItem]
    motion: PreviewMotion
    recovered: PreviewMotion | None = None


class SolverFacts(Contract):
    """A solver of the centroidal problem; ``missing`` is why it is not there, null where it is."""

    name: str
    available: bool
    missing: str | None = None


class Solvers(Contract):
    """Answer of ``GET /solvers``; ``auto`` names the one that is asked first where it can do what is asked."""

    auto: str
    solvers: list[SolverFacts]
