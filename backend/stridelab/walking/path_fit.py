"""Fits the wheel as a *path* (3.3): every sample has its own theta_k, without a constraint on timing.

There are 4 + N unknowns and 2N equations. theta_k affects only its own sample, so the normal matrix is an arrowhead,

    [ H   B' ] [ dp     ]     [ g_p ]
    [ B   D  ] [ dtheta ] = - [ g_t ] ,      D diagonal,

and eliminating theta leaves a 4 x 4 system (Schur complement) per Levenberg-Marquardt iteration.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Series
from stridelab.walking.curtate_cycloid import Branch, Plane, Wheel, parameter_rows, turn_to_zero
from stridelab.walking.initial_guess import first_guess

ITERATIONS: Final = 200
DAMPING: Final = 1e-4
MIN_DAMPING, MAX_DAMPING = 1e-12, 1e8
CONVERGED_DECREASE: Final = 1e-11
"""Relative decrease of the sum of squares at which a fit has converged."""
NO_ERROR_M2: Final = 1e-26
"""Mean square below which the residual is rounding error."""
SINGULAR: Final = 1e-12

Parameters = Float[np.ndarray, "4"]
Covariance = Float[np.ndarray, "4 4"]


@dataclass(frozen=True)
class PathFit:
    """Fitted wheel, angle of every sample, and residual.

    ``error_m`` is model minus measurement, ahead and up. ``covariance_m2`` of (x0, R, r, z0) is the formal one, for
    independent errors of the size of the residual. It is too small because residuals of a step are correlated: R
    differs between two steps of one trial ten times more.
    """

    wheel: Wheel
    theta_rad: Series
    error_m: Plane
    covariance_m2: Covariance
    iterations: int
    converged: bool

    @property
    def distance_m(self) -> Series:
        """Distance of every sample from the curve."""
        return np.asarray(np.hypot(self.error_m[:, 0], self.error_m[:, 1]))

    @property
    def sd_m(self) -> Parameters:
        """Formal standard deviations of x0, R, r and z0."""
        return np.asarray(np.sqrt(np.diag(self.covariance_m2)))


def fit_path(time_s: Series, path_m: Plane, step_period_s: float, branch: Branch = 1) -> PathFit:
    """Least-squares fit of (3.3); ``time_s`` is used for the first guess only.

    theta of the result is within half a turn in mid-step. Raises as ``require_path`` does.
    """
    guess = first_guess(time_s, path_m, step_period_s, branch)
    w = guess.wheel
    p, theta = np.array([w.x0_m, w.R_m, w.r_m, w.z0_m]), guess.theta_rad(time_s)
    damping, converged, taken = DAMPING, False, 0
    error = _path_errors(p, theta, path_m, branch)
    cost = float(np.sum(error**2))
    while taken < ITERATIONS and not converged:
        taken += 1
        arrow = _Arrowhead.from_parameters(p, theta, error, branch)
        dp, dtheta = arrow.solve_step(damping)
        tried = _path_errors(p + dp, theta + dtheta, path_m, branch)
        lower = float(np.sum(tried**2))
        if lower < cost:
            converged = cost - lower < CONVERGED_DECREASE * cost or lower < NO_ERROR_M2 * len(theta)
            p, theta, error, cost = p + dp, theta + dtheta, tried, lower
            damping = max(damping / 5, MIN_DAMPING)
        else:
            converged = damping >= MAX_DAMPING or cost < NO_ERROR_M2 * len(theta)
            damping *= 8
    noise = cost / max(len(theta) - len(p), 1)
    information = _Arrowhead.from_parameters(p, theta, error, branch).schur_complement(0.0)
    covariance = noise * np.linalg.pinv(information, rcond=SINGULAR, hermitian=True)
    return _normalise_fit(p, theta, error, covariance, taken, converged, branch)


@dataclass(frozen=True)
class _Arrowhead:
    """H, B, D and the gradients of the module docstring."""

    H: Float[np.ndarray, "4 4"]
    B: Float[np.ndarray, "n 4"]
    D: Series
    g_p: Parameters
    g_t: Series

    @classmethod
    def from_parameters(cls, p: Parameters, theta: Series, error: Plane, branch: Branch) -> "_Arrowhead":
        ahead, up = parameter_rows(theta, branch)
        dx = p[1] - branch * p[2] * np.cos(theta)
        dz = p[2] * np.sin(theta)
        return cls(
            H=ahead.T @ ahead + up.T @ up,
            B=ahead * dx[:, None] + up * dz[:, None],
            D=dx * dx + dz * dz + SINGULAR,
            g_p=ahead.T @ error[:, 0] + up.T @ error[:, 1],
            g_t=dx * error[:, 0] + dz * error[:, 1],
        )

    def schur_complement(self, damping: float) -> Float[np.ndarray, "4 4"]:
        over = self.B / (self.D * (1 + damping))[:, None]
        return np.asarray(self.H + damping * np.diag(np.diag(self.H)) - over.T @ self.B)

    def solve_step(self, damping: float) -> tuple[Parameters, Series]:
        D = self.D * (1 + damping)
        reduced = self.g_p - (self.B / D[:, None]).T @ self.g_t
        dp = -np.linalg.solve(self.schur_complement(damping), reduced)  # damping keeps it regular
        return dp, -(self.g_t + self.B @ dp) / D


def _path_errors(p: Parameters, theta: Series, path_m: Plane, branch: Branch) -> Plane:
    x0, R, r, z0 = (float(v) for v in p)
    return np.asarray(Wheel(R_m=R, r_m=r, z0_m=z0, x0_m=x0, branch=branch).position_m(theta) - path_m)


def _normalise_fit(
    p: Parameters,
    theta: Series,
    error: Plane,
    covariance: Covariance,
    iterations: int,
    converged: bool,
    branch: Branch,
) -> PathFit:
    """Normalise the fit: the same curve with r > 0 and theta near zero in mid-step."""
    turn = turn_to_zero(float(np.mean(theta)), float(p[2]))
    x0, R, r, z0 = (float(v) for v in turn.change @ p)
    wheel = Wheel(R_m=R, r_m=r, z0_m=z0, x0_m=x0, branch=branch)
    same = np.asarray(turn.change @ covariance @ turn.change.T)
    return PathFit(wheel, theta - turn.by_rad, error, same, iterations, converged)
