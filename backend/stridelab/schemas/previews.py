"""Schemas of interactive planning: solvers, previews of a centroidal motion, and parts of a plan that is computed."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from stridelab.schemas.base import Contract, FaultItem
from stridelab.schemas.jobs import JobState
from stridelab.schemas.methods import NODE_RATE_HZ
from stridelab.schemas.plans import CertificateCheck
from stridelab.schemas.receding import PushSpeed
from stridelab.schemas.scenarios import Position, ScenarioSource

PushForce = Annotated[float, Field(ge=-2000.0, le=2000.0)]


class PreviewPush(Contract):
    """A push at ``time_s``: either a change of the CoM velocity, or a force on the CoM for ``duration_s``."""

    time_s: Annotated[float, Field(ge=0.0, le=600.0)]
    velocity_m_s: tuple[PushSpeed, PushSpeed, PushSpeed] | None = None
    force_n: tuple[PushForce, PushForce, PushForce] | None = None
    duration_s: Annotated[float, Field(gt=0.0, le=1.0)] = 0.1

    @model_validator(mode="after")
    def _check_cause(self) -> "PreviewPush":
        if (self.velocity_m_s is None) == (self.force_n is None):
            raise ValueError("give either velocity_m_s or force_n")
        return self


class PlanPreviewInput(ScenarioSource):
    """Body of ``POST /plans/preview``: either a stored scenario or a complete one, and an optional push."""

    push: PreviewPush | None = None
    node_rate_hz: Annotated[float, Field(ge=NODE_RATE_HZ[0], le=NODE_RATE_HZ[1])] = 10.0


class PreviewMotion(Contract):
    """A centroidal motion: CoM positions at the times ``time_s`` of the scenario; ``status`` explains a failure.

    ``objective`` is that of ``plan-motion``; ``solve_time_s`` is the processor time of the solver.
    """

    converged: bool
    status: str
    objective: float | None
    iterations: int
    solve_time_s: float
    time_s: list[float]
    com_m: list[Position]


class PlanPreview(Contract):
    """Response of ``POST /plans/preview``; ``took_s`` is the total processor time, including validation.

    ``errors`` are those of ``POST /scenarios/check``; with errors, the motion is empty. With a push, ``recovered`` is
    the motion after its end; null if the motion itself has no solution.
    """

    solver: str
    duration_s: float
    took_s: float
    errors: list[FaultItem]
    motion: PreviewMotion
    recovered: PreviewMotion | None = None


class SolverFacts(Contract):
    """A solver of the centroidal problem; ``missing`` is the reason if it is not available, else null."""

    name: str
    available: bool
    missing: str | None = None


class Solvers(Contract):
    """Response of ``GET /solvers``; ``auto`` is the solver that is preferred if it supports the options."""

    auto: str
    solvers: list[SolverFacts]


LinkPoses = Annotated[
    list[tuple[float, float, float, float, float, float, float]],
    Field(description="pose of every link: position x, y, z in metres, then a quaternion w, x, y, z"),
]


class PartialPlan(Contract):
    """The centroidal plan is solved; poses of later parts are in the order of ``links``."""

    kind: Literal["plan"] = "plan"
    robot: str
    links: list[str]
    duration_s: float
    phase_ends_s: list[float]


class PartialMotion(Contract):
    """Frames of the whole body; those of a new ``run`` replace all of the run before."""

    kind: Literal["motion"] = "motion"
    run: Annotated[int, Field(ge=1)]
    time_s: list[float]
    poses: list[LinkPoses]


class PartialCertificate(Contract):
    """Checks of the certificate, each sent once; ``passed`` is null until all are there."""

    kind: Literal["certificate"] = "certificate"
    checks: list[CertificateCheck]
    passed: bool | None = None


class PartialReplay(Contract):
    """Frames of the replay in physics."""

    kind: Literal["replay"] = "replay"
    time_s: list[float]
    poses: list[LinkPoses]


PartialChunk = Annotated[PartialPlan | PartialMotion | PartialCertificate | PartialReplay, Field(discriminator="kind")]
"""A part of a result that is still being computed."""


class PartialResults(Contract):
    """``GET /jobs/{id}/partial``: parts in the order in which they were computed.

    A new ``attempt`` begins anew: parts of an earlier one have to be dropped.
    """

    job_id: str
    state: JobState
    attempt: int
    chunks: list[PartialChunk]
    next: str = Field(description="cursor of the parts that follow, for `after`")
