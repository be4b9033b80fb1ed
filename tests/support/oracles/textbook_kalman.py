"""The Kalman filter and the smoother of Rauch, Tung and Striebel as textbooks write them: sample by sample."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Textbook:
    """Means and covariances of one axis, predicted, filtered and smoothed."""

    predicted: np.ndarray
    predicted_covariance: np.ndarray
    filtered: np.ndarray
    filtered_covariance: np.ndarray
    smoothed: np.ndarray
    smoothed_covariance: np.ndarray


def textbook(
    A: np.ndarray, W: np.ndarray, R: np.ndarray, y: np.ndarray, start: np.ndarray, start_covariance: np.ndarray
) -> Textbook:
    """``y`` has the columns geometry, acceleration, axis point; NaN is not measured. W is the process noise."""
    C = np.array([[1.0, 0, 0], [0, 0, 1.0], [1.0, 0, 0]])
    xp, Pp, xf, Pf = [], [], [], []
    x, P = start, start_covariance
    for k, measured in enumerate(np.isfinite(y)):
        if k:
            x, P = A @ x, A @ P @ A.T + W
        xp.append(x)
        Pp.append(P)
        H, r = C[measured], np.diag(R[measured])
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + r)
        x = x + K @ (y[k, measured] - H @ x)
        I_KH = np.eye(3) - K @ H
        P = I_KH @ P @ I_KH.T + K @ r @ K.T
        xf.append(x)
        Pf.append(P)
    xs, Ps = [xf[-1]], [Pf[-1]]
    for k in range(len(y) - 2, -1, -1):
        G = Pf[k] @ A.T @ np.linalg.inv(Pp[k + 1])
        xs.insert(0, xf[k] + G @ (xs[0] - xp[k + 1]))
        Ps.insert(0, Pf[k] + G @ (Ps[0] - Pp[k + 1]) @ G.T)
    return Textbook(*(np.array(a) for a in (xp, Pp, xf, Pf, xs, Ps)))
