"""The fit (3.3) as printed: no offset in x. A general solver, for the errors of the text."""

import numpy as np
from scipy.optimize import least_squares

from stridelab.walking.curtate_cycloid import Wheel


def fit_without_offset(path_m: np.ndarray, guess: Wheel, theta_rad: np.ndarray) -> tuple[Wheel, np.ndarray]:
    """Least squares over R, r, z0 and one theta per sample; the wheel and the distance of every sample from it."""
    n = len(path_m)

    def residual(u: np.ndarray) -> np.ndarray:
        wheel = Wheel(R_m=u[0], r_m=u[1], z0_m=u[2], x0_m=0.0)
        return np.ravel(wheel.position_m(u[3:]) - path_m, order="F")

    def jacobian(u: np.ndarray) -> np.ndarray:
        s, c, nil = np.sin(u[3:]), np.cos(u[3:]), np.zeros(n)
        shape = np.column_stack([np.r_[u[3:], nil], np.r_[-s, -c], np.r_[nil, np.ones(n)]])
        return np.hstack([shape, np.vstack([np.diag(u[0] - u[1] * c), np.diag(u[1] * s)])])

    start = np.r_[guess.R_m, guess.r_m, guess.z0_m, theta_rad]
    found = least_squares(residual, start, jacobian, x_scale="jac", xtol=1e-12, ftol=1e-12)
    R, r, z0 = found.x[:3].tolist()
    return Wheel(R_m=R, r_m=r, z0_m=z0, x0_m=0.0), np.hypot(found.fun[:n], found.fun[n:])
