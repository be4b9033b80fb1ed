"""Small C3D files made by ezc3d."""

from pathlib import Path

import ezc3d
import numpy as np

PELVIS_AND_FEET = ("LASI", "RASI", "LPSI", "RPSI", "LKNE", "RKNE", "LANK", "RANK", "LHEE", "RHEE", "LTOE", "RTOE")


def small_trial(path: Path, *, seconds: float = 1.0, rate_hz: float = 100.0, with_plate: bool = True) -> Path:
    """A pelvis and two legs that glide along x for ``seconds``, above one plate of type 2 that carries 600 N."""
    n = round(seconds * rate_hz)
    t = np.arange(n) / rate_hz
    points = np.ones((4, len(PELVIS_AND_FEET), n))
    for i, label in enumerate(PELVIS_AND_FEET):
        side = 100.0 if label.startswith("L") else -100.0
        height = {"A": 900.0, "P": 950.0, "K": 500.0, "H": 50.0, "T": 40.0}[label[1]]
        height = 90.0 if label.endswith("ANK") else height
        ahead = 80.0 if label.endswith("TOE") else (-80.0 if label.endswith("HEE") else 0.0)
        points[0, i], points[1, i], points[2, i] = 1000.0 * t + ahead, side, height
    c3d = ezc3d.c3d()
    c3d["parameters"]["POINT"]["LABELS"]["value"] = list(PELVIS_AND_FEET)
    c3d["parameters"]["POINT"]["RATE"]["value"] = [rate_hz]
    c3d["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    c3d["data"]["points"] = points
    if with_plate:
        channels = ["Fx1", "Fy1", "Fz1", "Mx1", "My1", "Mz1"]
        analogs = np.zeros((1, 6, 10 * n))
        analogs[0, 2] = -600.0
        c3d["parameters"]["ANALOG"]["LABELS"]["value"] = channels
        c3d["parameters"]["ANALOG"]["RATE"]["value"] = [10 * rate_hz]
        c3d["parameters"]["ANALOG"]["UNITS"]["value"] = ["N", "N", "N", "Nmm", "Nmm", "Nmm"]
        c3d["parameters"]["ANALOG"]["SCALE"]["value"] = [1.0] * 6
        c3d["parameters"]["ANALOG"]["OFFSET"]["value"] = [0] * 6
        c3d["parameters"]["ANALOG"]["GEN_SCALE"]["value"] = [1.0]
        c3d["data"]["analogs"] = analogs
        c3d.add_parameter("FORCE_PLATFORM", "USED", [1])
        c3d.add_parameter("FORCE_PLATFORM", "TYPE", [2])
        c3d.add_parameter("FORCE_PLATFORM", "ZERO", [0, 0])
        corners = np.array([[1300, 300, 0], [-300, 300, 0], [-300, -300, 0], [1300, -300, 0]], dtype=float)
        c3d.add_parameter("FORCE_PLATFORM", "CORNERS", corners.T[:, :, None])
        c3d.add_parameter("FORCE_PLATFORM", "ORIGIN", np.array([[0.0], [0.0], [-20.0]]))
        c3d.add_parameter("FORCE_PLATFORM", "CHANNEL", np.arange(1.0, 7.0).reshape(6, 1))
    c3d.write(str(path))
    return path
