"""From a scenario to its motion with receding-horizon replanning, optionally with pushes."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stridelab.centroidal.receding_horizon import Disturbance, RecedingHorizon, RecedingMotion, State
from stridelab.centroidal.rest_to_rest import from_rest_to_rest
from stridelab.contacts.sequence import ContactSequence
from stridelab.pipelines.plan_problem import CONTROLS, load_densities, resolve_formulation, validate_scenario
from stridelab.pipelines.progress import ProgressCallback
from stridelab.reachability.store import DEFAULT_MEASURE
from stridelab.robots.card import robot_card
from stridelab.robots.loader import load_robot
from stridelab.schemas.base import Remark
from stridelab.schemas.receding import PlanRecedingSummary, PlanRecedingTask, Push

REFERENCES: Final = ("carpentier2017thesis",)
SOLVER_REFERENCES: Final[Mapping[str, tuple[str, ...]]] = {
    "native": (),
    "ipopt": ("andersson2019casadi", "wachter2006ipopt"),
}
PERIOD_TOLERANCE: Final = 1e-9
REPLANS_FAILED: Final = "replans-failed"


@dataclass(frozen=True)
class RecedingResult:
    """The executed motion, the contacts that it follows, and the summary of the contract."""

    sequence: ContactSequence
    motion: RecedingMotion
    summary: PlanRecedingSummary

    @property
    def citation_keys(self) -> tuple[str, ...]:
        """Citation keys of the method, the solver and the robot."""
        solver, robot = SOLVER_REFERENCES[self.summary.solver or "native"], robot_card(self.summary.robot).references
        return (*REFERENCES, *solver, *robot)


def plan_receding(task: PlanRecedingTask, progress: ProgressCallback) -> RecedingResult:
    """Execute ``task.scenario`` with a receding horizon.

    Raises ``InvalidInput`` (``scenario-invalid``, ``horizon-invalid``), ``NotFound`` (``robot-not-found``),
    ``Unavailable`` (``reachability-of-another-robot``) and ``NotEstimable`` (``horizon-lost``).
    """
    request = task.input
    progress(0.0, "looking at the scenario")
    sequence, noted = validate_scenario(task.scenario)
    robot = load_robot(sequence.robot)
    posed = from_rest_to_rest(robot, sequence, load_densities(robot, request.measure or DEFAULT_MEASURE))
    problem = replace(
        posed, control=CONTROLS[resolve_formulation(request.formulation)], node_rate_hz=request.node_rate_hz
    )
    horizon = RecedingHorizon(
        problem=problem, horizon_s=request.horizon_s, period_s=request.period_s, warm=request.warm
    )
    total_s = sequence.duration_s

    def report_and_push(time_s: float, state: State) -> State:
        progress(0.99 * min(time_s / total_s, 1.0), f"{min(time_s, total_s):.1f} of {total_s:.1f} s")
        return push_disturbance(request.pushes, request.period_s)(time_s, state)

    done = horizon.run(report_and_push)
    took_ms = 1e3 * np.array([replan.took_s for replan in done.replans])
    iterations = np.array([replan.iterations for replan in done.replans])
    (solver,) = {replan.plan.solver for replan in done.replans}
    carried_on = sum(replan.carried_on for replan in done.replans)
    if carried_on:
        message = f"in {carried_on} of {len(took_ms)} periods the replan had no solution; the previous plan was used"
        noted = (*noted, Remark(code=REPLANS_FAILED, message=message))
    summary = PlanRecedingSummary(
        scenario_name=sequence.name,
        robot=robot.name,
        duration_s=total_s,
        solver=solver,
        replans=len(done.replans),
        carried_on=carried_on,
        iterations_median=float(np.median(iterations)),
        iterations_max=int(iterations.max()),
        replan_median_ms=float(np.median(took_ms)),
        replan_p99_ms=float(np.quantile(took_ms, 0.99)),
        replan_max_ms=float(took_ms.max()),
        goal_gap_m=float(np.linalg.norm(done.com_m[-1] - problem.com_end_m)),
        warnings=list(noted),
    )
    return RecedingResult(sequence, done, summary)


def push_disturbance(pushes: list[Push], period_s: float) -> Disturbance:
    """Disturbance that adds the pushes of the period that ends at a time; a period includes its first instant."""

    def apply_pushes(time_s: float, state: State) -> State:
        period = round(time_s / period_s)
        due = [
            push.velocity_m_s for push in pushes if math.floor(push.time_s / period_s + PERIOD_TOLERANCE) + 1 == period
        ]
        return replace(state, com_v_m_s=state.com_v_m_s + np.sum([*due, (0.0, 0.0, 0.0)], axis=0))

    return apply_pushes
