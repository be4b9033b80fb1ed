"""The package center_of_mass 1.0.1 as an oracle, with two defects put right.

Its pelvis length contains ``[1] ** 2 ** 2``, a fourth power where a square is meant; and it places the left limbs'
centres of mass with the right limbs' sideways offset, without mirroring it.
"""

from collections.abc import Mapping

import center_of_mass.kinematic as oracle
import numpy as np

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
