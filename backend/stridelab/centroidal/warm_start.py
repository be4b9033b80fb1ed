"""Warm start of one problem from the plan of another: the next horizon, other durations, a finer grid.

Each interval of the new problem takes the variables and multipliers of the plan's interval at the same time (or at the
same share of the phase, if the numbers of phases agree), provided that the same groups of u act in both. Nodes take
the plan's state, after its end the last one. Everything else keeps the initial guess. The origin is the CoM at the
start; if it is shifted by D,

    c' = c - D,   K' = L_c / (m g) + c' x v / g,   T' = T - D x F,

and multipliers change such that the sum of rows times multipliers is preserved: those of the velocity by
``lambda_K x D / g``, those of F by ``lambda_T x D``.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from stridelab.centroidal.contact_wrench import N_STATE, N_WRENCH
from stridelab.centroidal.native.warm_start import native_start
from stridelab.centroidal.nlp.kkt import NativePoint, Point
from stridelab.centroidal.nlp.transcription import Transcription, transcribe
from stridelab.centroidal.nlp.variable_layout import Layout, Use, create_layout, n_cones, n_limits
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.conventions import GRAVITY_M_S2, Series
from stridelab.errors import InvalidInput


def warm_start_point(plan: CentroidalPlan, problem: CentroidalProblem, after_s: float = 0.0) -> Point | NativePoint:
    """Warm start of ``problem``, whose time 0 is ``after_s`` of the plan; phases may differ, the robot may not.

    The point is for the plan's kind of solver (C++ or CasADi). Raises ``InvalidInput`` (``plan-without-solution``) for
    a plan that was loaded from a file.
    """
    if plan.solution is None:
        raise InvalidInput("plan-without-solution", "The plan has no solver solution to start from.")
    point = plan.solution.point
    if isinstance(point, NativePoint):
        return native_start(plan, problem, after_s)
    transcription = transcribe(problem)
    old, new = create_layout(point.structure), transcription.layout
    D = problem.com_start_m - plan.com_m[0]
    w, lambda_w, lambda_g = transcription.guess.copy(), np.zeros(new.n), np.zeros(new.n_rows)
    w[new.state[:, None] + np.arange(N_STATE)] = _plan_states(plan, transcription, after_s)
    for k, i in _matching_intervals(plan, transcription, old, after_s):
        for to, from_ in zip(new.uses_in[k], old.uses_in[i], strict=True):
            new_columns, old_columns = (
                slice(to.start, to.start + to.group.size),
                slice(from_.start, from_.start + from_.group.size),
            )
            w[new_columns], lambda_w[new_columns] = point.w[old_columns], point.lambda_w[old_columns]
            lambda_g[_cone_and_limit_rows(to)] = point.lambda_g[_cone_and_limit_rows(from_)]
        for to, from_ in zip(new.wrench[k], old.wrench[i], strict=True):
            F, T = point.w[from_ + np.arange(N_WRENCH)].reshape(2, 3)
            w[to + np.arange(N_WRENCH)] = np.append(F, T - np.cross(D, F))
        lambda_c, lambda_v, lambda_K = point.lambda_g[old.gap[i] + np.arange(N_STATE)].reshape(3, 3)
        lambda_v = lambda_v + np.cross(lambda_K, D) / GRAVITY_M_S2
        lambda_g[new.gap[k] + np.arange(N_STATE)] = np.concatenate([lambda_c, lambda_v, lambda_K])
        for to, from_ in zip(new.tie[k], old.tie[i], strict=True):
            lambda_F, lambda_T = point.lambda_g[from_ + np.arange(N_WRENCH)].reshape(2, 3)
            lambda_g[to + np.arange(N_WRENCH)] = np.append(lambda_F + np.cross(lambda_T, D), lambda_T)
    if point.structure.n_shifts == transcription.compiled.structure.n_shifts:
        old_shifts, new_shifts = (layout.shifts[:, None] + np.arange(2) for layout in (old, new))
        w[new_shifts], lambda_w[new_shifts] = point.w[old_shifts], point.lambda_w[old_shifts]
    return Point(transcription.compiled.structure, w, lambda_w, lambda_g)


def _plan_states(plan: CentroidalPlan, transcription: Transcription, after_s: float) -> Float[np.ndarray, "nodes 9"]:
    problem, states = transcription.problem, []
    for at_s in _plan_time(transcription.grid.time_s, plan, transcription, after_s):
        reference = plan.reference_at(float(at_s))
        c = reference.com_m - problem.com_start_m
        v = reference.com_v_m_s if at_s <= plan.time_s[-1] else np.zeros(3)
        states.append(np.concatenate([c, v, reference.l_nms / problem.weight_n + np.cross(c, v) / GRAVITY_M_S2]))
    return np.array(states)


def _plan_time(time_s: Series, plan: CentroidalPlan, transcription: Transcription, after_s: float) -> Series:
    """Plan time at the same share of the same phase; with ``after_s`` or other phases, at the same absolute time."""
    new, old = transcription.problem.sequence, plan.sequence
    if after_s or len(new.phases) != len(old.phases):
        return time_s + after_s
    return np.asarray(np.interp(time_s, np.append(0.0, new.ends_s), np.append(0.0, old.ends_s)))


def _matching_intervals(
    plan: CentroidalPlan, transcription: Transcription, old: Layout, after_s: float
) -> Iterator[tuple[int, int]]:
    """Pairs of intervals of the new problem and of the plan, at the same time and with the same groups of u."""
    grid = transcription.grid
    if old.wrench.shape[1] != transcription.layout.wrench.shape[1]:
        return
    middle_s = 0.5 * (grid.time_s[:-1] + grid.time_s[1:])
    plan_intervals = np.searchsorted(plan.time_s, _plan_time(middle_s, plan, transcription, after_s), side="right") - 1
    for k, i in enumerate(plan_intervals.tolist()):
        if 0 <= i < len(plan.phase):
            new_uses, old_uses = transcription.layout.uses_in[k], old.uses_in[i]
            if [_group_signature(use) for use in new_uses] == [_group_signature(use) for use in old_uses]:
                yield k, i


def _group_signature(use: Use) -> tuple[str, int, int, int, bool]:
    return use.group.name, use.inner, use.group.size, use.group.lorentz, use.group.limited


def _cone_and_limit_rows(use: Use) -> slice:
    return slice(use.row, use.row + n_cones(use.group) + n_limits(use.group))
