"""Options of ``plan-motion`` in the planner's own terms: the control, the solver and its limits."""

from collections.abc import Mapping
from typing import Final, Literal

from stridelab.centroidal.contact_wrench import ContactWrench
from stridelab.centroidal.control import Control
from stridelab.centroidal.point_forces import PYRAMIDS, CircularCones
from stridelab.centroidal.solvers import DEFAULT_LIMITS, Limits, Tell
from stridelab.schemas.plans import PlanMotionInput
from stridelab.service.jobs.kinds.kind import ProgressCallback

CONTROLS: Final[Mapping[str, Control]] = {
    "forces": PYRAMIDS,
    "circular-cones": CircularCones(),
    "wrench": ContactWrench(),
}
"""By the names of ``formulation``."""
USUAL_ITERATIONS: Final = 20.0
"""Half of the bar, which never comes to its end before the solver does."""


def solver_of(request: PlanMotionInput) -> Literal["auto", "ipopt", "fatrop"]:
    """The solver to ask: "casadi" has both. Under a time limit, which fatrop has not, "auto" is ipopt alone."""
    if request.solver in ("ipopt", "fatrop"):
        return request.solver
    return "auto" if request.time_limit_s is None else "ipopt"


def limits_of(request: PlanMotionInput) -> Limits:
    """When the solver gives up."""
    return DEFAULT_LIMITS if request.time_limit_s is None else Limits(DEFAULT_LIMITS.iterations, request.time_limit_s)


def iterations_to(tell: ProgressCallback) -> Tell:
    """What a solver calls after each iteration; nobody knows how many there will be."""

    def on(iteration: int, objective: float) -> None:
        tell(iteration / (iteration + USUAL_ITERATIONS), f"iteration {iteration}, cost {objective:.4g}")

    return on
