"""Validates the header and parameter records of a C3D file before ezc3d reads it.

Layout after the C3D user manual (c3d.org): 512-byte header; parameter records, each a chain of groups and
parameters linked by 16-bit offsets; then frames of points and analog samples. ezc3d 1.7.2 does not validate them: a
damaged byte can crash it or cause an endless loop. Here it raises an error with a specific code.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from stridelab.errors import Fault, UnreadableFile
from stridelab.recordings.files.c3d_records import (
    BLOCK,
    BYTE_ORDER,
    Header,
    Layout,
    Record,
    broken_parameters_error,
    find_layout,
    first_number,
    group_numbers,
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
    """Validated header, parameters and data layout of a file."""

    header: Header
    records: tuple[Record, ...]
    layout: Layout


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
    layout = find_layout(header, records, size)
    if layout.values_per_frame and (header.data_block < 2 or layout.data_end > size):
        raise truncated_file_error(path.name, "its frames")
    _check_numbers(path, records)
    if header.n_analog:
        _check_rates(path, header, records)
    return CheckedC3d(header, records, layout)


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
