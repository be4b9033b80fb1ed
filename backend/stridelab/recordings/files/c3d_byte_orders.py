"""Converts C3D files of any processor type and number format to Intel floats.

Points of an integer file are multiplied by POINT:SCALE; analog samples keep their raw counts, as the C3D user manual
specifies for float files. A negative scale, in POINT:SCALE and in the header, marks a float file.

Validates the header and parameter records of a C3D file before ezc3d reads it.

Layout after the C3D user manual (c3d.org): 512-byte header; parameter records, each a chain of groups and
parameters linked by 16-bit offsets; then frames of points and analog samples. ezc3d 1.7.2 does not validate them: a
damaged byte can crash it or cause an endless loop. Here it raises an error with a specific code.
"""

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32, Int, Num

from stridelab.errors import Fault, UnreadableFile
from stridelab.recordings.files.c3d_records import (
    BLOCK,
    BYTE_ORDER,
    DEC,
    INTEL,
    Header,
    Layout,
    Record,
    broken_parameters_error,
    decode_floats,
    find_continued,
    find_layout,
    find_parameter,
    first_number,
    group_numbers,
    numeric_values,
    read_header,
    read_records,
    truncated_file_error,
)

_LAST_PARAMETER_BLOCK = 20
"""Last block at which the parameters may start: usually 2; some programs leave a gap. "%PDF" would be block 37."""
_MAX_POINTS = 2000
_MAX_ANALOG_PER_FRAME = 40000
_MAX_VALUES = 200_000_000
_NUMBERS = {
    "POINT": {"USED", "SCALE", "RATE", "DATA_START", "FRAMES"},
    "ANALOG": {"USED", "GEN_SCALE", "SCALE", "OFFSET", "RATE", "BITS"},
    "FORCE_PLATFORM": {"USED", "TYPE", "ZERO", "CORNERS", "ORIGIN", "CHANNEL", "CAL_MATRIX"},
    "ROTATION": {"USED", "DATA_START", "RATE", "RATIO"},
}
"""Parameters that ezc3d reads as numbers without checking their type."""
_SINGLE = {"USED", "RATE", "DATA_START", "FRAMES", "GEN_SCALE", "RATIO"}


@dataclass(frozen=True)
class CheckedC3d:
    """Validated header, parameters and data layout of a file; ``lacks_frame`` if it ends one frame early."""

    header: Header
    records: tuple[Record, ...]
    layout: Layout
    lacks_frame: bool = False


def check_c3d(path: Path) -> CheckedC3d:
    """Read and validate header, parameters and layout of a file.

    The parameter section is read up to the data, even if it states fewer blocks. Raises ``UnreadableFile``
    (``empty-file``, ``not-c3d``, ``truncated-file``, ``c3d-parameters-broken``, ``absurd-c3d-header``) unless header,
    parameter section and data are valid and fit into the file.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(BLOCK)
        if size == 0:
            raise UnreadableFile("empty-file", "The file is empty (0 bytes).", [Fault(path.name, "0 bytes")])
        if len(head) < 2 or head[1] != 0x50 or not 2 <= head[0] <= _LAST_PARAMETER_BLOCK:
            raise UnreadableFile("not-c3d", "This is not a C3D file.", [Fault(path.name, "no C3D key in the header")])
        if len(head) < BLOCK or size < head[0] * BLOCK:
            raise truncated_file_error(path.name, "the header")
        begin = (head[0] - 1) * BLOCK
        file.seek(begin)
        start = file.read(4)
        if start[3] not in BYTE_ORDER:
            raise broken_parameters_error(path.name, f"unknown processor type {start[3]}")
        header = read_header(head, start[3])
        section = start + file.read(max(start[2] * BLOCK, header.data_start - begin) - 4)
    records = tuple(read_records(section, header.processor, path.name))
    if not records:
        if not any(section[4:]):
            _refuse_nameless_points(path, header, size)
        raise broken_parameters_error(path.name, f"it holds no parameters; its stated length is {start[2]} blocks")
    _check_counts(path, header)
    if header.n_points + header.n_analog and header.data_block >= 2 and header.data_start < begin + len(section):
        try:
            read_records(section[: max(0, header.data_start - begin)], header.processor, path.name)
        except UnreadableFile as error:
            what = f"the header states frames from block {header.data_block} on, where parameters are"
            raise broken_parameters_error(path.name, what) from error
    layout = find_layout(header, records, size)
    if layout.values_per_frame and header.data_block < 2:
        what = f"the header states frames from block {header.data_block} on, which is the header itself"
        raise broken_parameters_error(path.name, what)
    lacks_frame = bool(layout.values_per_frame) and layout.data_end > size
    if lacks_frame:
        layout = _without_last_frame(path, layout, size)
    _check_numbers(path, records)
    if header.n_analog:
        _check_rates(path, header, records)
    return CheckedC3d(header, records, layout, lacks_frame)


def _without_last_frame(path: Path, layout: Layout, size: int) -> Layout:
    """``layout`` with one frame less, if the file ends there.

    Some programs count one frame too many. Their file ends with a frame, or with less than a block of zeros after it;
    one that was cut off ends within a frame. Raises ``UnreadableFile`` (``truncated-file``) for the latter.
    """
    shorter = replace(layout, n_frames=layout.n_frames - 1)
    if shorter.n_frames >= 1 and 0 <= size - shorter.data_end < BLOCK:
        with path.open("rb") as file:
            file.seek(shorter.data_end)
            if not any(file.read()):
                return shorter
    raise truncated_file_error(path.name, "its frames")


def _refuse_nameless_points(path: Path, header: Header, size: int) -> None:
    """Raise ``no-markers`` if the frames of the header fill a file of blank parameters: its points have no names."""
    layout = find_layout(header, (), size)
    if layout.n_points and 0 <= size - layout.data_end < BLOCK:
        what = f"{layout.n_points} points in {layout.n_frames} frames, without names"
        raise UnreadableFile("no-markers", f"The C3D file holds {what}, and no parameters.", [Fault(path.name, what)])


def _check_counts(path: Path, header: Header) -> None:
    """Raise ``absurd-c3d-header`` for counts that are implausible for a recording."""
    what = None
    n_points, n_analog = header.n_points, header.n_analog
    if n_points > _MAX_POINTS or n_analog > _MAX_ANALOG_PER_FRAME:
        what = f"{n_points} points and {n_analog} analog values per frame"
    elif (n_points or n_analog) and header.last_frame < header.first_frame:
        what = f"frames from {header.first_frame} to {header.last_frame}"
    elif header.n_frames * (4 * n_points + n_analog) > _MAX_VALUES:
        what = "more data than any recording has"
    if what is not None:
        raise UnreadableFile(
            "absurd-c3d-header", f"The C3D header states {what}; this is implausible.", [Fault(path.name, what)]
        )


def _check_numbers(path: Path, records: Sequence[Record]) -> None:
    """Raise unless the parameters that ezc3d reads as numbers are numeric and not empty."""
    groups = {number: name for name, number in group_numbers(records).items()}
    for record in records:
        group, name = groups.get(record.group, ""), record.name.upper()
        if name not in _NUMBERS.get(group, ()):
            continue
        if record.is_text:
            raise broken_parameters_error(path.name, f"{group}:{name} is text, not a number")
        if name in _SINGLE and record.n_values == 0:
            raise broken_parameters_error(path.name, f"{group}:{name} has no value")


def _check_rates(path: Path, header: Header, records: Sequence[Record]) -> None:
    """Raise if the rates imply too many samples: ezc3d computes the samples per frame from the rates."""
    used, rate_hz = (first_number(header, records, "ANALOG", name) or 0.0 for name in ("USED", "RATE"))
    frames_hz = first_number(header, records, "POINT", "RATE") or 0.0
    if frames_hz == 0.0:
        return
    per_frame = abs(used * rate_hz / frames_hz)
    if not (per_frame <= _MAX_ANALOG_PER_FRAME and per_frame * header.n_frames <= _MAX_VALUES):
        raise broken_parameters_error(
            path.name, f"ANALOG:RATE is {rate_hz:g} Hz, for {used:g} channels and POINT:RATE {frames_hz:g} Hz"
        )


Raw = Float32[np.ndarray, "frames values"]
PointValues = Float32[np.ndarray, "frames point_values"]
AnalogValues = Float32[np.ndarray, "frames analog_values"]
_EVENT_TIMES = slice(304, 376)
_TYPES = {("ANALOG", "OFFSET"): 2, ("ANALOG", "SCALE"): 4, ("ANALOG", "GEN_SCALE"): 4, ("ANALOG", "RATE"): 4}
"""Parameter types of the C3D user manual: 2 for integers, 4 for floats. Other readers rely on them."""
_MAX_ENTRIES = 255
"""Maximum number of entries of a parameter list; further entries go to NAME2, NAME3 ..."""


@dataclass(frozen=True)
class C3dContent:
    """A whole file in Intel's number format.

    ``points`` are four values per point (x, y, z in the file's unit; residual and cameras, negative for a missing
    point), ``analogs`` raw counts, ``scale`` the magnitude of POINT:SCALE, ``tail`` the data of a ROTATION group after
    the frames, in whole blocks.
    """

    head: bytes
    records: tuple[Record, ...]
    layout: Layout
    points: PointValues
    analogs: AnalogValues
    scale: float
    tail: bytes = b""


def read_content(path: Path, checked: CheckedC3d) -> C3dContent:
    """Read a whole file that has passed ``check_c3d``."""
    content = path.read_bytes()
    header, records, layout = checked.header, checked.records, checked.layout
    processor = header.processor
    scales = (first_number(header, records, "POINT", "SCALE") or 0.0, header.scale)
    stated = next((scale for scale in scales if scale and math.isfinite(scale)), 1.0)
    raw = _decode_values(content[layout.data_start : layout.data_end], processor, layout)
    points, analogs = raw[:, : 4 * layout.n_points], raw[:, 4 * layout.n_points :]
    if layout.width == 2:
        fourth = points[:, 3::4]
        points = points * np.float32(abs(stated))
        points[:, 3::4] = np.where(fourth < 0.0, np.float32(-1.0), fourth)
        if is_unsigned(records):
            analogs = analogs % np.float32(65536.0)
    rotations = first_number(header, records, "ROTATION", "DATA_START") or 0.0
    tail_start = (int(rotations) - 1) * BLOCK
    tail = content[tail_start:] if processor == INTEL and tail_start >= layout.data_end else b""
    head = _intel_head(content[:BLOCK], processor)
    records = tuple(_record_as_intel(record, processor) for record in records)
    if checked.lacks_frame:
        head = head[:8] + struct.pack("<H", header.first_frame + layout.n_frames - 1) + head[10:]
        records = with_numbers(records, "POINT", "FRAMES", int16_scalar(layout.n_frames))
    return C3dContent(
        head=head,
        records=records,
        layout=layout,
        points=points,
        analogs=analogs,
        scale=abs(stated),
        tail=tail,
    )


def write_content(file: C3dContent, *, padded: bool = True) -> bytes:
    """Serialise the file; updates USED, SCALE and DATA_START of POINT, and the header.

    Numbers of ANALOG get the types of the manual if that changes no value. ``padded`` fills the last block.
    """
    layout = file.layout
    records: Sequence[Record] = _with_manual_types(file.records)
    records = with_numbers(records, "POINT", "USED", int16_scalar(layout.n_points))
    records = with_numbers(records, "POINT", "SCALE", np.array([-file.scale], dtype="<f4"))
    records = with_numbers(records, "POINT", "DATA_START", int16_scalar(0))
    n_blocks = -(-(6 + sum(len(record_bytes(record)) for record in records)) // BLOCK)
    values = np.concatenate([file.points, file.analogs], axis=1).astype("<f4").tobytes()
    if padded or file.tail:
        values += bytes(-len(values) % BLOCK)
    data_block = 2 + n_blocks
    records = with_numbers(records, "POINT", "DATA_START", int16_scalar(data_block))
    if file.tail:
        records = with_numbers(records, "ROTATION", "DATA_START", int16_scalar(data_block + len(values) // BLOCK))
    section = bytes([1, 0x50, min(n_blocks, 255), INTEL]) + b"".join(record_bytes(record) for record in records)
    head = bytearray(file.head)
    head[0] = 2
    struct.pack_into("<2H", head, 2, layout.n_points, layout.n_channels * layout.ratio)
    struct.pack_into("<fH", head, 12, -file.scale, data_block)
    if layout.n_channels:
        struct.pack_into("<H", head, 18, layout.ratio)
    return bytes(head) + section.ljust(n_blocks * BLOCK, b"\0") + values + file.tail


def is_unsigned(records: Sequence[Record]) -> bool:
    """Whether ANALOG:FORMAT states unsigned analog counts (0 to 65535)."""
    record = find_parameter(records, "ANALOG", "FORMAT")
    return record is not None and "".join(record.texts()[:1]).strip().upper() == "UNSIGNED"


def int16_scalar(value: int) -> Int[np.ndarray, " one"]:
    """A 16-bit count as a list of one; values above 32767 are stored as negative, as in all C3D files."""
    return np.array([value % 65536], dtype="<u2").view("<i2")


def with_numbers(
    records: Sequence[Record], group: str, name: str, values: Num[np.ndarray, "..."]
) -> tuple[Record, ...]:
    """The records with a parameter set to ``values`` of type <i2 or <f4; a list of one value is a scalar."""
    shape = () if values.shape == (1,) else values.shape
    return with_record(records, group, name, values.dtype.itemsize, shape, values.tobytes())


def with_texts(records: Sequence[Record], group: str, name: str, texts: Sequence[str]) -> tuple[Record, ...]:
    """The records with a list of texts, cut into NAME, NAME2 ... of 255 entries."""
    for k in range(0, max(len(texts), 1), _MAX_ENTRIES):
        pieces = [text.encode("latin-1", "replace")[:_MAX_ENTRIES] for text in texts[k : k + _MAX_ENTRIES]]
        width = max((len(piece) for piece in pieces), default=1) or 1
        raw = b"".join(piece.ljust(width) for piece in pieces)
        number = str(k // _MAX_ENTRIES + 1) if k else ""
        records = with_record(records, group, name + number, -1, (width, len(pieces)), raw)
    return tuple(records)


def with_record(
    records: Sequence[Record], group: str, name: str, kind: int, shape: tuple[int, ...], raw: bytes
) -> tuple[Record, ...]:
    """The records with the last parameter ``group:name`` replaced, or added if absent."""
    replaced = list(records)
    old = find_parameter(replaced, group, name)
    if old is not None:
        replaced[replaced.index(old)] = replace(old, kind=kind, shape=shape, raw=raw)
        return tuple(replaced)
    groups = group_numbers(replaced)
    taken = {abs(record.group) for record in replaced}
    number = groups.get(group) or next((n for n in range(1, 128) if n not in taken), 127)
    if group not in groups:
        replaced.append(Record(-number, group))
    return (*replaced, Record(number, name, kind=kind, shape=shape, raw=raw))


def record_bytes(record: Record) -> bytes:
    """Bytes of a record in Intel's number format."""
    name = record.name.encode("latin-1")
    rest = b""
    if record.group > 0:
        rest = struct.pack("bB", record.kind, len(record.shape)) + bytes(record.shape) + record.raw
    rest += bytes([len(record.description)]) + record.description
    sign = -1 if record.locked else 1
    return struct.pack("bb", sign * len(name), record.group) + name + struct.pack("<H", 2 + len(rest)) + rest


def _with_manual_types(records: Sequence[Record]) -> tuple[Record, ...]:
    """The records with the types of ``_TYPES``; offsets that do not fit 16-bit integers stay floats."""
    typed = list(records)
    for (group, name), kind in _TYPES.items():
        for record in find_continued(records, group, name):
            values = numeric_values(record, INTEL)
            whole = np.all((values == np.rint(values)) & (np.abs(values) < 32768.0))
            if record.kind in (2, 4) and (kind == 4 or whole):
                converted = replace(record, kind=kind, raw=values.astype("<i2" if kind == 2 else "<f4").tobytes())
                typed[typed.index(record)] = converted
    return tuple(typed)


def _record_as_intel(record: Record, processor: int) -> Record:
    if processor == INTEL or record.kind not in (2, 4):
        return record
    values = numeric_values(record, processor)
    return replace(record, raw=values.astype("<i2" if record.kind == 2 else "<f4").tobytes())


def _decode_values(raw: bytes, processor: int, layout: Layout) -> Raw:
    if layout.width == 2:
        values = np.frombuffer(raw, BYTE_ORDER[processor] + "i2").astype(np.float32)
    elif processor == DEC:
        values = decode_floats(raw, processor).astype(np.float32)
    else:
        values = np.frombuffer(raw, BYTE_ORDER[processor] + "f4").astype(np.float32)
    return values.reshape(layout.n_frames, layout.values_per_frame)


def _intel_head(head: bytes, processor: int) -> bytes:
    """The header with its counts, rate and event times in Intel's number format."""
    converted = bytearray(head)
    order = BYTE_ORDER[processor]
    for at in (*range(2, 12, 2), 16, 18, *range(294, 302, 2)):
        struct.pack_into("<H", converted, at, *struct.unpack_from(order + "H", head, at))
    converted[20:24] = decode_floats(head[20:24], processor).astype("<f4").tobytes()
    converted[_EVENT_TIMES] = decode_floats(head[_EVENT_TIMES], processor).astype("<f4").tobytes()
    return bytes(converted)


def with_points(file: C3dContent, labels: Sequence[str], tracks: Float[np.ndarray, "frames labels 3"]) -> C3dContent:
    """The file with points appended; ``tracks`` are positions in its unit, NaN where missing.

    POINT:DESCRIPTIONS is extended if it describes every point.
    """
    n = file.layout.n_points
    records: Sequence[Record] = file.records
    for name, texts in (("LABELS", list(labels)), ("DESCRIPTIONS", ["added by stridelab"] * len(labels))):
        stated = [text for record in find_continued(records, "POINT", name) for text in record.texts()]
        if name == "LABELS" or len(stated) >= n:
            stated += [""] * (n - len(stated))
            records = with_texts(records, "POINT", name, [*stated[:n], *texts, *stated[n:]])
    missing = ~np.isfinite(tracks).all(axis=2)
    added = np.zeros((*tracks.shape[:2], 4), dtype=np.float32)
    added[:, :, :3] = np.where(missing[:, :, None], 0.0, tracks)
    added[:, :, 3] = np.where(missing, -1.0, 0.0)
    points = np.concatenate([file.points, added.reshape(len(added), -1)], axis=1)
    return replace(file, records=tuple(records), points=points, layout=replace(file.layout, n_points=n + len(labels)))
