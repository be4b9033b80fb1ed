"""Tables of ``plan-receding``: a row per period, and the motion that was carried out in the columns of a plan."""

from collections.abc import Iterator

import numpy as np

from stridelab.centroidal.horizon import Receding, Replan
from stridelab.contacts.sequence import ContactSequence
from stridelab.service.jobs.kinds.plan_tables import Columns, track_columns

AFTER_S = 1e-9
"""What holds from a node on is read so much after it."""


def period_columns(done: Receding) -> Columns:
    """One row per moment; the last one is the end, to which no replan belongs (NaN)."""
    replans = done.replans
    found: Columns = {"time_s": done.time_s}
    found |= track_columns("com_{}_m", done.com_m)
    found |= track_columns("com_v{}_m_s", done.com_v_m_s)
    found |= track_columns("l_{}_nms", done.l_nms)
    found["replan_ms"] = np.array([*(1e3 * replan.took_s for replan in replans), np.nan])
    found["iterations"] = np.array([*(float(replan.iterations) for replan in replans), np.nan])
    found["carried_on"] = np.array([*(float(replan.carried_on) for replan in replans), np.nan])
    return found


def carried_out_columns(sequence: ContactSequence, done: Receding) -> Columns:
    """Columns of ``centroidal``: of every period what its plan had for it, at the nodes of that plan.

    A row holds until the next one, as in ``plan-motion``; where a period begins with a push, so does its first row.
    """
    moments = list(_moments(done))
    read = [(at_s + AFTER_S, replan.plan) for at_s, _, replan in moments]
    times_s = np.array([time_s for _, time_s, _ in moments])
    states = [plan.at(at_s) for at_s, plan in read]
    held = [plan.forces_at(at_s) for at_s, plan in read]
    phases = [sequence.phase_at(time_s + AFTER_S) for time_s in times_s]
    found: Columns = {"time_s": times_s, "phase": np.array(phases)}
    found |= track_columns("com_{}_m", np.array([state.com_m for state in states]))
    found |= track_columns("com_v{}_m_s", np.array([state.com_v_m_s for state in states]))
    found |= track_columns("com_a{}_m_s2", np.array([state.com_a_m_s2 for state in states]))
    found |= track_columns("l_{}_nms", np.array([state.l_nms for state in states]))
    points = {name: len(points_m) for _, plan in read for name, points_m in plan.points_m.items()}
    for effector in sequence.effectors:
        for k in range(points.get(effector, 0)):
            none = np.zeros((points[effector], 3))
            forces = np.array([forces.get(effector, none)[k] for forces in held])
            found |= track_columns(f"f_{effector}_{k}_{{}}_n", forces)
    for effector in sequence.effectors:
        contacts = [sequence.phases[phase].contacts.get(effector) for phase in phases]
        found[f"friction_{effector}"] = np.array([contact.friction if contact else 0.0 for contact in contacts])
    return found


def _moments(done: Receding) -> Iterator[tuple[float, float, Replan]]:
    """When a row begins: in the time of the plan that holds from there, in that of the motion, and whose plan it is."""
    for replan, end_s in zip(done.replans, [*done.time_s[1:]], strict=True):
        shift_s = replan.time_s - replan.since_s
        nodes_s = replan.plan.time_s + shift_s
        within = (nodes_s > replan.time_s + AFTER_S) & (nodes_s < end_s - AFTER_S)
        for time_s in (replan.time_s, *nodes_s[within].tolist()):
            yield time_s - shift_s, time_s, replan
    yield float(done.time_s[-1]) - shift_s, float(done.time_s[-1]), replan
