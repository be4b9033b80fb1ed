"""Determines the data layout of a C3D file whose header, parameters and size may disagree.

The header and the parameters both state the counts, and some programs keep only one of them correct. The counts must
satisfy: start of the data + frames x values per frame x bytes per value fits into the file; of two candidates that fit,
the one that leaves less data unread is used.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stridelab.recordings.files.c3d_records import BLOCK, Header, Record, find_parameter, numeric_values

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
    if used is not None and 0 <= used != channels:
        options += [replace(option, n_channels=int(used), ratio=ratio) for option in options]
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
