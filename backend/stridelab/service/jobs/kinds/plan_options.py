"""Options of ``plan-motion`` in the planner's own terms: the control, the solver and its limits."""

from collections.abc import Mapping
from typing import Final, Literal

from stridelab.centroidal.contact_wrench import ContactWrench
from stridelab.centroidal.control import Control
from stridelab.centroidal.iterates import Iterate, Tell
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.point_forces import PYRAMIDS, CircularCones
from stridelab.centroidal.solvers import DEFAULT_LIMITS, TIME_IS_UP, Limits
from stridelab.errors import Fault, NotEstimable
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
    """The solver to ask: "casadi" has both. Under a time limit "auto" is ipopt alone: fatrop only guesses at it."""
    if request.solver in ("ipopt", "fatrop"):
        return request.solver
    return "auto" if request.time_limit_s is None else "ipopt"


def limits_of(request: PlanMotionInput) -> Limits:
    """When the solver gives up."""
    return DEFAULT_LIMITS if request.time_limit_s is None else Limits(DEFAULT_LIMITS.iterations, request.time_limit_s)


def require_time(request: PlanMotionInput, plan: CentroidalPlan) -> None:
    """Raise ``NotEstimable`` ("plan-time-limit") where a time that was asked for ended the solver."""
    last = plan.solution.attempts[-1] if plan.solution is not None else None
    if request.time_limit_s is None or last is None or TIME_IS_UP not in last.status:
        return
    raise NotEstimable(
        "plan-time-limit",
        f"{last.solver} had no motion after the {request.time_limit_s:g} s that it was given ({last.iterations} "
        "iterations). Give it more time, or fewer nodes per second.",
        [Fault("time_limit_s", f"{request.time_limit_s:g} s were not enough")],
    )


def iterations_to(tell: ProgressCallback) -> Tell:
    """What a solver calls after each iteration; nobody knows how many there will be."""

    def on(at: Iterate) -> None:
        tell(
            at.number / (at.number + USUAL_ITERATIONS),
            f"iteration {at.number}, cost {at.objective:.4g}, infeasibility {at.infeasibility:.1e}",
        )

    return on
