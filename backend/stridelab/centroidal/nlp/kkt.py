"""Solver attempts and the residuals of the first-order (KKT) conditions, computed independently of the solver.

    grad f + J^T lambda_g + lambda_x = 0                          stationarity
    bounds on w and g                                             feasibility
    lambda (distance to its bound) = 0                            complementarity

in the units of the nonlinear program: forces in body weights, metres, the objective times its scale in ``nlp``.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stridelab.centroidal.nlp.assembly import NonlinearProgram
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
    """Variables and multipliers (positive at upper bounds) of a nonlinear program of ``structure``."""

    structure: Structure
    w: Series
    lambda_w: Series
    lambda_g: Float[np.ndarray, "rows"]


@dataclass(frozen=True, eq=False)
class NativePoint:
    """Variables of the C++ solver: states ``x``, and u with its multipliers z of every block of points, in order.

    ``wrench_u`` and ``wrench_z`` are those of the wrench control, for every interval with contacts; ``step_s`` are the
    interval lengths per phase. For splines, each of the two free control points counts as an interval of half length.
    """

    x: Float[np.ndarray, "nodes 9"]
    u: Float[np.ndarray, "slots 4 3"]
    z: Float[np.ndarray, "slots 4 3"]
    wrench_u: Float[np.ndarray, "holds 6"]
    wrench_z: Float[np.ndarray, "holds 6"]
    step_s: Float[np.ndarray, "phases"]


@dataclass(frozen=True, eq=False)
class IterationLog:
    """Per iteration, starting with the initial guess: (4.20a) with regularisers, infeasibilities, barrier parameter.

    ``primal`` and ``dual`` are the solver's own measures. All are empty for a solver without a log.
    """

    objective: Float[np.ndarray, "n"]
    primal: Float[np.ndarray, "n"]
    dual: Float[np.ndarray, "n"]
    barrier: Float[np.ndarray, "n"]


@dataclass(frozen=True, eq=False)
class Attempt:
    """One solver run: ``success`` as reported by the solver; ``residuals`` recomputed, None if not finite."""

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
    """All attempts and the final point of the last one, usable as a warm start (``solve(start=...)``)."""

    attempts: tuple[Attempt, ...]
    point: Point | NativePoint


def kkt_residuals(nlp: NonlinearProgram, p: Float[np.ndarray, "parameters"], box: Box, point: Point) -> Residuals:
    """Residuals of the first-order conditions at a point."""
    g = nlp.rows(point.w, p).full().ravel()
    gradient = nlp.gradient(point.w, p).full().ravel()
    J = nlp.jacobian(point.w, p).sparse()
    stationarity = np.abs(gradient + J.T @ point.lambda_g + point.lambda_w).max()
    violations, slack = [], []
    for x, lower, upper, multiplier in (
        (point.w, box.lower, box.upper, point.lambda_w),
        (g, box.row_lower, box.row_upper, point.lambda_g),
    ):
        violations += [lower - x, x - upper]
        distance = np.where(multiplier > 0.0, upper - x, x - lower)
        products = np.abs(multiplier) * np.where(np.isfinite(distance), np.abs(distance), 0.0)
        slack.append(np.where(lower == upper, 0.0, products).max(initial=0.0))
    return Residuals(
        stationarity=float(stationarity),
        feasibility=float(max(0.0, *(x.max(initial=0.0) for x in violations))),
        complementarity=float(max(slack)),
    )
