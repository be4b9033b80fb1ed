"""C3D files of other machines, made from an Intel float file, and a plain reader of any: both without the product.

A C3D file as a DEC machine wrote it: every float with its halves exchanged and an exponent that is two higher.
"""

import math
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

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
    found: list[tuple[int, str, tuple[int, tuple[int, ...], object]]] = []
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
        found.append((number, name, (kind_of, shape, read)))
    parameters = {(groups[number], name): value for number, name, value in found}
    points = values[:, : 4 * n_points].reshape(len(values), n_points, 4)
    return PlainC3d(n_points, scale, rate_hz, data_block, parameters, points, values[:, 4 * n_points :])


def as_integers(content: bytes, scale: float, *, unsigned: bool = False) -> bytes:
    """An Intel float file with its points in steps of ``scale`` and its analog counts as 16-bit integers.

    ``unsigned`` moves the counts up by 32768 and says so in ANALOG:FORMAT (which must hold eight letters) and OFFSET.
    """
    n_points, n_analog, first, last = struct.unpack_from("<4H", content, 2)
    start = (struct.unpack_from("<H", content, 16)[0] - 1) * BLOCK
    n_frames = last - first + 1
    made = bytearray(content[:start])
    struct.pack_into("<f", made, 12, scale)
    for _, _, name, at in _records(content):
        if name == "SCALE" and content[at + 1] == 0:
            struct.pack_into("<f", made, at + 2, scale)
        if name == "OFFSET" and unsigned:
            n = content[at + 2]
            struct.pack_into(f"<{n}H", made, at + 3, *([32768] * n))
    values = (
        np.frombuffer(content, "<f4", n_frames * (4 * n_points + n_analog), start).reshape(n_frames, -1).astype(float)
    )
    points = values[:, : 4 * n_points].reshape(n_frames, n_points, 4).copy()
    points[np.isnan(points).any(axis=2)] = (0.0, 0.0, 0.0, -1.0)
    points[:, :, :3] = np.round(points[:, :, :3] / scale)
    counts = np.round(values[:, 4 * n_points :]) + (32768 if unsigned else 0)
    whole = np.concatenate([points.reshape(n_frames, -1), counts], axis=1).astype(np.int64).astype("<u2").tobytes()
    return bytes(made) + whole + bytes(-len(whole) % BLOCK)


def as_written_by(machine: str, content: bytes) -> bytes:
    """An Intel file, of floats or of integers, in the numbers of another machine."""
    made = bytearray(content)
    made[515] = MACHINES[machine]
    (scale,) = struct.unpack_from("<f", content, 12)
    (data_block,) = struct.unpack_from("<H", content, 16)
    start = (data_block - 1) * BLOCK
    for at in (*range(2, 12, 2), 16, 18, *range(294, 302, 2)):
        _turn(made, at, 2, 1, machine)
    for at in (12, 20):
        _turn(made, at, 4, 1, machine)
    _turn(made, _EVENT_TIMES, 4, 18, machine)
    for link, number, _, at in _records(content):
        _turn(made, link, 2, 1, machine)
        if number > 0 and content[at] in (2, 4):
            n = math.prod(content[at + 2 : at + 2 + content[at + 1]])
            _turn(made, at + 2 + content[at + 1], content[at], n, machine)
    width = 4 if scale < 0.0 else 2
    _turn(made, start, width, (len(content) - start) // width, machine)
    return bytes(made)


def parameter_at(content: bytes, group: str, name: str) -> int:
    """Offset of the type of a parameter; its dimensions and values follow."""
    numbers = {wanted: -number for _, number, wanted, _ in _records(content) if number < 0}
    return next(at for _, number, wanted, at in _records(content) if (number, wanted) == (numbers[group], name))


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
    made = bytearray(content[:at] + new + content[end : start - grown] + content[start:])
    struct.pack_into("<H", made, at - 2, 2 + len(new))
    return bytes(made)


def _turn(made: bytearray, at: int, width: int, count: int, machine: str) -> None:
    raw = bytes(made[at : at + width * count])
    if machine == "sgi":
        made[at : at + width * count] = np.frombuffer(raw, f"<u{width}").astype(f">u{width}").tobytes()
    elif machine == "dec" and width == 4:
        halves = (np.frombuffer(raw, "<f4") * np.float32(4.0)).astype("<f4").view("<u2").reshape(-1, 2)[:, ::-1]
        made[at : at + width * count] = np.ascontiguousarray(halves).tobytes()


def _records(content: bytes) -> list[tuple[int, int, str, int]]:
    """Of each record: where its link is, number of its group, name, and what follows the link."""
    at, found = BLOCK + 4, []
    while length := abs(struct.unpack_from("b", content, at)[0]):
        (number,) = struct.unpack_from("b", content, at + 1)
        link = at + 2 + length
        found.append((link, number, content[at + 2 : link].decode("latin-1"), link + 2))
        (step,) = struct.unpack_from("<H", content, link)
        if step == 0:
            break
        at = link + step
    return found


def as_dec(content: bytes) -> bytes:
    """The same file, from one of Intel's with floats for its frames."""
    made = bytearray(content)
    made[515] = 85
    _exchange(made, 12, 1)
    _exchange(made, 20, 1)
    for at, count in _floats(content):
        _exchange(made, at, count)
    (first,) = struct.unpack_from("<H", content, 16)
    start = (first - 1) * BLOCK
    _exchange(made, start, (len(content) - start) // 4)
    return bytes(made)


def _exchange(made: bytearray, at: int, count: int) -> None:
    values = np.frombuffer(bytes(made[at : at + 4 * count]), "<f4") * np.float32(4.0)
    halves = values.astype("<f4").view("<u2").reshape(-1, 2)[:, ::-1]
    made[at : at + 4 * count] = np.ascontiguousarray(halves).tobytes()


def _floats(content: bytes) -> list[tuple[int, int]]:
    """Where in the parameters floats begin, and how many they are."""
    at, found = BLOCK + 4, []
    while length := abs(struct.unpack_from("b", content, at)[0]):
        (group,) = struct.unpack_from("b", content, at + 1)
        link = at + 2 + length
        (step,) = struct.unpack_from("<H", content, link)
        if group > 0 and content[link + 2] == 4:
            n = content[link + 3]
            found.append((link + 4 + n, int(np.prod(list(content[link + 4 : link + 4 + n]), dtype=int))))
        if step == 0:
            break
        at = link + step
    return found
