"""Fits the wheel in time: theta = theta_0 + omega t (3.4), position and timing together.

Given theta_0 and omega the model is linear in (x0, R, r, z0), which are eliminated, so that the residual depends on two
parameters only (variable projection, Golub & Pereyra 1973). omega is bounded near the step frequency: unbounded least
squares diverges to wheels of kilometres that hardly turn, because a parabola is a limit of the family. The result lists
the active bounds.
"""

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Series
from stridelab.walking.curtate_cycloid import FULL_TURN_RAD, Branch, Plane, Wheel, parameter_rows, turn_to_zero
from stridelab.walking.initial_guess import first_guess

OMEGA_RANGE: Final = (0.75, 1.33)
"""Bounds of omega, relative to one turn per step."""
ITERATIONS: Final = 60
DAMPING: Final = 1e-3
CONVERGED_DECREASE: Final = 1e-12
NO_ERROR_M2: Final = 1e-26

Bound = Literal["omega-low", "omega-high"]
Clock = Float[np.ndarray, "2"]
"""theta_0 and omega."""
PARAMETERS: Final = ("x0_m", "R_m", "r_m", "z0_m", "theta0_rad", "omega_rad_s")


@dataclass(frozen=True)
class TimedFit:
    """Fitted wheel with its angle over time, the error (model minus measurement), and the active bounds.

    ``covariance`` is the formal one of x0, R, r, z0, theta_0 and omega; rows of fixed or bounded parameters are 0.
    """

    wheel: Wheel
    theta0_rad: float
    omega_rad_s: float
    error_m: Plane
    covariance: Float[np.ndarray, "6 6"]
    bounds: tuple[Bound, ...]
    iterations: int

    @property
    def distance_m(self) -> Series:
        """Distance between model and measurement at every instant."""
        return np.asarray(np.hypot(self.error_m[:, 0], self.error_m[:, 1]))


def fit_in_time(
    time_s: Series, path_m: Plane, step_period_s: float, branch: Branch = 1, *, one_turn_per_step: bool = False
) -> TimedFit:
    """Least-squares fit of all six parameters, or of five with exactly one turn per step.

    ``theta0_rad`` is the angle at ``time_s[0]``. Raises as ``require_path`` does.
    """
    guess = first_guess(time_s, path_m, step_period_s, branch)
    t = time_s - time_s[0]
    turn = FULL_TURN_RAD / step_period_s
    low, high = (turn, turn) if one_turn_per_step else (OMEGA_RANGE[0] * turn, OMEGA_RANGE[1] * turn)
    clock = np.array([guess.theta0_rad, min(max(guess.omega_rad_s, low), high)])
    now = _Projected.from_clock(clock, t, path_m, branch)
    damping, taken = DAMPING, 0
    while taken < ITERATIONS and damping < 1e8 and now.cost > NO_ERROR_M2 * len(t):
        taken += 1
        out = _leaves_bounds(float(clock[1]), float(now.gradient[1]), low, high)
        free = np.array([True, not (one_turn_per_step or out)])
        J = now.slopes[:, free]
        normal = J.T @ J
        step, *_ = np.linalg.lstsq(normal + damping * np.diag(np.diag(normal)), -now.gradient[free], rcond=None)
        tried = clock.copy()
        tried[free] += step
        tried[1] = min(max(tried[1], low), high)
        candidate = _Projected.from_clock(tried, t, path_m, branch)
        if candidate.cost < now.cost:
            arrived = now.cost - candidate.cost < CONVERGED_DECREASE * now.cost
            clock, now, damping = tried, candidate, max(damping / 5, 1e-12)
            if arrived:
                break
        else:
            damping *= 8
    return _timed_fit_result(clock, now, t, branch, (low, high), one_turn_per_step, taken)


@dataclass(frozen=True)
class _Projected:
    """Best wheel for given (theta_0, omega): ``p`` = (x0, R, r, z0), errors, and their derivatives."""

    p: Float[np.ndarray, "4"]
    rows: Float[np.ndarray, "m 4"]
    error: Float[np.ndarray, "m"]
    slopes: Float[np.ndarray, "m 2"]

    @property
    def cost(self) -> float:
        return float(self.error @ self.error)

    @property
    def gradient(self) -> Clock:
        return np.asarray(self.slopes.T @ self.error)

    @classmethod
    def from_clock(cls, clock: Clock, t: Series, path_m: Plane, branch: Branch) -> "_Projected":
        theta = clock[0] + clock[1] * t
        rows = np.vstack(parameter_rows(theta, branch))
        measured = np.concatenate([path_m[:, 0], path_m[:, 1]])
        q, triangle = np.linalg.qr(rows)
        p = np.linalg.solve(triangle, q.T @ measured)
        d_theta = np.concatenate([p[1] - branch * p[2] * np.cos(theta), p[2] * np.sin(theta)])
        raw = np.column_stack([d_theta, d_theta * np.concatenate([t, t])])
        slopes = raw - q @ (q.T @ raw)  # Kaufman's approximation: projection off the linear parameters
        return cls(p, rows, rows @ p - measured, slopes)


def _leaves_bounds(omega: float, slope: float, low: float, high: float) -> bool:
    return (omega <= low and slope > 0.0) or (omega >= high and slope < 0.0)


def _timed_fit_result(
    clock: Clock,
    now: _Projected,
    t: Series,
    branch: Branch,
    omega_range: tuple[float, float],
    one_turn_per_step: bool,
    iterations: int,
) -> TimedFit:
    low, high = omega_range
    bounds: list[Bound] = []
    if not one_turn_per_step and clock[1] <= low:
        bounds.append("omega-low")
    if not one_turn_per_step and clock[1] >= high:
        bounds.append("omega-high")
    n = len(t)
    theta = clock[0] + clock[1] * t
    d_theta = np.concatenate([now.p[1] - branch * now.p[2] * np.cos(theta), now.p[2] * np.sin(theta)])
    J = np.column_stack([now.rows, d_theta, d_theta * np.concatenate([t, t])])
    free = [i for i in range(6) if not (i == 5 and (one_turn_per_step or bounds))]
    covariance = np.zeros((6, 6))
    noise = now.cost / max(2 * n - len(free), 1)
    covariance[np.ix_(free, free)] = noise * np.linalg.pinv(J[:, free].T @ J[:, free], hermitian=True)
    turn = turn_to_zero(float(clock[0] + clock[1] * t[-1] / 2), float(now.p[2]))
    change = np.eye(6)
    change[:4, :4] = turn.change
    x0, R, r, z0 = (float(v) for v in turn.change @ now.p)
    wheel = Wheel(R_m=R, r_m=r, z0_m=z0, x0_m=x0, branch=branch)
    error = np.column_stack([now.error[:n], now.error[n:]])
    return TimedFit(
        wheel,
        float(clock[0] - turn.by_rad),
        float(clock[1]),
        error,
        change @ covariance @ change.T,
        tuple(bounds),
        iterations,
    )
