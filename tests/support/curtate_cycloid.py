"""The curtate cycloid (3.1), (3.2) and its fit (3.3) with a free angle per sample."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares


def cycloid(
    theta: np.ndarray, R_m: float, r_m: float, z0_m: float, x0_m: float = 0.0, sign: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """``x = x0 + R theta - r sin theta``, ``z = z0 - r cos theta``; ``sign`` -1 is the branch with R < 0, mirrored."""
    return x0_m + R_m * theta - sign * r_m * np.sin(theta), z0_m - r_m * np.cos(theta)


@dataclass(frozen=True)
class PathFit:
    """R, r, z0 (and x0), distance of every sample to the curve, and sds that take the residuals for white."""

    R_m: float
    r_m: float
    z0_m: float
    distance_m: np.ndarray
    formal_sd_m: np.ndarray


def fit_path(x_m: np.ndarray, z_m: np.ndarray, start: np.ndarray, theta: np.ndarray, offset: bool = True) -> PathFit:
    """Least squares (3.3) over R, r, z0, x0 (none without ``offset``) and one theta per sample, from ``start``."""
    n, shared = len(x_m), 4 if offset else 3

    def residual(u: np.ndarray) -> np.ndarray:
        x, z = cycloid(u[shared:], u[0], u[1], u[2], u[3] if offset else 0.0)
        return np.concatenate([x - x_m, z - z_m])

    def jacobian(u: np.ndarray) -> np.ndarray:
        s, c, one, nil = np.sin(u[shared:]), np.cos(u[shared:]), np.ones(n), np.zeros(n)
        columns = [np.r_[u[shared:], nil], np.r_[-s, -c], np.r_[nil, one], np.r_[one, nil]][:shared]
        along = np.vstack([np.diag(u[0] - u[1] * c), np.diag(u[1] * s)])
        return np.hstack([np.column_stack(columns), along])

    found = least_squares(residual, np.r_[start[:shared], theta], jacobian, x_scale="jac", xtol=1e-12, ftol=1e-12)
    variance = 2 * found.cost / (n - shared)
    covariance = np.linalg.inv(found.jac.T @ found.jac) * variance
    return PathFit(*found.x[:3].tolist(), np.hypot(found.fun[:n], found.fun[n:]), np.sqrt(np.diag(covariance)[:3]))


def fit_step(x_m: np.ndarray, z_m: np.ndarray) -> PathFit:
    """The fit of one step that runs from a lowest point to the next, started at the wheel that rolls evenly."""
    theta = np.linspace(0.0, 2 * np.pi, len(x_m))
    R = (x_m[-1] - x_m[0]) / (2 * np.pi)
    return fit_path(x_m, z_m, np.array([R, np.ptp(z_m) / 2, (z_m.max() + z_m.min()) / 2, x_m[0]]), theta)
