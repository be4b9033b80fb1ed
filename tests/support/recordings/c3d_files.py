"""Small C3D files made by ezc3d.

C3D files made by tests: any markers, plate channels, parameters; so that every trap can be built on purpose.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

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


FLAT_CORNERS_MM = np.array([[0.0, 400.0, 0.0], [500.0, 400.0, 0.0], [500.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
"""Corners of a plate whose own x axis points to -x and whose z axis points down, as AMTI plates lie."""


@dataclass(frozen=True)
class PlateChannels:
    """One plate as it is written: ``signals`` are n x channels in file units."""

    kind: int
    signals: np.ndarray
    corners_mm: np.ndarray = field(default_factory=lambda: FLAT_CORNERS_MM.copy())
    origin_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    calibration: np.ndarray | None = None


def write_file(
    path: Path,
    points: Mapping[str, np.ndarray],
    *,
    plates: Sequence[PlateChannels] = (),
    rate_hz: float = 100.0,
    force_rate_hz: float = 1000.0,
    unit: str = "mm",
    moment_unit: str = "Nmm",
    parameters: Mapping[tuple[str, str], Any] = {},
    zero: tuple[int, int] = (0, 0),
    first_frame: int = 0,
    analogs: np.ndarray | None = None,
) -> Path:
    """Write points (n x 3 in ``unit``) and plates; ``parameters`` maps (group, name) to extra values.

    Integers among the extra values are written as integers. ``analogs`` are the samples of all channels, where there
    are more than the plates'.
    """
    content = ezc3d.c3d()
    groups = content["parameters"]
    cloud = np.stack([np.asarray(track, dtype=float) for track in points.values()], axis=1)
    content["data"]["points"] = np.concatenate([cloud, np.ones((*cloud.shape[:2], 1))], axis=2).transpose(2, 1, 0)
    content["header"]["points"]["first_frame"] = first_frame
    groups["POINT"]["RATE"]["value"] = np.array([rate_hz])
    groups["POINT"]["UNITS"]["value"] = [unit]
    groups["POINT"]["LABELS"]["value"] = list(points)
    if plates:
        analog = groups["ANALOG"]
        signals = np.concatenate([plate.signals for plate in plates], axis=1) if analogs is None else analogs
        m = signals.shape[1]
        content["data"]["analogs"] = signals.T[None]
        analog["RATE"]["value"] = np.array([force_rate_hz])
        analog["LABELS"]["value"] = [f"channel {i}" for i in range(m)]
        analog["UNITS"]["value"] = [u for plate in plates for u in _units(plate, moment_unit)]
        analog["SCALE"]["value"] = np.ones(m)
        analog["OFFSET"]["value"] = np.zeros(m, dtype=int)
        _add_plates(content, plates, zero)
    for (group, name), value in parameters.items():
        _add(content, group, name, value)
    content.write(str(path))
    return path


def _units(plate: PlateChannels, moment_unit: str) -> list[str]:
    if plate.kind == 3:
        return ["N"] * 8
    if plate.kind == 1:
        return ["N", "N", "N", "mm", "mm", moment_unit]
    return ["N"] * 3 + [moment_unit] * 3


def _add_plates(content: Any, plates: Sequence[PlateChannels], zero: tuple[int, int]) -> None:
    group = "FORCE_PLATFORM"
    widths = [plate.signals.shape[1] for plate in plates]
    channel = np.zeros((max(widths), len(plates)), dtype=int)
    first = 1
    for k, width in enumerate(widths):
        channel[:width, k] = np.arange(first, first + width)
        first += width
    _add(content, group, "USED", [len(plates)])
    _add(content, group, "TYPE", [plate.kind for plate in plates])
    _add(content, group, "ZERO", list(zero))
    _add(content, group, "CHANNEL", channel)
    content.add_parameter(group, "CORNERS", np.stack([plate.corners_mm.T for plate in plates], axis=2))
    content.add_parameter(group, "ORIGIN", np.array([plate.origin_mm for plate in plates], dtype=float).T)
    matrices = [np.zeros((6, 6)) if plate.calibration is None else plate.calibration for plate in plates]
    if any(plate.calibration is not None for plate in plates):
        content.add_parameter(group, "CAL_MATRIX", np.stack(matrices, axis=2))


def _add(content: Any, group: str, name: str, value: Any) -> None:
    array = np.asarray(value)
    integers = array.dtype.kind == "i"
    content.add_parameter(group, name, array.astype(float) if integers else value)
    if integers:
        content["parameters"][group][name]["type"] = ezc3d.ezc3d.INT
