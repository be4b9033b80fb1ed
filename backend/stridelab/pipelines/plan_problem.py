"""Durations that ``plan-motion`` leaves to the solver: within what bounds, and the scenario as it was then planned.

Options of ``plan-motion`` in the planner's own terms: the control, the solver and its limits.

From a scenario of the contract to the problem of a robot: the judge, the robot, its densities.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import Final, Literal

from stridelab.centroidal.contact_wrench import ContactWrench
from stridelab.centroidal.control import Control
from stridelab.centroidal.free_variables import FreeDurations
from stridelab.centroidal.native.availability import Missing, availability
from stridelab.centroidal.nlp.callbacks import Iterate, Tell
from stridelab.centroidal.nlp.solvers import DEFAULT_LIMITS, TIME_IS_UP, Limits
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.point_forces import PYRAMIDS, CircularCones
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.sequence import ContactSequence
from stridelab.contacts.validation.parse import DURATION_S
from stridelab.contacts.validation.validate import judge, outline
from stridelab.errors import Fault, InvalidInput, NotEstimable
from stridelab.pipelines.progress import ProgressCallback
from stridelab.reachability.card import Measure
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.reachability.store import load_card, load_proxies, require_same_robot
from stridelab.robots.robot import Robot
from stridelab.schemas.base import Remark
from stridelab.schemas.plans import Formulation, PhaseDuration, PlanMotionInput
from stridelab.schemas.scenarios import Scenario
from stridelab.schemas.sweeps import SweepInput


def freedom(request: PlanMotionInput, sequence: ContactSequence) -> FreeDurations | None:
    """The bounds that were asked for, tightened so that the outcome is a lawful scenario; None for given durations."""
    if not request.free_durations:
        return None
    least, most = request.duration_range
    durations_s = [phase.duration_s for phase in sequence.phases]
    return FreeDurations(
        shortest=min(1.0, max(least, DURATION_S[0] / min(durations_s))),
        longest=max(1.0, min(most, DURATION_S[1] / max(durations_s))),
    )


def as_planned(scenario: Scenario, sequence: ContactSequence) -> Scenario:
    """The scenario with the durations of the sequence that was planned."""
    phases = [
        phase.model_copy(update={"duration_s": planned.duration_s})
        for phase, planned in zip(scenario.phases, sequence.phases, strict=True)
    ]
    return scenario.model_copy(update={"phases": phases})


def phase_durations(given: ContactSequence, planned: ContactSequence) -> list[PhaseDuration]:
    """Every phase's duration as the scenario gives it, and as it was chosen."""
    return [
        PhaseDuration(given_s=asked.duration_s, chosen_s=found.duration_s)
        for asked, found in zip(given.phases, planned.phases, strict=True)
    ]


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


def checked(scenario: Scenario) -> tuple[ContactSequence, tuple[Remark, ...]]:
    """The contact sequence, and what is worth knowing of it.

    Raises ``InvalidInput`` (``scenario-invalid``), naming phase and effector, and ``NotFound`` (``robot-not-found``).
    """
    report, sequence = judge(scenario.model_dump(mode="json"), effector_shapes(scenario.robot))
    if sequence is None:
        raise _invalid(report.faults)
    return sequence, tuple(Remark(code=r.code, message=r.message) for r in report.remarks)


def outlined(scenario: Scenario) -> ContactSequence:
    """``checked`` without the remarks, and without asking where the CoM can rest, for whoever waits."""
    faults, sequence = outline(scenario.model_dump(mode="json"), effector_shapes(scenario.robot))
    if sequence is None:
        raise _invalid(faults)
    return sequence


def _invalid(faults: Sequence[Fault]) -> InvalidInput:
    more = f" and {len(faults) - 1} more" if len(faults) > 1 else ""
    message = f"The robot cannot do this: {faults[0].where}: {faults[0].message}{more}."
    return InvalidInput("scenario-invalid", message, faults)


def densities(robot: Robot, measure: Measure) -> Mapping[str, Proxy]:
    """The learned densities, which must be those of this very robot.

    Raises ``Unavailable`` (``reachability-of-another-robot``).
    """
    require_same_robot(load_card(robot.name, measure), robot)
    return load_proxies(robot.name, measure)
