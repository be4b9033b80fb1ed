"""Warm start of the C++ solver for one problem from the plan of another, as ``centroidal.warm_start`` for CasADi.

Intervals take the forces of the plan's interval at the same time, for the effectors that are in contact in both;
other effectors get an equal share of the weight. Momenta are about the CoM at the start, which is shifted between the
problems:  K' = L_c / (m g) + c' x v / g.

The iterate is moved to the central path: forces are blended with equal shares of the weight, so that they lie inside
their cones, and multipliers are those of the barrier, ``z = mu u^-1``.
"""

from typing import Final

import numpy as np
from jaxtyping import Float, Int

from stridelab.centroidal.force_splines import INNER
from stridelab.centroidal.native.problem_arrays import POINTS_PER_BLOCK, native_input, wrench_cone
from stridelab.centroidal.nlp.kkt import NativePoint
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.verification import motion_of, wrenches_of
from stridelab.conventions import GRAVITY_M_S2

PLAN_FORCE_WEIGHT: Final = 0.95
"""Weight of the plan's forces in the blend with equal shares."""
BARRIER: Final = 3e-3
"""Barrier parameter mu of a warm start."""


def native_start(plan: CentroidalPlan, problem: CentroidalProblem, after_s: float = 0.0) -> NativePoint:
    """Warm start of ``problem``, whose time 0 is ``after_s`` of the plan."""
    grid, inner = problem.grid(), INNER[problem.shape]
    control_times_s = np.interp(
        np.arange(inner * len(grid.phase) + 1) / inner, np.arange(len(grid.time_s)), grid.time_s
    )
    x = np.empty((len(control_times_s), 9))
    for k, at_s in enumerate((control_times_s + after_s).tolist()):
        state = plan.reference_at(at_s)
        c = state.com_m - problem.com_start_m
        v = state.com_v_m_s if at_s <= plan.time_s[-1] else np.zeros(3)
        x[k] = np.concatenate([c, v, state.l_nms / problem.weight_n + np.cross(c, v) / GRAVITY_M_S2])
    middle_s = 0.5 * (grid.time_s[:-1] + grid.time_s[1:]) + after_s
    plan_interval = np.clip(np.searchsorted(plan.time_s, middle_s, side="right") - 1, 0, len(plan.phase) - 1)
    flat = native_input(problem) if inner > 1 else None  # splines have control points without forces
    u, wrenches = [], []
    for i in range(len(problem.sequence.phases)):
        intervals = plan_interval[grid.phase == i]
        patches = problem.contact_patches(i, problem.com_start_m)
        G = wrench_cone(problem, i)
        if G is not None:
            wrenches.append(_interior_controls(G, _planned_wrenches(plan, intervals, problem)))
        if not problem.control.has_point_forces:
            continue
        share = 1.0 / sum(len(t.points_m) for t in patches)
        blocks = []
        for t in patches:
            planned = (
                _planned_control_points(plan, t.effector, intervals, inner) / problem.weight_n @ t.rotation
                if t.effector in plan.forces_n
                else None
            )
            for first in range(0, len(t.points_m), POINTS_PER_BLOCK):
                n = len(t.points_m[first : first + POINTS_PER_BLOCK])
                block = np.tile(np.array([0.0, 0.0, share]), (inner * len(intervals), POINTS_PER_BLOCK, 1))
                if planned is not None:
                    local = planned[:, first : first + n] / np.array([t.friction, t.friction, 1.0])
                    block[:, :n] = PLAN_FORCE_WEIGHT * local + (1.0 - PLAN_FORCE_WEIGHT) * block[:, :n]
                blocks.append(block)
        phase_forces = np.stack(blocks, axis=1) if blocks else np.zeros((0, 0, POINTS_PER_BLOCK, 3))
        u.append(
            phase_forces.reshape(-1, POINTS_PER_BLOCK, 3) if flat is None else phase_forces[flat.active_controls(i)]
        )
    forces = np.ascontiguousarray(np.concatenate(u)) if u else np.zeros((0, POINTS_PER_BLOCK, 3))
    wrench_controls = np.concatenate(wrenches) if wrenches else np.zeros((0, 6))
    step_s = grid.step_s[np.searchsorted(grid.phase, np.arange(len(problem.sequence.phases)))]
    return NativePoint(
        x, forces, _barrier_multipliers(forces), wrench_controls, _barrier_multipliers(wrench_controls), step_s / inner
    )


def _planned_control_points(
    plan: CentroidalPlan, effector: str, intervals: Int[np.ndarray, "n"], inner: int
) -> Float[np.ndarray, "controls k 3"]:
    """Forces (N) of an effector in a plan's intervals; for splines at their two free control points."""
    if inner > 1 and plan.curves_n:
        curves = plan.curves_n[effector][intervals, 1:-1]
        return np.asarray(curves.reshape(-1, *curves.shape[2:]))
    return np.asarray(np.repeat(plan.forces_n[effector][intervals], inner, axis=0))


def _planned_wrenches(
    plan: CentroidalPlan, intervals: Int[np.ndarray, "n"], problem: CentroidalProblem
) -> Float[np.ndarray, "n 6"]:
    """(F, T) of a plan's intervals about another problem's origin, in its units."""
    F, M = (about[intervals, 0] for about in wrenches_of(plan.sequence, motion_of(plan)))
    return np.asarray(np.hstack([F, M - np.cross(problem.com_start_m, F)]) / problem.weight_n)


def _interior_controls(G: Float[np.ndarray, "6 6"], wrenches: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "n 6"]:
    """Controls u of wrenches blended with the weight; the weight alone where the blend is outside the cone."""
    upright = np.eye(6)[-1]
    u = PLAN_FORCE_WEIGHT * np.linalg.lstsq(G, wrenches.T, rcond=None)[0].T + (1.0 - PLAN_FORCE_WEIGHT) * upright
    inside = np.linalg.norm(u[:, :-1], axis=1) < u[:, -1]
    return np.asarray(np.where(inside[:, None], u, upright))


def _barrier_multipliers(u: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
    """``mu u^-1 = mu (-tau, eta) / (eta^2 - |tau|^2)``."""
    det = u[..., -1:] ** 2 - (u[..., :-1] ** 2).sum(axis=-1, keepdims=True)
    turned = np.concatenate([-u[..., :-1], u[..., -1:]], axis=-1)
    return np.asarray(BARRIER * turned / det)
