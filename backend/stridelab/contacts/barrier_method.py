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
Derivatives = Callable[[Vector, float], tuple[Vector, Matrix]]
"""Gradient and Hessian of ``Value``."""

WEIGHT_RATIO: Final = 6.0
"""Ratio of successive weights."""
CENTRING_DECREMENT: Final = 1e-2
"""Squared Newton decrement that ends centring at intermediate weights."""
FINAL_DECREMENT: Final = 2e-9
"""Squared Newton decrement that ends centring at the last weight."""
FULL_STEP_DECREMENT: Final = 0.1
"""Squared decrement below which Newton's method converges quadratically with full steps."""
RIDGE: Final = 2e-14
"""Added to the diagonal of the Jacobi-scaled Hessian, so that it stays positive definite at the largest weights."""
MAX_NEWTON_STEPS: Final = 40
"""Maximum number of Newton steps per weight."""
MIN_STEP_LENGTH: Final = 1e-8
"""Step length at which backtracking stops."""


def follow_central_path(
    x: Vector, value: Value, derivatives: Derivatives, last_weight: float, first_weight: float = 1.0
) -> Vector:
    """Return ``x(last_weight)``, starting from a strictly feasible ``x``."""
    weight = first_weight
    while weight < last_weight:
        x = _centre_iterate(x, value, derivatives, weight, CENTRING_DECREMENT)
        next_weight = min(WEIGHT_RATIO * weight, last_weight)
        x = _predictor_step(x, value, derivatives, weight, next_weight)
        weight = next_weight
    return _centre_iterate(x, value, derivatives, last_weight, FINAL_DECREMENT)


def _centre_iterate(x: Vector, value: Value, derivatives: Derivatives, weight: float, tolerance: float) -> Vector:
    for _ in range(MAX_NEWTON_STEPS):
        gradient, hessian = derivatives(x, weight)
        step = -_solve_scaled(hessian, gradient)
        decrement = -float(gradient @ step)
        if decrement <= tolerance:
            return x
        # near the centre a full step stays feasible, and rounding of the value would hide its descent
        here = sys.float_info.max if decrement < FULL_STEP_DECREMENT else value(x, weight)
        length = 1.0
        while value(x + length * step, weight) > here - 0.1 * length * decrement:
            length /= 2.0
            if length < MIN_STEP_LENGTH:
                return x
        x = np.asarray(x + length * step)
    return x


def _predictor_step(x: Vector, value: Value, derivatives: Derivatives, weight: float, next_weight: float) -> Vector:
    """Predictor step along the tangent of the path, shortened to stay strictly feasible."""
    gradient, hessian = derivatives(x, weight)
    weighted_gradient = derivatives(x, 2.0 * weight)[0] - gradient  # w grad f
    step = -(1.0 - weight / next_weight) * _solve_scaled(hessian, weighted_gradient)
    length = 1.0
    while not np.isfinite(value(x + length * step, weight)):
        length *= 0.8
    return np.asarray(x + (length if length == 1.0 else 0.9 * length) * step)


def _solve_scaled(hessian: Matrix, right_hand_side: Vector) -> Vector:
    scale = 1.0 / np.sqrt(np.diag(hessian))
    scaled = hessian * scale * scale[:, np.newaxis]
    scaled[np.diag_indices(len(scale))] += RIDGE
    return np.asarray(
        scale * cho_solve(cho_factor(scaled, check_finite=False), scale * right_hand_side, check_finite=False)
    )
