"""Small C3D files, and files as other machines write them.

Small C3D files made by ezc3d.

C3D files made by tests: any markers, plate channels, parameters; so that every trap can be built on purpose.

C3D files of other machines, made from an Intel float file, and a plain reader of any: both without the product.

A C3D file as a DEC machine wrote it: every float with its halves exchanged and an exponent that is two higher.
"""

import math
import struct
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


BLOCK = 512
MACHINES = {"intel": 84, "dec": 85, "sgi": 86}
_EVENT_TIMES = 304


@dataclass(frozen=True)
class PlainC3d:
    """Counts of the header, parameters by (group, name) as (type, shape, values), and the frames as numbers."""

    n_points: int
    scale: float
    rate_hz: float
    data_block: int
    parameters: dict[tuple[str, str], tuple[int, tuple[int, ...], object]]
    points: np.ndarray
    analogs: np.ndarray

    def numbers(self, group: str, name: str) -> list[float]:
        """Values of a numeric parameter."""
        values = self.parameters[group, name][2]
        assert isinstance(values, list)
        return values

    def texts(self, group: str, name: str) -> list[str]:
        """Values of a text parameter."""
        kind, shape, raw = self.parameters[group, name]
        assert kind == -1
        assert isinstance(raw, bytes)
        width = shape[0]
        return [raw[i : i + width].decode("latin-1").rstrip() for i in range(0, len(raw), width)]


def read_plain(path: Path) -> PlainC3d:
    """Read a file of Intel's numbers by the manual: frames by the header, floats where its scale is negative."""
    content = path.read_bytes()
    assert content[515] == MACHINES["intel"]
    n_points, n_analog, first, last = struct.unpack_from("<4H", content, 2)
    scale, data_block, _, rate_hz = struct.unpack_from("<f2Hf", content, 12)
    kind = "<f4" if scale < 0.0 else "<i2"
    values = np.frombuffer(content, kind, (last - first + 1) * (4 * n_points + n_analog), (data_block - 1) * BLOCK)
    values = values.reshape(last - first + 1, -1).astype(float)
    groups: dict[int, str] = {}
    records: list[tuple[int, str, tuple[int, tuple[int, ...], object]]] = []
    for _, number, name, at in _records(content):
        if number < 0:
            groups[-number] = name
            continue
        (kind_of,) = struct.unpack_from("b", content, at)
        shape = tuple(content[at + 2 : at + 2 + content[at + 1]])
        start = at + 2 + content[at + 1]
        raw = content[start : start + abs(kind_of) * math.prod(shape)]
        read = (
            raw if kind_of == -1 else np.frombuffer(raw, {1: "i1", 2: "<i2", 4: "<f4"}[kind_of]).astype(float).tolist()
        )
        records.append((number, name, (kind_of, shape, read)))
    parameters = {(groups[number], name): value for number, name, value in records}
    points = values[:, : 4 * n_points].reshape(len(values), n_points, 4)
    return PlainC3d(n_points, scale, rate_hz, data_block, parameters, points, values[:, 4 * n_points :])


def with_integer_samples(content: bytes, scale: float, *, unsigned: bool = False) -> bytes:
    """An Intel float file with its points in steps of ``scale`` and its analog counts as 16-bit integers.

    ``unsigned`` moves the counts up by 32768 and says so in ANALOG:FORMAT (which must hold eight letters) and OFFSET.
    """
    n_points, n_analog, first, last = struct.unpack_from("<4H", content, 2)
    start = (struct.unpack_from("<H", content, 16)[0] - 1) * BLOCK
    n_frames = last - first + 1
    content_out = bytearray(content[:start])
    struct.pack_into("<f", content_out, 12, scale)
    for _, _, name, at in _records(content):
        if name == "SCALE" and content[at + 1] == 0:
            struct.pack_into("<f", content_out, at + 2, scale)
        if name == "OFFSET" and unsigned:
            n = content[at + 2]
            struct.pack_into(f"<{n}H", content_out, at + 3, *([32768] * n))
    values = (
        np.frombuffer(content, "<f4", n_frames * (4 * n_points + n_analog), start).reshape(n_frames, -1).astype(float)
    )
    points = values[:, : 4 * n_points].reshape(n_frames, n_points, 4).copy()
    points[np.isnan(points).any(axis=2)] = (0.0, 0.0, 0.0, -1.0)
    points[:, :, :3] = np.round(points[:, :, :3] / scale)
    counts = np.round(values[:, 4 * n_points :]) + (32768 if unsigned else 0)
    whole = np.concatenate([points.reshape(n_frames, -1), counts], axis=1).astype(np.int64).astype("<u2").tobytes()
    return bytes(content_out) + whole + bytes(-len(whole) % BLOCK)


def as_written_by(machine: str, content: bytes) -> bytes:
    """An Intel file, of floats or of integers, in the numbers of another machine."""
    content_out = bytearray(content)
    content_out[515] = MACHINES[machine]
    (scale,) = struct.unpack_from("<f", content, 12)
    (data_block,) = struct.unpack_from("<H", content, 16)
    start = (data_block - 1) * BLOCK
    for at in (*range(2, 12, 2), 16, 18, *range(294, 302, 2)):
        _turn(content_out, at, 2, 1, machine)
    for at in (12, 20):
        _turn(content_out, at, 4, 1, machine)
    _turn(content_out, _EVENT_TIMES, 4, 18, machine)
    for link, number, _, at in _records(content):
        _turn(content_out, link, 2, 1, machine)
        if number > 0 and content[at] in (2, 4):
            n = math.prod(content[at + 2 : at + 2 + content[at + 1]])
            _turn(content_out, at + 2 + content[at + 1], content[at], n, machine)
    width = 4 if scale < 0.0 else 2
    _turn(content_out, start, width, (len(content) - start) // width, machine)
    return bytes(content_out)


def parameter_at(content: bytes, group: str, name: str) -> int:
    """Offset of the type of a parameter; its dimensions and values follow."""
    numbers = {parameter_name: -number for _, number, parameter_name, _ in _records(content) if number < 0}
    return next(
        at for _, number, parameter_name, at in _records(content) if (number, parameter_name) == (numbers[group], name)
    )


def with_parameter(content: bytes, group: str, name: str, values: bytes, description: bytes = b"") -> bytes:
    """The file with type, dimensions and values of a parameter replaced; the room in front of the data pays for it."""
    at = parameter_at(content, group, name)
    n_values = math.prod(content[at + 2 : at + 2 + content[at + 1]])
    end = at + 2 + content[at + 1] + abs(struct.unpack_from("b", content, at)[0]) * n_values
    end += 1 + content[end]
    new = values + bytes([len(description)]) + description
    grown = len(new) - (end - at)
    start = (struct.unpack_from("<H", content, 16)[0] - 1) * BLOCK
    assert not content[start - grown : start].strip(b"\0")
    content_out = bytearray(content[:at] + new + content[end : start - grown] + content[start:])
    struct.pack_into("<H", content_out, at - 2, 2 + len(new))
    return bytes(content_out)


def _turn(content_out: bytearray, at: int, width: int, count: int, machine: str) -> None:
    raw = bytes(content_out[at : at + width * count])
    if machine == "sgi":
        content_out[at : at + width * count] = np.frombuffer(raw, f"<u{width}").astype(f">u{width}").tobytes()
    elif machine == "dec" and width == 4:
        halves = (np.frombuffer(raw, "<f4") * np.float32(4.0)).astype("<f4").view("<u2").reshape(-1, 2)[:, ::-1]
        content_out[at : at + width * count] = np.ascontiguousarray(halves).tobytes()


def _records(content: bytes) -> list[tuple[int, int, str, int]]:
    """For each record: offset of its link, number of its group, name, and offset of its data."""
    at, records = BLOCK + 4, []
    while length := abs(struct.unpack_from("b", content, at)[0]):
        (number,) = struct.unpack_from("b", content, at + 1)
        link = at + 2 + length
        records.append((link, number, content[at + 2 : link].decode("latin-1"), link + 2))
        (step,) = struct.unpack_from("<H", content, link)
        if step == 0:
            break
        at = link + step
    return records


def with_dec_floats(content: bytes) -> bytes:
    """The same file, from one of Intel's with floats for its frames."""
    content_out = bytearray(content)
    content_out[515] = 85
    _exchange(content_out, 12, 1)
    _exchange(content_out, 20, 1)
    for at, count in _floats(content):
        _exchange(content_out, at, count)
    (first,) = struct.unpack_from("<H", content, 16)
    start = (first - 1) * BLOCK
    _exchange(content_out, start, (len(content) - start) // 4)
    return bytes(content_out)


def _exchange(content_out: bytearray, at: int, count: int) -> None:
    values = np.frombuffer(bytes(content_out[at : at + 4 * count]), "<f4") * np.float32(4.0)
    halves = values.astype("<f4").view("<u2").reshape(-1, 2)[:, ::-1]
    content_out[at : at + 4 * count] = np.ascontiguousarray(halves).tobytes()


def _floats(content: bytes) -> list[tuple[int, int]]:
    """Offsets and counts of the floats in the parameters."""
    at, offsets = BLOCK + 4, []
    while length := abs(struct.unpack_from("b", content, at)[0]):
        (group,) = struct.unpack_from("b", content, at + 1)
        link = at + 2 + length
        (step,) = struct.unpack_from("<H", content, link)
        if group > 0 and content[link + 2] == 4:
            n = content[link + 3]
            offsets.append((link + 4 + n, int(np.prod(list(content[link + 4 : link + 4 + n]), dtype=int))))
        if step == 0:
            break
        at = link + step
    return offsets
