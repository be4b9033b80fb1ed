"""How a solution was found, and how good it is by the first-order conditions, computed apart from the solver.

    grad f + J^T lambda_g + lambda_x = 0                          stationarity
    bounds on w and g                                             feasibility
    lambda (distance to the bound that it pushes at) = 0          complementarity

in the units of the programme: forces in body weights, metres, the objective times ``programme.SCALE``.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stridelab.centroidal.nlp.assembly import Programme
from stridelab.centroidal.nlp.variable_layout import Structure
from stridelab.conventions import Series


@dataclass(frozen=True)
class Residuals:
    """Largest violations of the first-order conditions."""

    stationarity: float
    feasibility: float
    complementarity: float

    @property
    def kkt_error(self) -> float:
        """The largest of the three."""
        return max(self.stationarity, self.feasibility, self.complementarity)


@dataclass(frozen=True, eq=False)
class Box:
    """``row_lower <= g <= row_upper`` and ``lower <= w <= upper``."""

    lower: Series
    upper: Series
    row_lower: Float[np.ndarray, "rows"]
    row_upper: Float[np.ndarray, "rows"]


@dataclass(frozen=True, eq=False)
class Point:
    """Variables and multipliers (positive where they push down from an upper bound) of a programme of ``structure``."""

    structure: Structure
    w: Series
    lambda_w: Series
    lambda_g: Float[np.ndarray, "rows"]


@dataclass(frozen=True, eq=False)
class NativePoint:
    """Variables of the C++ solver: states ``x``, and u with its multipliers z of every block of points, in order.

    Of the wrench as control: that of every interval with contacts. ``step_s``: lengths of the intervals of every phase.
    Of splines an interval is one of the two free control points of an interval between nodes, and half as long.
    """

    x: Float[np.ndarray, "nodes 9"]
    u: Float[np.ndarray, "slots 4 3"]
    z: Float[np.ndarray, "slots 4 3"]
    wrench_u: Float[np.ndarray, "holds 6"]
    wrench_z: Float[np.ndarray, "holds 6"]
    step_s: Float[np.ndarray, "phases"]


@dataclass(frozen=True, eq=False)
class IterationLog:
    """Iteration by iteration, the start first: (4.20a) with regularisers, infeasibilities, barrier parameter.

    ``primal`` and ``dual`` are the solver's own measures. All empty for a solver that tells nothing.
    """

    objective: Float[np.ndarray, "n"]
    primal: Float[np.ndarray, "n"]
    dual: Float[np.ndarray, "n"]
    barrier: Float[np.ndarray, "n"]


@dataclass(frozen=True, eq=False)
class Attempt:
    """One solver's run: ``success`` is its own verdict, ``residuals`` ours; None where it returned nothing finite."""

    solver: str
    status: str
    success: bool
    iterations: int
    build_s: float
    solve_s: float
    residuals: Residuals | None
    log: IterationLog


@dataclass(frozen=True, eq=False)
class Solution:
    """All attempts, and the point where the last one stopped: the start of another solve (``solve(start=...)``)."""

    attempts: tuple[Attempt, ...]
    point: Point | NativePoint


def residuals(programme: Programme, p: Float[np.ndarray, "parameters"], box: Box, at: Point) -> Residuals:
    """The first-order conditions at a point."""
    g = programme.rows(at.w, p).full().ravel()
    slope = programme.gradient(at.w, p).full().ravel()
    J = programme.jacobian(at.w, p).sparse()
    stationarity = np.abs(slope + J.T @ at.lambda_g + at.lambda_w).max()
    outside, slack = [], []
    for x, lower, upper, multiplier in (
        (at.w, box.lower, box.upper, at.lambda_w),
        (g, box.row_lower, box.row_upper, at.lambda_g),
    ):
        outside += [lower - x, x - upper]
        room = np.where(multiplier > 0.0, upper - x, x - lower)
        pushes = np.abs(multiplier) * np.where(np.isfinite(room), np.abs(room), 0.0)
        slack.append(np.where(lower == upper, 0.0, pushes).max(initial=0.0))
    return Residuals(
        stationarity=float(stationarity),
        feasibility=float(max(0.0, *(x.max(initial=0.0) for x in outside))),
        complementarity=float(max(slack)),
    )
