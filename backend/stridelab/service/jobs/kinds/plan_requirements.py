"""What of the contract's ``plan-motion`` this version has, and the sentence for the rest."""

from typing import Final

from stridelab.errors import Fault, NotEstimable
from stridelab.schemas.plans import PlanMotionInput

SOLVERS: Final = ("auto", "casadi", "ipopt", "fatrop")


def require_plan(request: PlanMotionInput) -> None:
    """Raise ``NotEstimable`` (``solver-unavailable``) for what is not there."""
    if request.solver not in SOLVERS:
        raise NotEstimable(
            "solver-unavailable",
            f"This version has no solver {request.solver!r}; it has: {', '.join(SOLVERS)}.",
            [Fault("solver", f"{request.solver} is not available")],
        )
