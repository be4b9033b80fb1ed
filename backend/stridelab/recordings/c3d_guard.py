"""Checks of a C3D file's header and parameter records, before a C library gets to see them.

Layout after the C3D user manual (c3d.org): 512-byte header; parameter records, each a chain of groups and
parameters linked by 16-bit offsets; then frames of points and analog samples. ezc3d 1.7.2 trusts all of it: a damaged
byte in the wrong place is a crash or an endless loop there, and a refusal with a name here.
"""

import math
import struct
from dataclasses import dataclass, replace
from pathlib import Path

from stridelab.errors import Fault, UnreadableFile

_BLOCK = 512
_LAST_PARAMETER_BLOCK = 20
"""The parameters follow the header (block 2); some programs leave a little room. "%PDF" would be block 37."""
_MAX_POINTS = 2000
_MAX_ANALOG_PER_FRAME = 40000
_MAX_VALUES = 200_000_000
_NUMBERS = {
    "POINT": {"USED", "SCALE", "RATE", "DATA_START", "FRAMES"},
    "ANALOG": {"USED", "GEN_SCALE", "SCALE", "OFFSET", "RATE", "BITS"},
    "FORCE_PLATFORM": {"USED", "TYPE", "ZERO", "CORNERS", "ORIGIN", "CHANNEL", "CAL_MATRIX"},
    "ROTATION": {"USED", "DATA_START", "RATE", "RATIO"},
}
"""Parameters that ezc3d takes for numbers, and the first of them for the only one, without a look at their type."""
_SINGLE = {"USED", "RATE", "DATA_START", "FRAMES", "GEN_SCALE", "RATIO"}
_DEC = 85
_PROCESSORS = {84: "<", _DEC: "<", 86: ">"}
"""Intel, DEC and MIPS, with the byte order of their integers."""


@dataclass(frozen=True)
class _Record:
    """One record: number of its group, name, how many values it holds (texts count as one), whether of text, the first.

    A group's own record has its number below zero, and no values. Names are as written: ezc3d knows capitals only.
    """

    group: int
    name: str
    n_values: int = 0
    is_text: bool = False
    first: float = math.nan


def check_c3d(path: Path) -> None:
    """Raise ``UnreadableFile`` unless header, parameter section and data fit into the file.

    Its codes: ``empty-file``, ``not-c3d``, ``truncated-file``, ``c3d-parameters-broken``, ``absurd-c3d-header``.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(_BLOCK)
        if size == 0:
            raise UnreadableFile("empty-file", "The file is empty (0 bytes).", [Fault(path.name, "0 bytes")])
        if len(head) < 2 or head[1] != 0x50 or not 2 <= head[0] <= _LAST_PARAMETER_BLOCK:
            raise UnreadableFile("not-c3d", "This is not a C3D file.", [Fault(path.name, "no C3D key in the header")])
        if len(head) < _BLOCK or size < head[0] * _BLOCK:
            raise _truncated(path, "the header")
        file.seek((head[0] - 1) * _BLOCK)
        start = file.read(4)
        order = _PROCESSORS.get(start[3])
        if order is None:
            raise _broken(path, f"unknown processor type {start[3]}")
        if start[2] == 0:
            raise _broken(path, "it says that it is 0 blocks long")
        section = start + file.read(start[2] * _BLOCK - 4)
    n_points, n_analog, first, last = struct.unpack_from(order + "4H", head, 2)
    records = _follow_chain(path, section, start[3])
    _check_counts(path, n_points, n_analog, first, last)
    _check_data(path, head, order, size)
    _check_numbers(path, records)
    if n_analog:
        _check_analog(path, records)
        _check_rates(path, records, last - first + 1)


def _truncated(path: Path, what: str) -> UnreadableFile:
    return UnreadableFile(
        "truncated-file", f"The C3D file ends in the middle of {what}.", [Fault(path.name, "truncated")]
    )


def _broken(path: Path, what: str) -> UnreadableFile:
    return UnreadableFile(
        "c3d-parameters-broken", "The C3D file's parameter section is damaged.", [Fault(path.name, what)]
    )


def _follow_chain(path: Path, section: bytes, processor: int) -> list[_Record]:
    """All records; each must be whole and sane, and all must fit into the section.

    A record is: length of the name, group number (negative for a group itself), name, offset to the next record, then
    for a parameter its type, number of dimensions, dimensions and values, then the description with its length.
    """
    at, records, order = 4, [], _PROCESSORS[processor]
    try:
        while name_length := abs(struct.unpack_from("b", section, at)[0]):
            (group,) = struct.unpack_from("b", section, at + 1)
            name = section[at + 2 : at + 2 + name_length]
            link = at + 2 + name_length
            (step,) = struct.unpack_from(order + "H", section, link)
            if group == 0 or not name.strip(b" \0") or any(byte < 0x20 for byte in name.rstrip(b"\0")):
                raise _broken(path, f"a record at byte {at} has no proper name")
            known, length = _Record(group, name.decode("latin-1").strip()), 0
            if group > 0:
                known, length = _with_values(path, known, section, link + 2, processor)
            end = link + 2 + length
            end += 1 + section[end]
            if end > len(section):
                raise _truncated(path, "the parameter section")
            records.append(known)
            if step == 0:
                break
            if end > link + step:
                raise _broken(path, f"the record {records[-1].name} overlaps the next one")
            at = link + step
    except (struct.error, IndexError) as error:
        raise _truncated(path, "the parameter section") from error
    return records


def _with_values(path: Path, record: _Record, section: bytes, at: int, processor: int) -> tuple[_Record, int]:
    """A parameter with what it holds, and the bytes of its type, dimensions and values."""
    (kind,) = struct.unpack_from("b", section, at)
    n_dimensions = section[at + 1]
    if kind not in (-1, 1, 2, 4) or n_dimensions > 7:
        raise _broken(path, f"a parameter of type {kind} with {n_dimensions} dimensions")
    if kind == -1 and n_dimensions == 0:
        raise _broken(path, f"{record.name} is text without a length")  # ezc3d's process ends on it
    shape = section[at + 2 : at + 2 + n_dimensions]
    n_values = math.prod(shape[1:] if kind == -1 else shape)
    length = 2 + n_dimensions + abs(kind) * math.prod(shape)
    first = math.nan
    if kind != -1 and n_values and at + length <= len(section):
        first = _number(kind, section[at + 2 + n_dimensions :][:kind], processor)
    return replace(record, n_values=n_values, is_text=kind == -1, first=first), length


def _number(kind: int, raw: bytes, processor: int) -> float:
    """One value of ``kind`` bytes; a DEC float has its halves exchanged and an exponent that is two higher."""
    if kind == 4 and processor == _DEC:
        return float(struct.unpack("<f", raw[2:] + raw[:2])[0]) / 4.0
    return float(struct.unpack(_PROCESSORS[processor] + {1: "b", 2: "h", 4: "f"}[kind], raw)[0])


def _check_counts(path: Path, n_points: int, n_analog: int, first: int, last: int) -> None:
    """Counts of the header that no recording has."""
    what = None
    if n_points > _MAX_POINTS or n_analog > _MAX_ANALOG_PER_FRAME:
        what = f"{n_points} points and {n_analog} analog values per frame"
    elif (n_points or n_analog) and last < first:
        what = f"frames from {first} to {last}"
    elif (last - first + 1) * (4 * n_points + n_analog) > _MAX_VALUES:
        what = "more data than any recording has"
    if what is not None:
        raise UnreadableFile(
            "absurd-c3d-header", f"The C3D header promises {what}; that is no recording.", [Fault(path.name, what)]
        )


def _check_data(path: Path, head: bytes, order: str, size: int) -> None:
    """Frames times values must fit between the start of the data and the end of the file.

    A negative scale means four bytes per value; DEC floats have their sign in the second byte.
    """
    n_points, n_analog, first, last = struct.unpack_from(order + "4H", head, 2)
    values = (last - first + 1) * (4 * n_points + n_analog)
    if values == 0 or n_points + n_analog == 0:
        return
    (data_block,) = struct.unpack_from(order + "H", head, 16)
    signs = (head[12],) if order == ">" else (head[13], head[15])
    width = 4 if any(byte & 0x80 for byte in signs) else 2
    if data_block < 2 or (data_block - 1) * _BLOCK + values * width > size:
        raise _truncated(path, "its frames")


def _check_numbers(path: Path, records: list[_Record]) -> None:
    """Parameters that are read as numbers must be numbers, and there where one is needed."""
    groups = {-record.group: record.name for record in records if record.group < 0}
    for record in records:
        group = groups.get(record.group, "")
        if record.name not in _NUMBERS.get(group, ()):
            continue
        if record.is_text:
            raise _broken(path, f"{group}:{record.name} is text, not a number")
        if record.name in _SINGLE and record.n_values == 0:
            raise _broken(path, f"{group}:{record.name} has no value")


def _check_analog(path: Path, records: list[_Record]) -> None:
    """Analog samples need a scale and an offset per channel (in SCALE, SCALE2 ...); ezc3d reads them unchecked."""
    numbers = {record.group for record in records if record.name == "GEN_SCALE"}
    n_channels = _entries(records, numbers, "LABELS")
    for wanted in ("SCALE", "OFFSET"):
        n = _entries(records, numbers, wanted)
        if n == 0 or n < n_channels:
            raise _broken(path, f"ANALOG:{wanted} has {n} of {n_channels} entries")


def _check_rates(path: Path, records: list[_Record], n_frames: int) -> None:
    """ezc3d reads as many samples per frame as the rates say, whatever the header says."""
    groups = {record.name: -record.group for record in records if record.group < 0}
    first = {(record.group, record.name): record.first for record in records}
    used, rate_hz = (first.get((groups.get("ANALOG", 0), name), 0.0) for name in ("USED", "RATE"))
    frames_hz = first.get((groups.get("POINT", 0), "RATE"), 0.0)
    if frames_hz == 0.0:
        return
    per_frame = abs(used * rate_hz / frames_hz)
    if not (per_frame <= _MAX_ANALOG_PER_FRAME and per_frame * n_frames <= _MAX_VALUES):
        raise _broken(path, f"ANALOG:RATE is {rate_hz:g} Hz, for {used:g} channels and POINT:RATE {frames_hz:g} Hz")


def _entries(records: list[_Record], groups: set[int], name: str) -> int:
    return sum(r.n_values for r in records if r.group in groups and r.name.rstrip("0123456789") == name)
