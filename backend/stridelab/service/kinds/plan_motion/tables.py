"""Tables of ``plan-motion``: the centroidal plan, its solver iterations, and the whole-body motion."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from stridelab.centroidal.nlp.kkt import Attempt
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.contacts.sequence import ContactSequence
from stridelab.conventions import Series
from stridelab.service.kinds.result_tables import track_columns
from stridelab.wholebody.motion import WholeBodyMotion

if TYPE_CHECKING:
    from stridelab.wholebody.replay.replay import Replay

Columns = dict[str, Series | Int[np.ndarray, "n"]]
_SAME_INSTANT_S = 1e-9


def centroidal_columns(plan: CentroidalPlan) -> Columns:
    """Columns of ``centroidal``, one row per node.

    Values that are constant over an interval (phase; acceleration and forces, unless they are splines) are in the row
    of the node at which the interval begins; the last node repeats the last interval. Forces, and
    ``friction_<effector>``, the coefficient of the surface, are zero where an effector has no contact.
    """
    columns: Columns = {"time_s": plan.time_s, "phase": _repeat_last(plan.phase)}
    columns |= track_columns("com_{}_m", plan.com_m)
    columns |= track_columns("com_v{}_m_s", plan.com_v_m_s)
    columns |= track_columns("com_a{}_m_s2", np.array([plan.reference_at(float(t)).com_a_m_s2 for t in plan.time_s]))
    columns |= track_columns("l_{}_nms", plan.l_nms)
    at_nodes = [plan.forces_at(float(t)) for t in plan.time_s]
    for effector, points_m in plan.points_m.items():
        for k in range(len(points_m)):
            columns |= track_columns(f"f_{effector}_{k}_{{}}_n", np.array([forces[effector][k] for forces in at_nodes]))
    for effector in plan.forces_n:
        columns[f"friction_{effector}"] = _repeat_last(_interval_friction(plan, effector))
    return columns


def iteration_columns(attempts: Iterable[Attempt]) -> Columns:
    """Columns of ``iterations``, one row per iteration, the start first; no rows for an attempt without a log.

    ``cost_s`` is (4.20a) with regularisers; infeasibilities and barrier parameter are the solver's own measures.
    """
    logs = [attempt.log for attempt in attempts]
    counts = [len(log.objective) for log in logs]
    return {
        "attempt": np.repeat(np.arange(len(logs)), counts),
        "iteration": np.concatenate([np.arange(0), *(np.arange(count) for count in counts)]),
        "cost_s": np.concatenate([[], *(log.objective for log in logs)]),
        "primal_infeasibility": np.concatenate([[], *(log.primal for log in logs)]),
        "dual_infeasibility": np.concatenate([[], *(log.dual for log in logs)]),
        "barrier": np.concatenate([[], *(log.barrier for log in logs)]),
    }


def motion_columns(motion: WholeBodyMotion, torque_limits_nm: Float[np.ndarray, "na"]) -> Columns:
    """Columns of ``motion``, one row per sample: CoM and angular momentum of the motion and of the plan.

    ``com_error_m`` is the distance between the two CoM, ``f_<effector>_x_n`` the effector's total force,
    ``torque_ratio`` the largest ``|tau| / limit`` of all joints.
    """
    columns: Columns = {"time_s": motion.time_s, "phase": phase_indices(motion.sequence, motion.time_s)}
    columns |= track_columns("com_{}_m", motion.com_m)
    columns |= track_columns("com_reference_{}_m", motion.com_reference_m)
    columns["com_error_m"] = np.linalg.norm(motion.com_m - motion.com_reference_m, axis=1)
    columns |= track_columns("com_v{}_m_s", motion.com_v_m_s)
    columns |= track_columns("l_{}_nms", motion.l_nms)
    columns |= track_columns("l_reference_{}_nms", motion.l_reference_nms)
    for effector, forces in motion.forces_n.items():
        columns |= track_columns(f"f_{effector}_{{}}_n", forces.sum(axis=1))
    columns["torque_ratio"] = (np.abs(motion.tau_nm) / torque_limits_nm).max(axis=1)
    return columns


def replay_columns(replay: "Replay") -> Columns:
    """Columns of ``replay``, one row per sample: the simulated CoM and ``f_<effector>_x_n``, the measured force."""
    columns: Columns = {"time_s": replay.time_s}
    columns |= track_columns("com_{}_m", replay.com_m)
    for effector, force in replay.forces_n.items():
        columns |= track_columns(f"f_{effector}_{{}}_n", force)
    return columns


def phase_indices(sequence: ContactSequence, time_s: Series) -> Int[np.ndarray, "n"]:
    """Contact phase at every instant; a boundary belongs to the phase that begins there."""
    index = np.searchsorted(sequence.ends_s, time_s + _SAME_INSTANT_S, side="right")
    return np.minimum(index, len(sequence.phases) - 1)


def _interval_friction(plan: CentroidalPlan, effector: str) -> Series:
    """Friction coefficient of an effector's contact per interval; 0 without contact."""
    of_phase = [
        phase.contacts[effector].friction if effector in phase.contacts else 0.0 for phase in plan.sequence.phases
    ]
    return np.asarray(np.array(of_phase)[plan.phase])


def _repeat_last(per_interval: np.ndarray) -> np.ndarray:
    return np.concatenate([per_interval, per_interval[-1:]])
