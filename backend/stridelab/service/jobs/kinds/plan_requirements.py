"""What of the contract's ``plan-motion`` this version has, and the sentence for the rest."""

from stridelab.errors import Fault, NotEstimable
from stridelab.schemas.plans import PlanMotionInput
from stridelab.service.jobs.kinds.plan_options import require_solver


def require_plan(request: PlanMotionInput) -> None:
    """Raise ``NotEstimable`` for what is not there.

    Codes are ``solver-unavailable`` and ``free-durations-unavailable``.
    """
    require_solver(request.solver)
    if request.free_durations:
        raise NotEstimable(
            "free-durations-unavailable",
            "This version plans with the durations that the scenario gives.",
            [Fault("free_durations", "not available")],
        )
