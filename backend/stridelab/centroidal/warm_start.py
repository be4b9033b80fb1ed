"""A start for one problem from the plan of another: the next horizon, other durations, a finer grid.

Interval by interval the new problem takes the variables and multipliers of the plan's interval at the same time, where
the same groups of u act in both (of the same share of its phase, where there are as many phases); nodes take the plan's
state, after its end the last one; what has no counterpart keeps the cold guess. The programme's origin is the CoM at
the start; where it moves by D,

    c' = c - D,   K' = L_c / (m g) + c' x v / g,   T' = T - D x F,

and multipliers follow so that the sum of rows times multipliers stays: those of the velocity gain ``lambda_K x D / g``,
those of F gain ``lambda_T x D``.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from stridelab.centroidal.dynamics import N_STATE, N_WRENCH
from stridelab.centroidal.native.warm_start import native_start
from stridelab.centroidal.nlp.kkt import NativePoint, Point
from stridelab.centroidal.nlp.transcription import Transcription, transcribe
from stridelab.centroidal.nlp.variable_layout import Layout, Use, lay_out, n_cones, n_limits
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.conventions import GRAVITY_M_S2, Series
from stridelab.errors import InvalidInput


def carried(plan: CentroidalPlan, onto: CentroidalProblem, after_s: float = 0.0) -> Point | NativePoint:
    """The start of ``onto``, whose time 0 is ``after_s`` of the plan; phases may be other ones, the robot not.

    It is for the solvers of the plan's kind.

    Raises ``InvalidInput`` (``plan-without-solution``) for a plan that was not solved but read.
    """
    if plan.solution is None:
        raise InvalidInput("plan-without-solution", "This plan does not tell at which point its solver stopped.")
    point = plan.solution.point
    if isinstance(point, NativePoint):
        return native_start(plan, onto, after_s)
    programme = transcribe(onto)
    old, new = lay_out(point.structure), programme.layout
    D = onto.com_start_m - plan.com_m[0]
    w, lambda_w, lambda_g = programme.guess.copy(), np.zeros(new.n), np.zeros(new.n_rows)
    w[new.state[:, None] + np.arange(N_STATE)] = _states(plan, programme, after_s)
    for k, i in _counterparts(plan, programme, old, after_s):
        for at, of in zip(new.uses_in[k], old.uses_in[i], strict=True):
            here, there = slice(at.start, at.start + at.group.size), slice(of.start, of.start + of.group.size)
            w[here], lambda_w[here] = point.w[there], point.lambda_w[there]
            lambda_g[_rows(at)] = point.lambda_g[_rows(of)]
        for at, of in zip(new.wrench[k], old.wrench[i], strict=True):
            F, T = point.w[of + np.arange(N_WRENCH)].reshape(2, 3)
            w[at + np.arange(N_WRENCH)] = np.append(F, T - np.cross(D, F))
        of_c, of_v, of_K = point.lambda_g[old.gap[i] + np.arange(N_STATE)].reshape(3, 3)
        of_v = of_v + np.cross(of_K, D) / GRAVITY_M_S2
        lambda_g[new.gap[k] + np.arange(N_STATE)] = np.concatenate([of_c, of_v, of_K])
        for at, of in zip(new.tie[k], old.tie[i], strict=True):
            of_F, of_T = point.lambda_g[of + np.arange(N_WRENCH)].reshape(2, 3)
            lambda_g[at + np.arange(N_WRENCH)] = np.append(of_F + np.cross(of_T, D), of_T)
    if point.structure.n_shifts == programme.compiled.structure.n_shifts:
        moved, move = (layout.shifts[:, None] + np.arange(2) for layout in (old, new))
        w[move], lambda_w[move] = point.w[moved], point.lambda_w[moved]
    return Point(programme.compiled.structure, w, lambda_w, lambda_g)


def _states(plan: CentroidalPlan, programme: Transcription, after_s: float) -> Float[np.ndarray, "nodes 9"]:
    problem, found = programme.problem, []
    for at_s in _in_the_plan(programme.grid.time_s, plan, programme, after_s):
        there = plan.at(float(at_s))
        c = there.com_m - problem.com_start_m
        v = there.com_v_m_s if at_s <= plan.time_s[-1] else np.zeros(3)
        found.append(np.concatenate([c, v, there.l_nms / problem.weight_n + np.cross(c, v) / GRAVITY_M_S2]))
    return np.array(found)


def _in_the_plan(time_s: Series, plan: CentroidalPlan, programme: Transcription, after_s: float) -> Series:
    """The plan's time at the same share of the same phase; after a while, or with other phases, by the same clock."""
    ours, theirs = programme.problem.sequence, plan.sequence
    if after_s or len(ours.phases) != len(theirs.phases):
        return time_s + after_s
    return np.asarray(np.interp(time_s, np.append(0.0, ours.ends_s), np.append(0.0, theirs.ends_s)))


def _counterparts(
    plan: CentroidalPlan, programme: Transcription, old: Layout, after_s: float
) -> Iterator[tuple[int, int]]:
    """Intervals of the new problem with those of the plan at the same time in which the same groups act."""
    grid = programme.grid
    if old.wrench.shape[1] != programme.layout.wrench.shape[1]:
        return
    middle_s = 0.5 * (grid.time_s[:-1] + grid.time_s[1:])
    found = np.searchsorted(plan.time_s, _in_the_plan(middle_s, plan, programme, after_s), side="right") - 1
    for k, i in enumerate(found.tolist()):
        if 0 <= i < len(plan.phase):
            ours, theirs = programme.layout.uses_in[k], old.uses_in[i]
            if [_shape(use) for use in ours] == [_shape(use) for use in theirs]:
                yield k, i


def _shape(use: Use) -> tuple[str, int, int, int, bool]:
    return use.group.name, use.inner, use.group.size, use.group.lorentz, use.group.limited


def _rows(use: Use) -> slice:
    return slice(use.row, use.row + n_cones(use.group) + n_limits(use.group))
