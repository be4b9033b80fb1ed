"""What of the contract's ``plan-motion`` this version has, and the sentence for the rest."""

from typing import Final

from stridelab.errors import Fault, NotEstimable
from stridelab.schemas.plans import PlanMotionInput

SOLVERS: Final = ("auto", "casadi", "ipopt", "fatrop")


def require_plan(request: PlanMotionInput) -> None:
    """Raise ``NotEstimable`` for what is not there.

    Codes are ``solver-unavailable`` and ``free-durations-unavailable``.
    """
    if request.solver not in SOLVERS:
        raise NotEstimable(
            "solver-unavailable",
            f"This version has no solver {request.solver!r}; it has: {', '.join(SOLVERS)}.",
            [Fault("solver", f"{request.solver} is not available")],
        )
    if request.free_durations:
        raise NotEstimable(
            "free-durations-unavailable",
            "This version plans with the durations that the scenario gives.",
            [Fault("free_durations", "not available")],
        )
