"""What a body can follow, as linear limits of a motion: (4.20) leaves it to its cost and its densities.

    low - r <= R^T (c - p) <= high + r       within the reach of every effector that touches (``reach_box``)
    |L_c| / m <= SPIN + l                    hardly spinning; L_c = K - m c x c' by its tangent at given states
    |F_z - 1| <= PUSH                        not jumping while a sole touches
    f_n <= GRIP + q at points                not vaulting on a hand

and the problem's own bounds on heights and normal forces. ``r`` and ``q`` of every phase and contact and ``l`` of every
phase may give way.
"""

import numpy as np
import scipy.sparse as sp

from stridelab.centroidal.dynamics import DOWN, N_STATE, skew
from stridelab.centroidal.infeasibility.lp_constraints import Blocks, Rows, States, Vector
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.reach_box import reach_box
from stridelab.conventions import GRAVITY_M_S2

SPIN_M2_S = 0.15
"""Angular momentum per mass that arms and trunk can take up for a while: 14 Nms for TALOS, who needs 6 to stride."""
PUSH = 0.25
"""Share of the weight by which soles push more or less than it."""
GRIP = 0.3
"""Share of the weight that a point effector carries at most, three times what the arm of TALOS bears."""


def straight(programme: Rows, problem: CentroidalProblem) -> States:
    """States at rest on a straight line to the goal: the first ones at which tangents are taken."""
    share = programme.grid.time_s / programme.grid.time_s[-1]
    return np.hstack([np.outer(share, problem.com_end_m - problem.com_start_m), np.zeros((len(share), 6))])


def bodily(programme: Rows, problem: CentroidalProblem, about: States) -> tuple[sp.csc_matrix, Vector]:
    """``G (w, s, r, q, l) <= h``: boxes, heights and spins at every node, pushes and grips in every interval.

    ``about`` are the states at which the tangent of ``c x c'`` is taken.
    """
    n, phases = len(programme.lower), problem.sequence.phases
    where = [(i, name) for i, phase in enumerate(phases) for name in phase.contacts]
    boxes = {name: reach_box(proxy.mixture) for name, proxy in problem.proxies.items()}
    G, h, row = Blocks(), list[Vector](), 0
    for j, (i, name) in enumerate(where):
        if name not in boxes:
            continue
        contact, heading_rad = problem.contact(name, i), float(problem.sequence.headings_rad[i])
        frame = problem.proxies[name].placement(contact.placement, heading_rad)
        at = frame.rotation.T @ (problem.com_start_m - frame.position_m)
        both = np.vstack([frame.rotation.T, -frame.rotation.T])
        room = np.concatenate([boxes[name].high_m - at, at - boxes[name].low_m])
        for k in _nodes(programme, i):
            G.add(row, N_STATE * k, both)
            G.add(row, n + len(where) + j, -np.ones((6, 1)))
            h.append(room)
            row += 6
    for j, (i, name) in enumerate(where):
        least, most = window_m(problem, i)
        if problem.effectors[name].kind == "surface" and np.isfinite(most):
            for k in _nodes(programme, i):
                G.add(row, N_STATE * k + 2, np.array([[1.0], [-1.0]]))
                G.add(row, n + len(where) + j, -np.ones((2, 1)))
                h.append(np.array([most, -least]))
                row += 2
    for i in range(len(phases)):
        for k in _nodes(programme, i):
            c, v = about[k, 0:3], about[k, 3:6]
            spin = np.hstack([skew(v), -skew(c), GRAVITY_M_S2 * np.eye(3)])  # of (c, c', K): K - c x v' - c' x v
            G.add(row, N_STATE * k, np.vstack([spin, -spin]))
            G.add(row, n + 3 * len(where) + i, -np.ones((6, 1)))
            fixed = np.cross(c, v)
            h.append(SPIN_M2_S - np.concatenate([fixed, -fixed]))
            row += 6
    limits = G.matrix(row, n + 3 * len(where) + len(phases))
    stand = [any(problem.effectors[name].kind == "surface" for name in phase.contacts) for phase in phases]
    vertical = pushes(programme, problem)[0][2::3][np.array(stand)[programme.grid.phase]]
    vertical = sp.hstack([vertical, sp.csc_matrix((vertical.shape[0], 2 * len(where) + len(phases)))])
    one, grips = np.ones(vertical.shape[0]), Blocks()
    held_on = [at for at in programme.first if np.isfinite(carries(problem, at[1]))]
    for k, at in enumerate(held_on):
        i = int(programme.grid.phase[at[0]])
        grips.add(k, programme.first[at], np.ones((1, programme.wrenches[i, at[1]].shape[1])))
        grips.add(k, n + 2 * len(where) + where.index((i, at[1])), -np.ones((1, 1)))
    h += [(1.0 + PUSH) * one, (PUSH - 1.0) * one, np.array([carries(problem, at[1]) for at in held_on])]
    hands = grips.matrix(len(held_on), limits.shape[1])
    return sp.vstack([limits, vertical, -vertical, hands], format="csc"), np.concatenate(h)


def carries(problem: CentroidalProblem, effector: str) -> float:
    """The share of the weight that an effector carries at most, by its bound or, where it is a point, ``GRIP``."""
    bound_n = problem.bounds.normal_force_max_n.get(effector, np.inf) * len(problem.points_m(effector))
    usual = GRIP if problem.effectors[effector].kind == "point" else np.inf
    return float(min(usual, bound_n / problem.weight_n))


def window_m(problem: CentroidalProblem, phase: int) -> tuple[float, float]:
    """Between which heights above the start the CoM is to be, by the problem's bounds."""
    if problem.bounds.com_height_m is None:
        return -np.inf, np.inf
    least, most = problem.bounds.com_height_m
    soles = [
        contact.placement.position_m[2]
        for name in problem.sequence.effectors
        if problem.effectors[name].kind == "surface"
        and (contact := problem.sequence.last_contact(name, phase)) is not None
    ]
    ground = float(np.mean(soles)) - problem.com_start_m[2] if soles else np.nan
    return (ground + least, ground + most) if soles else (-np.inf, np.inf)


def pushes(programme: Rows, problem: CentroidalProblem) -> tuple[sp.csc_matrix, Vector]:
    """``F`` of every interval as rows on ``(w, s)``, and the weight that it is compared with."""
    n, last = len(programme.lower), len(programme.grid.step_s) - 1
    where = [(i, name) for i, phase in enumerate(problem.sequence.phases) for name in phase.contacts]
    F, column = Blocks(), {at: n + j for j, at in enumerate(where)}
    for k, i in enumerate(programme.grid.phase.tolist()):
        for name in problem.sequence.phases[i].contacts:
            W = programme.wrenches[i, name][:3]
            F.add(3 * k, programme.first[k, name], W)
            F.add(3 * k, column[i, name], -W.sum(axis=1)[:, None])
    return F.matrix(3 * (last + 1), n + len(where)), np.tile(-DOWN, last + 1)


def _nodes(programme: Rows, phase: int) -> range:
    """Nodes of a phase, both ends included."""
    intervals = np.flatnonzero(programme.grid.phase == phase)
    return range(int(intervals[0]), int(intervals[-1]) + 2)
