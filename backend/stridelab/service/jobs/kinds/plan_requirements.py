"""What of the contract's ``plan-motion`` this version has, and the sentence for the rest."""

from typing import Final

from stridelab.errors import Fault, NotEstimable
from stridelab.schemas.plans import PlanMotionInput

SOLVERS: Final = ("auto", "casadi")
FORMULATIONS: Final = ("forces",)


def require_plan(request: PlanMotionInput) -> None:
    """Raise ``NotEstimable`` for what is not there.

    Codes are ``formulation-unavailable``, ``solver-unavailable`` and ``free-durations-unavailable``.
    """
    _require("formulation", request.formulation, FORMULATIONS, "formulation of the contact forces")
    _require("solver", request.solver, SOLVERS, "solver")
    if request.free_durations:
        raise NotEstimable(
            "free-durations-unavailable",
            "This version plans with the durations that the scenario gives.",
            [Fault("free_durations", "not available")],
        )


def _require(field: str, value: str, available: tuple[str, ...], what: str) -> None:
    if value not in available:
        raise NotEstimable(
            f"{field}-unavailable",
            f"This version has no {what} {value!r}; it has: {', '.join(available)}.",
            [Fault(field, f"{value} is not available")],
        )
