"""Options of ``plan-motion`` in the planner's own terms: the control, the solver and its limits."""

from collections.abc import Collection, Mapping
from typing import Final, Literal

from stridelab.centroidal.contact_wrench import ContactWrench
from stridelab.centroidal.control import Control
from stridelab.centroidal.iterates import Iterate, Tell
from stridelab.centroidal.native import Missing, availability
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.point_forces import PYRAMIDS, CircularCones
from stridelab.centroidal.solvers import DEFAULT_LIMITS, TIME_IS_UP, Limits
from stridelab.errors import Fault, NotEstimable
from stridelab.schemas.plans import Formulation, PlanMotionInput
from stridelab.schemas.sweeps import SweepInput
from stridelab.service.jobs.kinds.kind import ProgressCallback

CONTROLS: Final[Mapping[str, Control]] = {
    "forces": PYRAMIDS,
    "circular-cones": CircularCones(),
    "wrench": ContactWrench(),
}
"""By the names of ``formulation``."""
USUAL_ITERATIONS: Final = 20.0
"""Half of the bar, which never comes to its end before the solver does."""


def native_missing() -> str | None:
    """Why the C++ solver is not there, as a sentence; None where it is."""
    found = availability()
    return found.reason[:1].upper() + found.reason[1:] if isinstance(found, Missing) else None


def taken(formulation: Formulation) -> Formulation:
    """Where the C++ solver is there, which has the cones as they are, ``forces`` do without CasADi's pyramids."""
    return "circular-cones" if formulation == "forces" and native_missing() is None else formulation


def formulation_of(request: PlanMotionInput | SweepInput) -> Formulation:
    """The control that is taken, pyramids wherever one of CasADi's solvers is to serve."""
    return taken(request.formulation) if request.solver in ("auto", "native") else request.formulation


def control_of(request: PlanMotionInput | SweepInput) -> Control:
    """``formulation_of`` in the planner's own terms."""
    return CONTROLS[formulation_of(request)]


def solver_of(request: PlanMotionInput | SweepInput) -> Literal["auto", "native", "casadi", "ipopt", "fatrop"]:
    """The solver to ask: "auto" the C++ one first where it is there, "casadi" never.

    Under a time limit, at which fatrop only guesses, CasADi's is ipopt alone.
    """
    if request.solver in ("native", "ipopt", "fatrop"):
        return request.solver
    limited = isinstance(request, PlanMotionInput) and request.time_limit_s is not None
    if request.solver == "auto" and native_missing() is None:
        return "auto"
    return "ipopt" if limited else "casadi"


def limits_of(request: PlanMotionInput | SweepInput) -> Limits:
    """When the solver gives up."""
    cpu_s = request.time_limit_s if isinstance(request, PlanMotionInput) else None
    return DEFAULT_LIMITS if cpu_s is None else Limits(DEFAULT_LIMITS.iterations, cpu_s)


def because(asked: str, served: Collection[str], lacked: str | None) -> str | None:
    """Why the C++ solver did not serve, as a sentence; None where it did. ``lacked``: what it does not do of it."""
    if set(served) == {"native"}:
        return None
    if asked not in ("auto", "native"):
        return f"{asked} was asked for."
    missing = native_missing()
    if missing is not None:
        return missing
    if lacked is not None:
        return f"The C++ solver does not do {lacked}."
    return "The C++ solver did not find every motion; CasADi was asked then."


def require_solver(name: str) -> None:
    """Raise ``NotEstimable`` (``solver-unavailable``) where the C++ solver is asked for and is not there."""
    missing = native_missing() if name == "native" else None
    if missing is not None:
        raise NotEstimable("solver-unavailable", missing, [Fault("solver", "native is not available")])


def require_durations(request: PlanMotionInput) -> None:
    """Raise ``NotEstimable`` (``solver-unavailable``) for durations that only the missing C++ solver could choose."""
    missing = native_missing() if request.free_durations and request.formulation == "circular-cones" else None
    if missing is not None:
        raise NotEstimable(
            "solver-unavailable",
            f"Durations are chosen in circular cones by the C++ solver alone. {missing} Ask for forces or wrench.",
            [Fault("free_durations", "not with circular-cones without the C++ solver")],
        )


def require_time(request: PlanMotionInput, plan: CentroidalPlan) -> None:
    """Raise ``NotEstimable`` (``plan-time-limit``) where a time that was asked for ended the solver."""
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
