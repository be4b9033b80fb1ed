"""Body limits: linear constraints on a motion for what (4.20) leaves to its cost and its densities.

    low - r <= R^T (c - p) <= high + r       CoM within the reach box of every effector in contact (``reach_box``)
    |L_c| / m <= SPIN + l                    bounded angular momentum; L_c = K - m c x c' linearised at given states
    |F_z - 1| <= PUSH                        no jumping while a sole is in contact
    f_n <= GRIP + q at points                no vaulting on a hand

and the problem's own bounds on heights and normal forces. The slacks ``r`` and ``q`` are per phase and contact, ``l``
per phase.
"""

from itertools import product

import numpy as np
import scipy.sparse as sp

from stridelab.centroidal.contact_wrench import DOWN, N_STATE, skew
from stridelab.centroidal.infeasibility.lp_constraints import LinearConstraints, SparseBlocks, States, Vector
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.reach_box import reach_box
from stridelab.conventions import GRAVITY_M_S2

MAX_SPIN_M2_S = 0.15
"""Angular momentum per mass that arms and trunk can absorb briefly: 14 Nms for TALOS, which needs 6 to stride."""
MAX_PUSH_SHARE = 0.25
"""Largest deviation of the vertical force from the weight, as a share of the weight."""
MAX_HAND_LOAD_SHARE = 0.3
"""Largest share of the weight on a point effector: three times what the arm of TALOS carries."""


def straight_line_states(lp: LinearConstraints, problem: CentroidalProblem) -> States:
    """States at rest on a straight line to the goal: the first linearisation points."""
    share = lp.grid.time_s / lp.grid.time_s[-1]
    return np.hstack([np.outer(share, problem.com_end_m - problem.com_start_m), np.zeros((len(share), 6))])


def body_limit_rows(lp: LinearConstraints, problem: CentroidalProblem, about: States) -> tuple[sp.csc_matrix, Vector]:
    """``G (w, s, r, q, l) <= h``: boxes, heights and momenta at every node, vertical and hand forces per interval.

    ``about`` are the states at which ``c x c'`` is linearised.
    """
    n, phases = len(lp.lower), problem.sequence.phases
    contacts = [(i, name) for i, phase in enumerate(phases) for name in phase.contacts]
    boxes = {name: reach_box(proxy.mixture) for name, proxy in problem.proxies.items()}
    G, h, row = SparseBlocks(), list[Vector](), 0
    heights_m = problem.com_height_windows_m(lp.grid)
    for j, (i, name) in enumerate(contacts):
        if name not in boxes:
            continue
        contact, heading_rad = problem.contact(name, i), float(problem.sequence.headings_rad[i])
        frame = problem.proxies[name].frame_placement(contact.placement, heading_rad)
        com_m = frame.rotation.T @ (problem.com_start_m - frame.position_m)
        axes = np.vstack([frame.rotation.T, -frame.rotation.T])
        distances = np.concatenate([boxes[name].high_m - com_m, com_m - boxes[name].low_m])
        for k in _phase_nodes(lp, i):
            G.add_block(row, N_STATE * k, axes)
            G.add_block(row, n + len(contacts) + j, -np.ones((6, 1)))
            h.append(distances)
            row += 6
    for j, (i, name) in enumerate(contacts):
        nodes = _phase_nodes(lp, i)
        if problem.effectors[name].kind != "surface":
            continue
        for k, (sign, side) in product(nodes, ((1.0, 1), (-1.0, 0))):
            height_m = heights_m[min(k, nodes[-2]), side]  # the last node is the end of the phase's last interval
            if np.isfinite(height_m):
                G.add_block(row, N_STATE * k + 2, np.array([[sign]]))
                G.add_block(row, n + len(contacts) + j, -np.ones((1, 1)))
                h.append(np.array([sign * height_m]))
                row += 1
    for i in range(len(phases)):
        for k in _phase_nodes(lp, i):
            c, v = about[k, 0:3], about[k, 3:6]
            spin = np.hstack([skew(v), -skew(c), GRAVITY_M_S2 * np.eye(3)])  # of (c, c', K): K - c x v' - c' x v
            G.add_block(row, N_STATE * k, np.vstack([spin, -spin]))
            G.add_block(row, n + 3 * len(contacts) + i, -np.ones((6, 1)))
            fixed = np.cross(c, v)
            h.append(MAX_SPIN_M2_S - np.concatenate([fixed, -fixed]))
            row += 6
    limits = G.matrix(row, n + 3 * len(contacts) + len(phases))
    stand = [any(problem.effectors[name].kind == "surface" for name in phase.contacts) for phase in phases]
    vertical = contact_force_rows(lp, problem)[0][2::3][np.array(stand)[lp.grid.phase]]
    vertical = sp.hstack([vertical, sp.csc_matrix((vertical.shape[0], 2 * len(contacts) + len(phases)))])
    ones, grips = np.ones(vertical.shape[0]), SparseBlocks()
    bounded_hands = [com_m for com_m in lp.first if np.isfinite(max_load_share(problem, com_m[1]))]
    for k, com_m in enumerate(bounded_hands):
        i = int(lp.grid.phase[com_m[0]])
        grips.add_block(k, lp.first[com_m], np.ones((1, lp.wrenches[i, com_m[1]].shape[1])))
        grips.add_block(k, n + 2 * len(contacts) + contacts.index((i, com_m[1])), -np.ones((1, 1)))
    h += [
        (1.0 + MAX_PUSH_SHARE) * ones,
        (MAX_PUSH_SHARE - 1.0) * ones,
        np.array([max_load_share(problem, com_m[1]) for com_m in bounded_hands]),
    ]
    hands = grips.matrix(len(bounded_hands), limits.shape[1])
    return sp.vstack([limits, vertical, -vertical, hands], format="csc"), np.concatenate(h)


def max_load_share(problem: CentroidalProblem, effector: str) -> float:
    """Largest share of the weight on an effector: its bound and, for points, ``MAX_HAND_LOAD_SHARE``."""
    bound_n = problem.bounds.normal_force_max_n.get(effector, np.inf) * len(problem.points_m(effector))
    usual = MAX_HAND_LOAD_SHARE if problem.effectors[effector].kind == "point" else np.inf
    return float(min(usual, bound_n / problem.weight_n))


def contact_force_rows(lp: LinearConstraints, problem: CentroidalProblem) -> tuple[sp.csc_matrix, Vector]:
    """``F`` of every interval as rows on ``(w, s)``, and its reference, the weight."""
    n, last = len(lp.lower), len(lp.grid.step_s) - 1
    where = [(i, name) for i, phase in enumerate(problem.sequence.phases) for name in phase.contacts]
    F, column = SparseBlocks(), {at: n + j for j, at in enumerate(where)}
    for k, i in enumerate(lp.grid.phase.tolist()):
        for name in problem.sequence.phases[i].contacts:
            W = lp.wrenches[i, name][:3]
            F.add_block(3 * k, lp.first[k, name], W)
            F.add_block(3 * k, column[i, name], -W.sum(axis=1)[:, None])
    return F.matrix(3 * (last + 1), n + len(where)), np.tile(-DOWN, last + 1)


def _phase_nodes(lp: LinearConstraints, phase: int) -> range:
    """Nodes of a phase, both ends included."""
    intervals = np.flatnonzero(lp.grid.phase == phase)
    return range(int(intervals[0]), int(intervals[-1]) + 2)
