"""A solution moved along in time: the start of the next problem of a receding horizon.

Every interval of the new problem takes the variables and multipliers of the old interval that lies at the same time, as
far as the old one reaches; beyond it stand the new problem's own guess over the old end, and no multipliers. Positions
are relative to the CoM at each problem's start: with d from the new origin to the old one

    c -> c + d,   K -> K + d x c' / g,   T -> T + d x F

and multipliers of rows change by the transposed inverse, ``lambda_c' -> lambda_c' + d x lambda_K / g`` and
``lambda_F -> lambda_F + d x lambda_T``.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from stridelab.centroidal.dynamics import N_STATE, N_WRENCH
from stridelab.centroidal.layout import Layout, Use, lay_out, n_cones, n_limits
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem, Grid
from stridelab.centroidal.solution import Point
from stridelab.centroidal.transcription import Transcription, transcribe
from stridelab.conventions import GRAVITY_M_S2, Series, Vector3


@dataclass(frozen=True, eq=False)
class _Old:
    """What there is to take over."""

    point: Point
    layout: Layout
    grid: Grid
    uses: dict[tuple[int, str], Use]


def shifted(plan: CentroidalPlan, of: CentroidalProblem, to: CentroidalProblem, after_s: float) -> Point | None:
    """``plan``, which solves ``of``, as a start for ``to``, which begins ``after_s`` later; None without a solution."""
    if plan.solution is None:
        return None
    point = plan.solution.point
    layout = lay_out(point.structure)
    old = _Old(point, layout, of.grid(), {(use.k, use.group.name): use for use in layout.uses})
    new = transcribe(to)
    d = of.com_start_m - to.com_start_m
    w, lambda_w, lambda_g = new.guess.copy(), np.zeros(new.layout.n), np.zeros(new.layout.n_rows)
    taken = _taken(old.grid, new.grid, after_s)
    _states(plan, new, w, after_s)
    uses = {(use.k, use.group.name): use for use in new.layout.uses}
    for k, j in enumerate(taken):
        if j < 0:
            continue
        a, b = int(new.layout.wrench[k]), int(old.layout.wrench[j])
        w[a : a + N_WRENCH] = _wrench(point.w[b : b + N_WRENCH], d)
        lambda_w[a : a + N_WRENCH] = point.lambda_w[b : b + N_WRENCH]
        a, b = int(new.layout.tie[k]), int(old.layout.tie[j])
        lambda_g[a : a + N_WRENCH] = _pushed(point.lambda_g[b : b + N_WRENCH], d, 1.0)
        a, b = int(new.layout.gap[k]), int(old.layout.gap[j])
        lambda_g[a : a + 3] = point.lambda_g[b : b + 3]
        lambda_g[a + 3 : a + N_STATE] = _pushed(point.lambda_g[b + 3 : b + N_STATE], d, GRAVITY_M_S2)
    for (k, name), use in uses.items():
        there = old.uses.get((int(taken[k]), name))
        if there is not None and there.group.size == use.group.size:
            here, size = slice(use.start, use.start + use.group.size), use.group.size
            w[here] = point.w[there.start : there.start + size]
            lambda_w[here] = point.lambda_w[there.start : there.start + size]
            count = n_cones(use.group) + n_limits(use.group)
            lambda_g[use.row : use.row + count] = point.lambda_g[there.row : there.row + count]
    return Point(new.compiled.structure, w, lambda_w, lambda_g)


def _taken(old: Grid, new: Grid, after_s: float) -> Int[np.ndarray, "intervals"]:
    """The old interval in which the middle of each new one lies; -1 beyond the old end."""
    middles = new.time_s[:-1] + new.step_s / 2.0 + after_s
    found = np.searchsorted(old.time_s, middles, side="right") - 1
    return np.where(middles < old.time_s[-1], found, -1)


def _states(plan: CentroidalPlan, new: Transcription, w: Series, after_s: float) -> None:
    problem = new.problem
    for node, time_s in enumerate(new.grid.time_s + after_s):
        there = plan.at(min(float(time_s), float(plan.time_s[-1])))
        c, v = there.com_m - new.origin_m, there.com_v_m_s
        if time_s > plan.time_s[-1]:
            v = np.zeros(3)
        K = (there.l_nms + problem.mass_kg * np.cross(c, v)) / problem.weight_n
        start = int(new.layout.state[node])
        w[start : start + N_STATE] = np.concatenate([c, v, K])


def _wrench(old: Series, d: Vector3) -> Series:
    return np.concatenate([old[:3], old[3:] + np.cross(d, old[:3])])


def _pushed(multipliers: Series, d: Vector3, unit: float) -> Series:
    """Of (force or velocity, moment or momentum) rows."""
    return np.concatenate([multipliers[:3] + np.cross(d, multipliers[3:]) / unit, multipliers[3:]])
