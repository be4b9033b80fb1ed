"""Solves small convex programs by following the central path of a logarithmic barrier with Newton's method.

    x(w) = argmin  w f(x) - sum log(slack(x)),      w -> infinity

From one weight to the next a predictor step follows the tangent of the path, ``dx = -(1 - w/w') w H^-1 grad f``, as if
``x`` were linear in ``1 / w``. Newton steps with backtracking then centre the iterate (Boyd & Vandenberghe, Convex
Optimization, 9.5 and 11.3; Fiacco & McCormick 1968). Every iterate is strictly feasible, so an early stop still returns
a feasible point.
"""

import sys
from collections.abc import Callable
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.linalg import cho_factor, cho_solve

Vector = Float[np.ndarray, "_"]
Matrix = Float[np.ndarray, "_ _"]
Value = Callable[[Vector, float], float]
"""Weighted objective plus barrier at a point; infinite outside the feasible set."""
Slopes = Callable[[Vector, float], tuple[Vector, Matrix]]
"""Gradient and Hessian of ``Value``."""

RATIO: Final = 6.0
"""Ratio of successive weights."""
CENTRED: Final = 1e-2
"""Squared Newton decrement that ends centring at intermediate weights."""
DECREMENT: Final = 2e-9
"""Squared Newton decrement that ends centring at the last weight."""
NEAR: Final = 0.1
"""Squared decrement below which Newton's method converges quadratically with full steps."""
RIDGE: Final = 2e-14
"""Added to the diagonal of the Jacobi-scaled Hessian, so that it stays positive definite at the largest weights."""
MOST_STEPS: Final = 40
"""Maximum number of Newton steps per weight."""
SHORTEST: Final = 1e-8
"""Step length at which backtracking stops."""


def follow(x: Vector, value: Value, slopes: Slopes, last_weight: float, first_weight: float = 1.0) -> Vector:
    """Return ``x(last_weight)``, starting from a strictly feasible ``x``."""
    weight = first_weight
    while weight < last_weight:
        x = _centred(x, value, slopes, weight, CENTRED)
        next_weight = min(RATIO * weight, last_weight)
        x = _ahead(x, value, slopes, weight, next_weight)
        weight = next_weight
    return _centred(x, value, slopes, last_weight, DECREMENT)


def _centred(x: Vector, value: Value, slopes: Slopes, weight: float, enough: float) -> Vector:
    for _ in range(MOST_STEPS):
        gradient, hessian = slopes(x, weight)
        step = -_solved(hessian, gradient)
        decrement = -float(gradient @ step)
        if decrement <= enough:
            return x
        # near the centre a full step stays feasible, and rounding of the value would hide its descent
        here = sys.float_info.max if decrement < NEAR else value(x, weight)
        length = 1.0
        while value(x + length * step, weight) > here - 0.1 * length * decrement:
            length /= 2.0
            if length < SHORTEST:
                return x
        x = np.asarray(x + length * step)
    return x


def _ahead(x: Vector, value: Value, slopes: Slopes, weight: float, further: float) -> Vector:
    """Predictor step along the tangent of the path, shortened to stay strictly feasible."""
    gradient, hessian = slopes(x, weight)
    weighted_gradient = slopes(x, 2.0 * weight)[0] - gradient  # w grad f
    step = -(1.0 - weight / further) * _solved(hessian, weighted_gradient)
    length = 1.0
    while not np.isfinite(value(x + length * step, weight)):
        length *= 0.8
    return np.asarray(x + (length if length == 1.0 else 0.9 * length) * step)


def _solved(hessian: Matrix, right: Vector) -> Vector:
    scale = 1.0 / np.sqrt(np.diag(hessian))
    scaled = hessian * scale * scale[:, np.newaxis]
    scaled[np.diag_indices(len(scale))] += RIDGE
    return np.asarray(scale * cho_solve(cho_factor(scaled, check_finite=False), scale * right, check_finite=False))
