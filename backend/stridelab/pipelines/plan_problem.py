"""Translation of a ``plan-motion`` request to the planner's terms.

Covers the bounds of free phase durations, control parametrisation, solver and its limits, validation of the scenario
and the reachability densities of the robot.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import Final, Literal

from stridelab.centroidal.contact_wrench import ContactWrench
from stridelab.centroidal.control import Control
from stridelab.centroidal.free_variables import FreeDurations
from stridelab.centroidal.native.availability import NativeUnavailable, native_availability
from stridelab.centroidal.nlp.callbacks import Iterate, IterationCallback
from stridelab.centroidal.nlp.solvers import DEFAULT_LIMITS, TIME_LIMIT_STATUS, Limits
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.point_forces import PYRAMIDS, CircularCones
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.sequence import ContactSequence
from stridelab.contacts.validation.parse import DURATION_S
from stridelab.contacts.validation.validate import validate_and_build, validate_quickly
from stridelab.errors import Fault, InvalidInput, NotEstimable
from stridelab.pipelines.progress import ProgressCallback
from stridelab.reachability.card import Measure
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.reachability.store import load_card, load_proxies, require_same_robot
from stridelab.robots.robot import Robot
from stridelab.schemas.base import Remark
from stridelab.schemas.methods import Formulation
from stridelab.schemas.plans import PhaseDuration, PlanMotionInput
from stridelab.schemas.scenarios import Scenario
from stridelab.schemas.sweeps import SweepInput


def free_durations(request: PlanMotionInput, sequence: ContactSequence) -> FreeDurations | None:
    """The requested bounds, tightened so that the planned scenario remains valid; None for fixed durations."""
    if not request.free_durations:
        return None
    least, most = request.duration_range
    durations_s = [phase.duration_s for phase in sequence.phases]
    return FreeDurations(
        shortest=min(1.0, max(least, DURATION_S[0] / min(durations_s))),
        longest=max(1.0, min(most, DURATION_S[1] / max(durations_s))),
        fixed_total=request.price_per_s is None,
        price_per_s=request.price_per_s or 0.0,
    )


def with_planned_durations(scenario: Scenario, sequence: ContactSequence) -> Scenario:
    """The scenario with the durations of the planned sequence."""
    phases = [
        phase.model_copy(update={"duration_s": planned.duration_s})
        for phase, planned in zip(scenario.phases, sequence.phases, strict=True)
    ]
    return scenario.model_copy(update={"phases": phases})


def phase_durations(given: ContactSequence, planned: ContactSequence) -> list[PhaseDuration]:
    """Duration of every phase as given by the scenario and as planned."""
    return [
        PhaseDuration(given_s=given_phase.duration_s, chosen_s=planned_phase.duration_s)
        for given_phase, planned_phase in zip(given.phases, planned.phases, strict=True)
    ]


CONTROLS: Final[Mapping[str, Control]] = {
    "forces": PYRAMIDS,
    "circular-cones": CircularCones(),
    "wrench": ContactWrench(),
}
"""Control parametrisations by the names of ``formulation``."""
HALF_PROGRESS_ITERATIONS: Final = 20.0
"""Iterations at half progress; the progress approaches 1 asymptotically."""


def native_unavailable_reason() -> str | None:
    """The reason why the C++ solver is unavailable, as a sentence; None if it is available."""
    state = native_availability()
    return state.reason[:1].upper() + state.reason[1:] if isinstance(state, NativeUnavailable) else None


def resolve_formulation(formulation: Formulation) -> Formulation:
    """Replace ``forces`` (linearised pyramids) by circular cones if the C++ solver, which supports them, is present."""
    return "circular-cones" if formulation == "forces" and native_unavailable_reason() is None else formulation


def formulation_of(request: PlanMotionInput | SweepInput) -> Formulation:
    """The formulation to use; the requested one (pyramids for ``forces``) if a CasADi solver is requested."""
    return resolve_formulation(request.formulation) if request.solver in ("auto", "native") else request.formulation


def control_of(request: PlanMotionInput | SweepInput) -> Control:
    """Control parametrisation of ``formulation_of``."""
    return CONTROLS[formulation_of(request)]


def solver_of(request: PlanMotionInput | SweepInput) -> Literal["auto", "native", "casadi", "ipopt", "fatrop"]:
    """The solver to use: "auto" tries the C++ solver first if available; "casadi" never uses it.

    With a time limit only ipopt is used among CasADi's solvers, because fatrop does not enforce one exactly.
    """
    if request.solver in ("native", "ipopt", "fatrop"):
        return request.solver
    limited = isinstance(request, PlanMotionInput) and request.time_limit_s is not None
    if request.solver == "auto" and native_unavailable_reason() is None:
        return "auto"
    return "ipopt" if limited else "casadi"


def limits_of(request: PlanMotionInput | SweepInput) -> Limits:
    """Iteration and time limits of the solver."""
    cpu_s = request.time_limit_s if isinstance(request, PlanMotionInput) else None
    return DEFAULT_LIMITS if cpu_s is None else Limits(DEFAULT_LIMITS.iterations, cpu_s)


def native_unused_reason(requested: str, solvers_used: Collection[str], unsupported_feature: str | None) -> str | None:
    """Reason why the C++ solver was not used, as a sentence; None if it was."""
    if set(solvers_used) == {"native"}:
        return None
    if requested not in ("auto", "native"):
        return f"{requested} was requested."
    missing = native_unavailable_reason()
    if missing is not None:
        return missing
    if unsupported_feature is not None:
        return f"The C++ solver does not support {unsupported_feature}."
    return "The C++ solver did not solve every problem; CasADi was used for the others."


def require_solver(name: str) -> None:
    """Raise ``NotEstimable`` (``solver-unavailable``) if the C++ solver is requested and unavailable."""
    missing = native_unavailable_reason() if name == "native" else None
    if missing is not None:
        raise NotEstimable("solver-unavailable", missing, [Fault("solver", "native is not available")])


def require_durations(request: PlanMotionInput) -> None:
    """Raise ``NotEstimable`` (``solver-unavailable``) for free durations that need the unavailable C++ solver."""
    missing = (
        native_unavailable_reason() if request.free_durations and request.formulation == "circular-cones" else None
    )
    if missing is not None:
        raise NotEstimable(
            "solver-unavailable",
            "Only the C++ solver optimises phase durations with circular cones. "
            f"{missing} Use the formulation forces or wrench.",
            [Fault("free_durations", "not with circular-cones without the C++ solver")],
        )


def require_time(request: PlanMotionInput, plan: CentroidalPlan) -> None:
    """Raise ``NotEstimable`` (``plan-time-limit``) if the requested time limit stopped the solver."""
    last = plan.solution.attempts[-1] if plan.solution is not None else None
    if request.time_limit_s is None or last is None or TIME_LIMIT_STATUS not in last.status:
        return
    raise NotEstimable(
        "plan-time-limit",
        f"{last.solver} did not converge within the time limit of {request.time_limit_s:g} s ({last.iterations} "
        "iterations). Increase the limit, or use fewer nodes per second.",
        [Fault("time_limit_s", f"{request.time_limit_s:g} s were not enough")],
    )


def iteration_callback(tell: ProgressCallback) -> IterationCallback:
    """Iteration callback of a solver that reports to ``tell``; the number of iterations is not known in advance."""

    def report_iteration(iterate: Iterate) -> None:
        tell(
            iterate.number / (iterate.number + HALF_PROGRESS_ITERATIONS),
            f"iteration {iterate.number}, cost {iterate.objective:.4g}, infeasibility {iterate.infeasibility:.1e}",
        )

    return report_iteration


def validate_scenario(scenario: Scenario) -> tuple[ContactSequence, tuple[Remark, ...]]:
    """Validate a scenario; returns its contact sequence and the remarks of the validation.

    Raises ``InvalidInput`` (``scenario-invalid``), naming phase and effector, and ``NotFound`` (``robot-not-found``).
    """
    report, sequence = validate_and_build(scenario.model_dump(mode="json"), effector_shapes(scenario.robot))
    if sequence is None:
        raise _scenario_invalid(report.faults)
    return sequence, tuple(Remark(code=r.code, message=r.message) for r in report.remarks)


def contact_sequence_of(scenario: Scenario) -> ContactSequence:
    """Faster variant of ``validate_scenario`` without remarks and without the static equilibrium of each phase."""
    faults, sequence = validate_quickly(scenario.model_dump(mode="json"), effector_shapes(scenario.robot))
    if sequence is None:
        raise _scenario_invalid(faults)
    return sequence


def _scenario_invalid(faults: Sequence[Fault]) -> InvalidInput:
    more = f" and {len(faults) - 1} more" if len(faults) > 1 else ""
    message = f"The robot cannot do this: {faults[0].where}: {faults[0].message}{more}."
    return InvalidInput("scenario-invalid", message, faults)


def load_densities(robot: Robot, measure: Measure) -> Mapping[str, Proxy]:
    """The learned reachability densities of this robot.

    Raises ``Unavailable`` (``reachability-of-another-robot``).
    """
    require_same_robot(load_card(robot.name, measure), robot)
    return load_proxies(robot.name, measure)
