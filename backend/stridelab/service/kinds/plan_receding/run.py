"""``plan-receding``: executes a scenario with receding-horizon replanning, optionally with pushes.

Writes ``receding`` (Parquet and CSV), one row per period: the CoM and the cost of the replan; and the executed motion
in the columns of a plan, ``centroidal`` with ``scenario.json``, for viewers of plans.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from stridelab.centroidal.receding_horizon import Disturbance, RecedingHorizon, RecedingMotion, Replan, State
from stridelab.centroidal.rest_to_rest import from_rest_to_rest
from stridelab.contacts.sequence import ContactSequence
from stridelab.pipelines.plan_problem import CONTROLS, load_densities, resolve_formulation, validate_scenario
from stridelab.pipelines.progress import ProgressCallback
from stridelab.reachability.store import DEFAULT_MEASURE
from stridelab.robots.card import robot_card
from stridelab.robots.loader import load_robot
from stridelab.schemas.base import Remark
from stridelab.schemas.receding import PlanRecedingSummary, Push
from stridelab.schemas.tasks import PlanRecedingTask
from stridelab.service.kinds.base import Json, Outcome
from stridelab.service.kinds.plan_motion.files import write_json
from stridelab.service.kinds.plan_motion.tables import Columns, track_columns
from stridelab.service.kinds.result_tables import write_table

REFERENCES: Final = ("carpentier2017thesis",)
SOLVER_REFERENCES: Final[Mapping[str, tuple[str, ...]]] = {
    "native": (),
    "ipopt": ("andersson2019casadi", "wachter2006ipopt"),
}
PERIOD_TOLERANCE: Final = 1e-9
REPLANS_FAILED: Final = "replans-failed"


def run_in_child(task: Json, folder: Path, progress: ProgressCallback) -> Json:
    """``run`` with JSON on both sides."""
    return run(PlanRecedingTask.model_validate(task), folder, progress).to_json()


def run(task: PlanRecedingTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Execute the scenario and write the result to ``folder``; the summary is a ``PlanRecedingSummary``.

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
    about = {"scenario": sequence.name, "robot": robot.name, "horizon_s": request.horizon_s}
    files = (
        *write_table(folder, "receding", period_columns(done), about),
        *write_table(folder, "centroidal", executed_columns(sequence, done), about),
        write_json(folder, "scenario.json", task.scenario),
    )
    progress(1.0, "done")
    references = (*REFERENCES, *SOLVER_REFERENCES[solver], *robot_card(robot.name).references)
    return Outcome(summary.model_dump(mode="json"), references, files)


def push_disturbance(pushes: list[Push], period_s: float) -> Disturbance:
    """Disturbance that adds the pushes of the period that ends at a time; a period includes its first instant."""

    def apply_pushes(time_s: float, state: State) -> State:
        period = round(time_s / period_s)
        due = [
            push.velocity_m_s for push in pushes if math.floor(push.time_s / period_s + PERIOD_TOLERANCE) + 1 == period
        ]
        return replace(state, com_v_m_s=state.com_v_m_s + np.sum([*due, (0.0, 0.0, 0.0)], axis=0))

    return apply_pushes


AFTER_NODE_S = 1e-9
"""Offset after a node at which the values of the following interval are read."""


def period_columns(execution: RecedingMotion) -> Columns:
    """One row per period and one for the end, which has no replan (NaN)."""
    replans = execution.replans
    columns: Columns = {"time_s": execution.time_s}
    columns |= track_columns("com_{}_m", execution.com_m)
    columns |= track_columns("com_v{}_m_s", execution.com_v_m_s)
    columns |= track_columns("l_{}_nms", execution.l_nms)
    columns["replan_ms"] = np.array([*(1e3 * replan.took_s for replan in replans), np.nan])
    columns["iterations"] = np.array([*(float(replan.iterations) for replan in replans), np.nan])
    columns["carried_on"] = np.array([*(float(replan.carried_on) for replan in replans), np.nan])
    return columns


def executed_columns(sequence: ContactSequence, execution: RecedingMotion) -> Columns:
    """Columns of ``centroidal``: for every period the values of its plan at the nodes of that plan.

    A row is valid until the next one, as in ``plan-motion``; the first row of a period includes its push.
    """
    moments = list(_row_times(execution))
    read = [(at_s + AFTER_NODE_S, replan.plan) for at_s, _, replan in moments]
    times_s = np.array([time_s for _, time_s, _ in moments])
    states = [plan.reference_at(at_s) for at_s, plan in read]
    forces_at_rows = [plan.forces_at(at_s) for at_s, plan in read]
    phases = [sequence.phase_at(time_s + AFTER_NODE_S) for time_s in times_s]
    columns: Columns = {"time_s": times_s, "phase": np.array(phases)}
    columns |= track_columns("com_{}_m", np.array([state.com_m for state in states]))
    columns |= track_columns("com_v{}_m_s", np.array([state.com_v_m_s for state in states]))
    columns |= track_columns("com_a{}_m_s2", np.array([state.com_a_m_s2 for state in states]))
    columns |= track_columns("l_{}_nms", np.array([state.l_nms for state in states]))
    points = {name: len(points_m) for _, plan in read for name, points_m in plan.points_m.items()}
    for effector in sequence.effectors:
        for k in range(points.get(effector, 0)):
            none = np.zeros((points[effector], 3))
            forces = np.array([forces.get(effector, none)[k] for forces in forces_at_rows])
            columns |= track_columns(f"f_{effector}_{k}_{{}}_n", forces)
    for effector in sequence.effectors:
        contacts = [sequence.phases[phase].contacts.get(effector) for phase in phases]
        columns[f"friction_{effector}"] = np.array([contact.friction if contact else 0.0 for contact in contacts])
    return columns


def _row_times(execution: RecedingMotion) -> Iterator[tuple[float, float, Replan]]:
    """Start of every row: its time in the plan, its time in the motion, and the replan that it belongs to."""
    for replan, end_s in zip(execution.replans, [*execution.time_s[1:]], strict=True):
        shift_s = replan.time_s - replan.since_s
        nodes_s = replan.plan.time_s + shift_s
        within = (nodes_s > replan.time_s + AFTER_NODE_S) & (nodes_s < end_s - AFTER_NODE_S)
        for time_s in (replan.time_s, *nodes_s[within].tolist()):
            yield time_s - shift_s, time_s, replan
    yield float(execution.time_s[-1]) - shift_s, float(execution.time_s[-1]), replan
