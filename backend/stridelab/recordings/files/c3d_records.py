"""Header and parameter records of a C3D file, in the number formats of Intel, DEC and SGI/MIPS machines.

Layout after the C3D user manual (c3d.org): a 512-byte header; parameter records, each a chain of groups and parameters
linked by 16-bit offsets; then frames of points and analog samples.

Determines the data layout of a C3D file whose header, parameters and size may disagree.

The header and the parameters both state the counts, and some programs keep only one of them correct. The counts must
satisfy: start of the data + frames x values per frame x bytes per value fits into the file; of two candidates that fit,
the one that leaves less data unread is used.
"""

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.errors import Fault, UnreadableFile

BLOCK: Final = 512
INTEL: Final = 84
DEC: Final = 85
MIPS: Final = 86
BYTE_ORDER: Final = {INTEL: "<", DEC: "<", MIPS: ">"}
"""Byte order of an integer by processor type."""

Values = Float[np.ndarray, " values"]


@dataclass(frozen=True)
class Header:
    """Header fields with the position and the counts of the data.

    ``n_analog`` counts the analog samples per frame over all channels, ``ratio`` those of one channel.
    ``first_frame`` and ``last_frame`` are as written, ``data_block`` counts blocks from 1.
    """

    processor: int
    n_points: int
    n_analog: int
    first_frame: int
    last_frame: int
    scale: float
    data_block: int
    ratio: int
    rate_hz: float

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return self.last_frame - self.first_frame + 1

    @property
    def data_start(self) -> int:
        """Offset of the first frame in bytes."""
        return (self.data_block - 1) * BLOCK


@dataclass(frozen=True)
class Record:
    """One group or parameter.

    The record of a group has a negative number and ``kind`` 0. Names are as in the file; ezc3d reads upper case only.
    ``kind`` is -1 for text, otherwise the bytes per number; ``raw`` holds the values in the file's number format.
    ``has_description`` is False where the next record follows the values at once, without the length of a description.
    """

    group: int
    name: str
    locked: bool = False
    description: bytes = b""
    kind: int = 0
    shape: tuple[int, ...] = ()
    raw: bytes = b""
    has_description: bool = True

    @property
    def is_text(self) -> bool:
        """Whether the values are characters."""
        return self.kind == -1

    @property
    def n_values(self) -> int:
        """Number of values; a text counts as one."""
        return 0 if self.kind == 0 else math.prod(self.shape[1:] if self.is_text else self.shape)

    def texts(self) -> list[str]:
        """The texts without trailing blanks."""
        width = self.shape[0] if self.shape else 0
        pieces = [self.raw[i * width : (i + 1) * width] for i in range(self.n_values)] if width else []
        return [piece.decode("latin-1").rstrip(" \0") for piece in pieces]


def read_header(head: bytes, processor: int) -> Header:
    """Parse the 512 bytes ``head`` of a header."""
    order = BYTE_ORDER[processor]
    n_points, n_analog, first, last = struct.unpack_from(order + "4H", head, 2)
    data_block, ratio = struct.unpack_from(order + "2H", head, 16)
    scale, rate_hz = (float(decode_floats(head[at : at + 4], processor)[0]) for at in (12, 20))
    return Header(processor, n_points, n_analog, first, last, scale, data_block, ratio, rate_hz)


def decode_floats(raw: bytes, processor: int) -> Values:
    """Decode four-byte floats.

    A number of DEC has its halves exchanged, and is (-1)^s (0.5 + m / 2^24) 2^(e - 128) with the sign s, the exponent e
    and the 23 bits m of its fraction; 0 if e is 0. NaN if e is 255, as programs
    on other machines write it.
    """
    if processor != DEC:
        with np.errstate(invalid="ignore"):  # a signalling NaN becomes a quiet one
            return np.frombuffer(raw, BYTE_ORDER[processor] + "f4").astype(np.float64)
    halves = np.frombuffer(raw, "<u2").reshape(-1, 2).astype(np.int32)
    negative, exponent = halves[:, 0] >> 15, (halves[:, 0] >> 7) & 0xFF
    fraction = (((halves[:, 0] & 0x7F) << 16) | halves[:, 1]) / 2.0**24
    magnitude = np.where(exponent == 0, 0.0, np.ldexp(0.5 + fraction, exponent - 128))
    values = np.where(negative == 1, -magnitude, magnitude)
    return np.where(exponent == 255, np.nan, values)


def numeric_values(record: Record, processor: int) -> Values:
    """All values of a numeric parameter in the file's order; empty for text."""
    if record.kind == 4:
        return decode_floats(record.raw, processor)
    if record.kind not in (1, 2):
        return np.zeros(0)
    return np.frombuffer(record.raw, f"{BYTE_ORDER[processor]}i{record.kind}").astype(np.float64)


def group_numbers(records: Sequence[Record]) -> dict[str, int]:
    """Numbers of the groups by name in upper case."""
    return {record.name.upper(): -record.group for record in records if record.group < 0}


def find_parameter(records: Sequence[Record], group: str, name: str) -> Record | None:
    """Last parameter ``group:name`` (given in upper case, matched in any case); None if absent."""
    number = group_numbers(records).get(group)
    matches = [record for record in records if record.group == number and record.name.upper() == name]
    return matches[-1] if matches else None


def find_continued(records: Sequence[Record], group: str, name: str) -> list[Record]:
    """The parameters NAME, NAME2, NAME3 ... of a list with more than 255 entries."""
    parts: list[Record] = []
    while (record := find_parameter(records, group, name + (str(len(parts) + 1) if parts else ""))) is not None:
        parts.append(record)
    return parts


def read_records(section: bytes, processor: int, file_name: str) -> list[Record]:
    """Parse all records of a parameter section, which begins with four bytes of its own.

    A record is: length of the name (negative where locked), group number (negative for a group itself), name, offset to
    the next record, then for a parameter its type, number of dimensions, dimensions and values, then the description
    with its length. Some writers omit the length of a description that is empty: then the offset ends with the values.
    Raises ``UnreadableFile`` (``c3d-parameters-broken``, ``truncated-file``) for an incomplete or
    invalid record, or one that exceeds the section.
    """
    at, records, order = 4, [], BYTE_ORDER[processor]
    try:
        while length := struct.unpack_from("b", section, at)[0]:
            (group,) = struct.unpack_from("b", section, at + 1)
            name = section[at + 2 : at + 2 + abs(length)]
            link = at + 2 + abs(length)
            (step,) = struct.unpack_from(order + "H", section, link)
            if group == 0 or not name.strip(b" \0") or any(byte < 0x20 for byte in name.rstrip(b"\0")):
                raise broken_parameters_error(file_name, f"a record at byte {at} has no proper name")
            title = name.decode("latin-1").strip()
            kind, shape, raw, end = (
                _parse_values(section, link + 2, title, file_name) if group > 0 else (0, (), b"", link + 2)
            )
            has_description = step == 0 or end != link + step
            description = section[end + 1 : end + 1 + section[end]] if has_description else b""
            end += 1 + section[end] if has_description else 0
            if end > len(section):
                raise truncated_file_error(file_name, "the parameter section")
            records.append(Record(group, title, length < 0, description, kind, shape, raw, has_description))
            if step == 0:
                break
            if end > link + step:
                raise broken_parameters_error(file_name, f"the record {title} overlaps the next one")
            if link + step > len(section) and not section[end:].strip(b"\0"):
                break  # the offset of the last record points beyond the section
            at = link + step
    except (struct.error, IndexError) as error:
        raise truncated_file_error(file_name, "the parameter section") from error
    return records


def _parse_values(section: bytes, at: int, name: str, file_name: str) -> tuple[int, tuple[int, ...], bytes, int]:
    """Type, dimensions and values of a parameter, and the offset of their end."""
    (kind,) = struct.unpack_from("b", section, at)
    n_dimensions = section[at + 1]
    if kind not in (-1, 1, 2, 4) or n_dimensions > 7:
        raise broken_parameters_error(file_name, f"a parameter of type {kind} with {n_dimensions} dimensions")
    if kind == -1 and n_dimensions == 0:
        raise broken_parameters_error(file_name, f"{name} is text without a length")  # ezc3d crashes on it
    start = at + 2 + n_dimensions
    shape = tuple(section[at + 2 : start])
    end = start + abs(kind) * math.prod(shape)
    return kind, shape, section[start:end], end


def truncated_file_error(file_name: str, what: str) -> UnreadableFile:
    """Error for a file that ends too early (``truncated-file``)."""
    return UnreadableFile(
        "truncated-file", f"The C3D file ends in the middle of {what}.", [Fault(file_name, "truncated")]
    )


def broken_parameters_error(file_name: str, what: str) -> UnreadableFile:
    """Error for a damaged parameter section (``c3d-parameters-broken``)."""
    return UnreadableFile(
        "c3d-parameters-broken", "The C3D file's parameter section is damaged.", [Fault(file_name, what)]
    )


_SATURATED = 0xFFFF
"""Largest frame number in a header; longer recordings state their frames in the parameters only."""


@dataclass(frozen=True)
class Layout:
    """Counts of a file that are consistent with its size; ``width`` is 4 bytes per value for floats, 2 for integers.

    ``n_channels`` x ``ratio`` analog samples follow the points of a frame.
    """

    n_frames: int
    n_points: int
    n_channels: int
    ratio: int
    width: int
    data_start: int

    @property
    def values_per_frame(self) -> int:
        """Number of values of all points and analog samples of a frame."""
        return 4 * self.n_points + self.n_channels * self.ratio

    @property
    def data_end(self) -> int:
        """Offset after the last value in bytes."""
        return self.data_start + self.n_frames * self.values_per_frame * self.width


def first_number(header: Header, records: Sequence[Record], group: str, name: str) -> float | None:
    """First value of a numeric parameter; None if absent."""
    record = find_parameter(records, group, name)
    values = np.zeros(0) if record is None else numeric_values(record, header.processor)
    return float(values[0]) if len(values) else None


def find_layout(header: Header, records: Sequence[Record], size: int) -> Layout:
    """Layout of a file of ``size`` bytes: that of the header, unless only that of the parameters fits the size.

    If the header's layout leaves more than padding after the frames, the layouts of the parameters are candidates, too,
    and the longest that fits is used. The returned layout may not fit if the file is truncated.
    """
    used = first_number(header, records, "ANALOG", "USED")
    points = first_number(header, records, "POINT", "USED")
    scale = first_number(header, records, "POINT", "SCALE")
    ratio = header.ratio or 1
    if header.n_analog % ratio or (header.n_analog and not header.ratio):
        ratio = header.n_analog // int(used) if used and used > 0 and header.n_analog % used == 0 else 1
    channels = header.n_analog // ratio
    stated = Layout(
        n_frames=_frame_count(header, records),
        n_points=header.n_points,
        n_channels=channels,
        ratio=ratio if channels else 0,
        width=4 if header.scale < 0.0 else 2,
        data_start=header.data_start,
    )
    if 0 <= size - stated.data_end < 2 * BLOCK:
        return stated
    options = [stated]
    if scale is not None and (scale < 0.0) != (header.scale < 0.0):
        options.append(replace(stated, width=6 - stated.width))
    if points is not None and 0 <= points != header.n_points:
        options += [replace(option, n_points=int(points)) for option in options]
    if used is not None and used >= 0 and (used, header.ratio) != (channels, ratio):
        options += [replace(option, n_channels=int(used), ratio=header.ratio or 1) for option in options]
    fitting = [option for option in options if option.data_end <= size]
    return max(fitting, key=lambda option: option.data_end) if fitting else stated


def _frame_count(header: Header, records: Sequence[Record]) -> int:
    """Frames of the header; if saturated, of TRIAL:ACTUAL_START_FIELD and _END_FIELD or POINT:FRAMES."""
    if header.last_frame != _SATURATED:
        return max(0, header.n_frames)
    fields = [find_parameter(records, "TRIAL", f"ACTUAL_{end}_FIELD") for end in ("START", "END")]
    ends = [numeric_values(field, header.processor) % 65536 for field in fields if field is not None]
    if len(ends) == 2 and all(len(end) == 2 for end in ends):
        first, last = (int(low + 65536 * high) for low, high in ends)
        return max(header.n_frames, last - first + 1)
    frames = first_number(header, records, "POINT", "FRAMES")
    return max(header.n_frames, int(frames)) if frames is not None else header.n_frames
