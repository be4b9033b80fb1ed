"""Prepares C3D files so that ezc3d 1.7.2 reads them correctly.

ezc3d does not read SGI files, takes the counts of frames, points and channels from the parameters, truncates the
quotient of the rates to whole samples per frame, reads every integer as signed, uses the absolute value of every analog
offset and needs an integer offset and a scale for each channel. Files that it would misread are first rewritten as a
temporary file: Intel floats, consistent counts, offsets subtracted.
"""

import contextlib
import struct
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import ezc3d
import numpy as np

from stridelab.recordings.files.c3d_byte_orders import (
    C3dContent,
    CheckedC3d,
    int16_scalar,
    is_unsigned,
    read_content,
    with_numbers,
    write_content,
)
from stridelab.recordings.files.c3d_records import (
    INTEL,
    Record,
    Values,
    find_continued,
    first_number,
    group_numbers,
    numeric_values,
    read_header,
)

EZC3D_ERRORS: Final = (OSError, RuntimeError, ValueError, IndexError, KeyError, MemoryError, TypeError)
"""Exceptions of ezc3d for a file that it cannot read."""
_MAX_ENTRIES = 255
_MAX_FRAMES = 65535
"""Maximum number of frames that ezc3d reads; longer files are read in pieces."""
_MIN_PIECE_FRAMES = 1000
_LONGEST_DESCRIPTION = 127
"""Longest description that ezc3d reads; it takes a longer length as negative and reads beyond the buffer."""
_NAMES_IT_READS = ("POINT", "ANALOG", "FORCE_PLATFORM")
_HALF_RANGE = -32768.0
"""An offset of 32768 counts in 16 bits; ezc3d uses its absolute value and thus reads it correctly."""


def open_c3d(path: Path, checked: CheckedC3d) -> Any:
    """Content of a file that has passed ``check_c3d``, as read by ezc3d; raises ``EZC3D_ERRORS``."""
    if not is_misread(checked):
        with contextlib.suppress(*EZC3D_ERRORS):  # the rewritten file may be readable
            return ezc3d.c3d(str(path))
    read = [_read_rewritten(piece) for piece in _split_frames(read_content(path, checked), checked.header.n_frames)]
    for name in ("points", "analogs") if len(read) > 1 else ():
        read[0]["data"][name] = np.concatenate([content["data"][name] for content in read], axis=2)
    return read[0]


def _read_rewritten(file: C3dContent) -> Any:
    with tempfile.TemporaryDirectory(prefix="c3d-") as folder:
        rewritten = Path(folder) / "rewritten.c3d"
        rewritten.write_bytes(write_content(with_consistent_counts(file), padded=False))
        return ezc3d.c3d(str(rewritten))


def _split_frames(file: C3dContent, n_in_header: int) -> Iterator[C3dContent]:
    """The file split into pieces that ezc3d can read; the first has as many frames as the header states.

    This preserves the number of the first frame, from which event times are counted.
    """
    n = file.layout.n_frames
    if n <= _MAX_FRAMES:
        yield file
        return
    size = n_in_header if _MIN_PIECE_FRAMES <= n_in_header <= _MAX_FRAMES else _MAX_FRAMES
    for i in range(0, n, size):
        layout = replace(file.layout, n_frames=min(size, n - i))
        yield replace(
            file, layout=layout, points=file.points[i : i + size], analogs=file.analogs[i : i + size], tail=b""
        )


def is_misread(checked: CheckedC3d) -> bool:
    """Whether ezc3d would misread the file."""
    header, records, layout = checked.header, checked.records, checked.layout
    if header.processor != INTEL or layout.width == 2 or not header.scale < 0.0 or checked.lacks_frame:
        return True
    if any(len(record.description) > _LONGEST_DESCRIPTION or not record.has_description for record in records):
        return True
    groups = {number for name, number in group_numbers(records).items() if name in _NAMES_IT_READS}
    if any(abs(record.group) in groups and record.name != record.name.upper() for record in records):
        return True
    scale, points, frames, rate_hz = (
        first_number(header, records, "POINT", name) for name in ("SCALE", "USED", "FRAMES", "RATE")
    )
    if (scale is not None and not scale < 0.0) or points != layout.n_points:
        return True
    if layout.n_frames > _MAX_FRAMES:
        return True
    if frames and frames % 65536 != layout.n_frames % 65536:
        return True
    if layout.n_channels == 0:
        return False
    used, analog_hz = (first_number(header, records, "ANALOG", name) for name in ("USED", "RATE"))
    if used != layout.n_channels or not rate_hz or int((analog_hz or 0.0) / rate_hz) != layout.ratio:
        return True  # without a rate ezc3d takes the analog samples for points
    offsets = find_continued(records, "ANALOG", "OFFSET")
    scales = find_continued(records, "ANALOG", "SCALE")
    if any(record.kind != 2 for record in offsets) or any(record.kind != 4 for record in scales):
        return True
    if min(sum(record.n_values for record in parts) for parts in (offsets, scales)) < layout.n_channels:
        return True
    values = np.concatenate([numeric_values(record, INTEL) for record in offsets])
    return bool(((values < 0.0) & (values != _HALF_RANGE)).any())


def with_consistent_counts(file: C3dContent) -> C3dContent:
    """The file with consistent counts and analog offsets subtracted; a channel without a scale reads as NaN."""
    layout = file.layout
    header = read_header(file.head, INTEL)
    records: Sequence[Record] = [replace(r, name=r.name.upper(), description=b"") for r in file.records]
    rate_hz = first_number(header, records, "POINT", "RATE") or header.rate_hz
    for group, value in (("POINT", rate_hz), ("ANALOG", _analog_rate_hz(layout.ratio, rate_hz))):
        records = with_numbers(records, group, "RATE", np.array([value], dtype="<f4"))
    records = with_numbers(records, "ANALOG", "USED", int16_scalar(layout.n_channels))
    records = with_numbers(records, "POINT", "FRAMES", int16_scalar(layout.n_frames))
    head = bytearray(file.head)
    if layout.n_frames != header.n_frames:
        struct.pack_into("<2H", head, 6, 1, layout.n_frames)
    file = replace(file, head=bytes(head))
    if layout.n_channels == 0:
        return replace(file, records=tuple(records))
    offsets = _channel_offsets(records, layout.n_channels)
    scales = _values_per_channel(records, "SCALE", layout.n_channels, np.nan)
    for k in range(0, layout.n_channels, _MAX_ENTRIES):
        number = str(k // _MAX_ENTRIES + 1) if k else ""
        part = scales[k : k + _MAX_ENTRIES]
        records = with_numbers(records, "ANALOG", f"SCALE{number}", part.astype("<f4"))
        records = with_numbers(records, "ANALOG", f"OFFSET{number}", np.zeros(len(part), dtype="<i2"))
    analogs = file.analogs - np.tile(offsets, layout.ratio).astype(np.float32)
    return replace(file, records=tuple(records), analogs=analogs)


def _analog_rate_hz(ratio: int, rate_hz: float) -> float:
    """Smallest single-precision ``ratio`` x ``rate_hz`` whose quotient ezc3d does not truncate to one sample less."""
    single = np.float32(rate_hz)
    product = np.float32(ratio * rate_hz)
    while single and np.isfinite(product) and int(float(product) / float(single)) < ratio:
        product = np.nextafter(product, np.float32(np.inf))
    return float(product)


def _values_per_channel(records: Sequence[Record], name: str, n: int, absent: float) -> Values:
    """One number per channel from NAME, NAME2 ...; ``absent`` if the file has none."""
    stated = np.concatenate(
        [np.zeros(0), *(numeric_values(record, INTEL) for record in find_continued(records, "ANALOG", name))]
    )
    return np.concatenate([stated[:n], np.full(max(0, n - len(stated)), absent)])


def _channel_offsets(records: Sequence[Record], n: int) -> Values:
    """Offsets in counts; those of unsigned samples range up to 65535, and -32768 is read as +32768."""
    offsets = _values_per_channel(records, "OFFSET", n, 0.0)
    unsigned = (offsets < 0.0) if is_unsigned(records) else (offsets == _HALF_RANGE)
    return np.where(unsigned, offsets + 65536.0, offsets)
