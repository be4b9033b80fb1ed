"""``plan-receding``: executes a scenario with receding-horizon replanning, optionally with pushes.

Writes ``receding`` (Parquet and CSV), one row per period: the CoM and the cost of the replan; and the executed motion
in the columns of a plan, ``centroidal`` with ``scenario.json``, for viewers of plans.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from stridelab.centroidal.receding_horizon import RecedingMotion, Replan
from stridelab.contacts.sequence import ContactSequence
from stridelab.pipelines.plan_receding import plan_receding
from stridelab.pipelines.progress import ProgressCallback
from stridelab.schemas.receding import PlanRecedingTask
from stridelab.service.kinds.base import Outcome
from stridelab.service.kinds.plan_motion.files import write_json
from stridelab.service.kinds.plan_motion.tables import Columns
from stridelab.service.kinds.result_tables import track_columns, write_table


def run(task: PlanRecedingTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Execute the scenario and write the result to ``folder``; the summary is a ``PlanRecedingSummary``.

    Raises as ``stridelab.pipelines.plan_receding.plan_receding`` does.
    """
    result = plan_receding(task, progress)
    sequence, motion, summary = result.sequence, result.motion, result.summary
    about = {"scenario": sequence.name, "robot": summary.robot, "horizon_s": task.input.horizon_s}
    files = (
        *write_table(folder, "receding", period_columns(motion), about),
        *write_table(folder, "centroidal", executed_columns(sequence, motion), about),
        write_json(folder, "scenario.json", task.scenario),
    )
    progress(1.0, "done")
    return Outcome(summary.model_dump(mode="json"), result.citation_keys, files)


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
    phases = sequence.phases_at(times_s + AFTER_NODE_S)
    columns: Columns = {"time_s": times_s, "phase": phases}
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
