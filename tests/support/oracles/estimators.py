"""Published estimators of the centre of mass, written anew to compare with.

The package center_of_mass 1.0.1 as an oracle, with two defects put right.

Its pelvis length contains ``[1] ** 2 ** 2``, a fourth power where a square is meant; and it places the left limbs'
centres of mass with the right limbs' sideways offset, without mirroring it.

The Kalman filter and the smoother of Rauch, Tung and Striebel as textbooks write them: sample by sample.

The fit (3.3) as printed: no offset in x. A general solver, for the errors of the text.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import center_of_mass.kinematic as oracle
import numpy as np
from scipy.optimize import least_squares

from stridelab.walking.curtate_cycloid import Wheel

_LABELS = {
    "ASI": "asis",
    "PSI": "psis",
    "SHO": "acromion",
    "ELL": "elbow_lateral",
    "ELM": "elbow_medial",
    "WRR": "wrist_radial",
    "WRU": "wrist_ulnar",
    "DMC2": "mc2",
    "DMC5": "mc5",
    "FLE": "knee_lateral",
    "FME": "knee_medial",
    "LMAL": "ankle_lateral",
    "MMAL": "ankle_medial",
    "CAL2": "heel",
    "DMT1": "mt1",
    "DMT5": "mt5",
}


def whole_body_com_m(landmarks: Mapping[str, np.ndarray], sex: str) -> np.ndarray:
    """CoM (n, 3) of Dumas 2007/2018 from landmark tracks (n, 3)."""
    position = {"C7": landmarks["c7"].T, "STERNSUP": landmarks["jugular_notch"].T}
    for side in "lr":
        for label, name in _LABELS.items():
            position[side.upper() + label] = landmarks[f"{side}_{name}"].T
        if f"{side}_head_front" in landmarks:
            ends = landmarks[f"{side}_head_front"], landmarks[f"{side}_head_back"]
            position["HEAD" + side.upper()] = ((ends[0] + ends[1]) / 2).T
    body = _Repaired(position, list(position), sex)
    return body.calculate_CoM().T


class _Repaired(oracle.Kinematics):
    def calculate_Pelvis(self, Labels: list[str]) -> None:
        super().calculate_Pelvis(Labels)
        scaling = oracle.Pelvis_scaling
        d = np.array(scaling["Lumbar"][self.sex]) - np.array(scaling["R_hip"][self.sex])
        width = oracle.Distance(self.Position["LASI"], self.Position["RASI"])
        self.SegmentLength["Pelvis"] = width * np.hypot(d[0], d[1])

    def calculate_segment_CoM(self, segment: str) -> tuple[float, np.ndarray]:
        if not segment.startswith("L_"):
            return super().calculate_segment_CoM(segment)
        X, Y, Z = self.SegmentCoordinateSystem[segment]
        self.SegmentCoordinateSystem[segment] = (X, Y, -Z)
        share, com = super().calculate_segment_CoM(segment)
        self.SegmentCoordinateSystem[segment] = (X, Y, Z)
        return share, com


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
    solution = least_squares(residual, start, jacobian, x_scale="jac", xtol=1e-12, ftol=1e-12)
    R, r, z0 = solution.x[:3].tolist()
    return Wheel(R_m=R, r_m=r, z0_m=z0, x0_m=0.0), np.hypot(solution.fun[:n], solution.fun[n:])
