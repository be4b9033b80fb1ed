"""The TRC text format of marker trajectories: a header of five lines, then a row of numbers per frame.

Cells are separated by tabs; a file whose first line has a comma or semicolon instead was saved by a table program. Some
writers separate the header by blanks, and the frames by blanks or tabs.
"""

import math
import re
from typing import Final

import numpy as np

from stridelab.conventions import Series
from stridelab.errors import Fault, UnreadableFile
from stridelab.recordings.files.raw import Cloud
from stridelab.recordings.files.text_table import (
    BrokenLineError,
    numbered_lines,
    parse_storage,
    parse_table,
    sampling_rate_hz,
    split_cells,
)
from stridelab.recordings.recording import Remark

_SEPARATORS: Final = (",", ";")
_STORAGE_HEAD: Final = 100_000
_VECTORS: Final = re.compile(r"^\s*datatype\s*=\s*vec3\s*$", re.IGNORECASE)
_COORDINATE: Final = re.compile(r"X\d+", re.IGNORECASE)
_WIDE_BLANK: Final = re.compile(r" {2,}")


def parse_trc(text: str, name: str) -> tuple[list[str], Series, Cloud, float, str, tuple[Remark, ...]]:
    """Labels, times in seconds, points (file's unit), rate in Hz, unit of length and remarks of a TRC file.

    The rate is the header's unless it states none or the times contradict it. A count of markers in the header that
    contradicts their names is ignored, with a remark, if the columns of the frames agree with the names. Raises
    ``UnreadableFile`` (``trc-broken``, ``no-frames``).
    """
    lines = trc_lines(text)
    try:
        labels, n_stated, rate_hz, unit = _parse_header(lines)
        rate_stated = math.isfinite(rate_hz)
        rows = numbered_lines(lines, 5)
        labels, virtual = _without_virtual(labels, n_stated, lines[4] if len(lines) > 4 else "")
        n_unnamed = _check_columns(rows, labels, n_stated, lines[4] if len(lines) > 4 else "")
        table = parse_table(rows, 2 + 3 * len(labels))
        if len(table) == 0:
            message = f"The TRC file {name} holds no frames: it ends after line {len(lines)}."
            raise UnreadableFile("no-frames", message, [Fault(name, "no frames")])
        time_s = table[:, 1]
        _require_increasing(time_s, rows)
        if len(time_s) > 1:
            measured_hz = sampling_rate_hz(time_s)
            if not abs(measured_hz - rate_hz) <= 0.01 * rate_hz:
                rate_hz = measured_hz
        elif not rate_stated:
            raise BrokenLineError("lines 2 and 3 of the header state no DataRate, and one frame shows none")
        if not 0.0 < rate_hz < 1e5:
            raise BrokenLineError(f"DataRate in line 3 and the times in column 2 give a frame rate of {rate_hz:g} Hz")
    except BrokenLineError as error:
        raise trc_broken(name, str(error)) from error
    remarks = []
    if not rate_stated:
        message = f"Lines 2 and 3 of {name} state no DataRate; the times in column 2 give {rate_hz:g} Hz."
        remarks.append(Remark("trc-header-differs", message))
    if virtual:
        message = f"{name} names {len(virtual)} virtual markers ({virtual[0]} ...) that have no columns."
        remarks.append(Remark("trc-header-differs", message))
    if n_stated != len(labels):
        message = f"Line 3 of {name} states {n_stated:g} markers, line 4 names {len(labels)} and so many have columns;"
        remarks.append(Remark("trc-header-differs", f"{message} the named ones are used."))
    if n_unnamed:
        message = f"Lines of {name} end with up to {n_unnamed} points that line 4 does not name; they were left out."
        remarks.append(Remark("unlabelled-points", message))
    return labels, time_s, table[:, 2:].reshape(len(table), len(labels), 3), rate_hz, unit, tuple(remarks)


def is_marker_storage(text: str) -> bool:
    """Whether a text is an OpenSim file (.sto, .mot) of positions alone: columns ``_tx``, ``_ty``, ``_tz``, or vectors.

    Files of joint angles have such columns for the pelvis, beside others.
    """
    try:
        _, columns, _ = parse_storage(_first_lines(text))
    except BrokenLineError:
        return False
    ends = [column[-3:].lower() for column in columns[1:]]
    return bool(ends) and ends == ["_tx", "_ty", "_tz"] * (len(ends) // 3)


def parse_marker_storage(text: str, name: str) -> tuple[list[str], Series, Cloud, float, str, tuple[Remark, ...]]:
    """As ``parse_trc``, of a file that ``is_marker_storage``, which is in metres unless its header states Units.

    Raises ``UnreadableFile`` (``sto-broken``).
    """
    try:
        header, columns, table = parse_storage(_without_vectors(text))
        if len(table) < 2 or not (np.diff(table[:, 0]) > 0.0).all():
            raise BrokenLineError("it has no increasing time column")
    except BrokenLineError as error:
        why = str(error)
        raise UnreadableFile("sto-broken", f"The marker file {name} is broken: {why}.", [Fault(name, why)]) from error
    labels = [column[:-3] for column in columns[1::3]]
    units = re.search(r"^\s*units\s*=\s*(\w+)", "\n".join(header), re.MULTILINE | re.IGNORECASE)
    points = table[:, 1:].reshape(len(table), len(labels), 3)
    return labels, table[:, 0], points, sampling_rate_hz(table[:, 0]), units[1] if units else "m", ()


def _first_lines(text: str) -> str:
    """Header, names of the columns and no rows of a storage file."""
    lines = _without_vectors(text[:_STORAGE_HEAD]).splitlines()
    end = next((i for i, line in enumerate(lines) if line.strip().lower() == "endheader"), len(lines))
    return "\n".join(lines[: end + 2])


def _without_vectors(text: str) -> str:
    """Text of a storage file with three columns for each column of vectors (``DataType=Vec3``)."""
    lines = text.splitlines()
    end = next((i for i, line in enumerate(lines) if line.strip().lower() == "endheader"), None)
    if end is None or end + 1 >= len(lines) or not any(_VECTORS.match(line) for line in lines[:end]):
        return text
    names = [column.removesuffix("/location").rpartition("/")[2] for column in lines[end + 1].split()]
    columns = [names[0], *(f"{name}_t{axis}" for name in names[1:] for axis in "xyz")]
    return "\n".join([*lines[: end + 1], "\t".join(columns), *(line.replace(",", "\t") for line in lines[end + 2 :])])


def trc_lines(text: str) -> list[str]:
    """The lines of a TRC file with their cells separated by tabs; rows of frames without any by blanks."""
    lines = text.splitlines()
    mark = text.lstrip()[len("PathFileType") :][:1]
    if mark in _SEPARATORS and not any("\t" in line for line in lines[:5]):
        return [line.replace(mark, "\t") for line in lines]
    if len(lines) > 3 and "\t" not in lines[3].strip():
        return _with_tabs(lines)
    return lines


def _with_tabs(lines: list[str]) -> list[str]:
    """Lines whose header is separated by blanks, with tabs in their place; unchanged if the names are ambiguous.

    Names may contain single blanks if two or more separate them. Either way their number must be that of line 3. The
    rows of frames must be complete, since a blank cell has no place among blanks: a row that lacks values is found
    too short by ``parse_table``. A tab before the first column is dropped.
    """
    stated = header_fields(lines).get("NumMarkers", "")
    for cells in (_WIDE_BLANK.split(lines[3].strip()), lines[3].split()):
        if stated == str(len(cells) - 2):
            names = "\t".join(cells[:2]) + "\t" + "\t\t\t".join(cells[2:])
            return [*lines[:3], names, *lines[4:5], *(line.strip(" ").removeprefix("\t") for line in lines[5:])]
    return lines


def trc_broken(name: str, why: str) -> UnreadableFile:
    """Error for an invalid TRC file ``name`` (``trc-broken``); ``why`` is the reason."""
    return UnreadableFile("trc-broken", f"The TRC file {name} is broken: {why}.", [Fault(name, why)])


def header_fields(lines: list[str]) -> dict[str, str]:
    """Fields of lines 2 and 3 with a value; separated by blanks if both lines have as many, else by tabs."""
    keys, values = lines[1].split(), lines[2].split()
    if len(keys) != len(values) and len(lines[1].split("\t")) == len(lines[2].split("\t")) > 1:
        keys, values = ([cell.strip() for cell in line.split("\t")] for line in lines[1:3])
    return {key: value for key, value in zip(keys, values, strict=False) if value}


def _parse_header(lines: list[str]) -> tuple[list[str], float, float, str]:
    """Labels, number of markers, rate in Hz (NaN if none is stated) and unit of length; raises ``BrokenLineError``."""
    if len(lines) < 4:
        raise BrokenLineError(f"the file ends after line {len(lines)}, before the marker names in line 4")
    head = header_fields(lines)
    n_markers = _header_number(head, "NumMarkers")
    rate_hz = _header_number(head, "DataRate") if "DataRate" in head else math.nan
    if "\t" not in lines[3].strip():
        raise BrokenLineError(
            f"line 4 holds no tabs, which separate the names of the markers, nor {n_markers:g} names between blanks"
        )
    cells = lines[3].rstrip("\t\r ").split("\t")[2:]
    labels = [cell.strip() for cell in cells if cell.strip()]
    if not labels:
        raise BrokenLineError(f"line 3 states {n_markers:g} markers and line 4 names 0")
    return labels, n_markers, rate_hz, head.get("Units", "")


def _without_virtual(labels: list[str], n_stated: float, coordinates: str) -> tuple[list[str], list[str]]:
    """The labels that have columns, and Cortex's virtual markers, which it names after them and may not export.

    The prefix identifies them; the count of line 3 and the line of coordinates must agree.
    """
    n = len(_COORDINATE.findall(coordinates))
    if n == n_stated and n < len(labels) and all(label.upper().startswith("V_") for label in labels[n:]):
        return labels[:n], labels[n:]
    return labels, []


def _header_number(head: dict[str, str], key: str) -> float:
    if key not in head:
        raise BrokenLineError(f"lines 2 and 3 of the header state no {key}")
    try:
        return float(head[key])
    except ValueError as error:
        raise BrokenLineError(f"line 3 states {head[key][:40]!r} as {key}, which is not a number") from error


def _check_columns(rows: list[tuple[int, str]], labels: list[str], n_stated: float, coordinates: str) -> int:
    """Number of points without a name, three cells each, at the end of the longest row.

    Raises ``BrokenLineError`` if the cells after the named markers are not whole points, for a missing tab, which
    shifts all following cells, so that the last marker has only one or two of its three coordinates, and if
    ``n_stated`` is not the number of names and neither the rows nor the line of ``coordinates`` (X1 Y1 Z1 ...)
    confirm the names.
    """
    width = 2 + 3 * len(labels)
    longest = n_cells = 0
    for line, row in rows:
        cells = split_cells(row)
        n_values = max((i for i, cell in enumerate(cells, start=1) if cell.strip()), default=0)
        if n_values > width and (n_values - width) % 3:
            raise BrokenLineError(
                f"line {line} has {n_values} values, {width} belong to the {len(labels)} markers of line 4"
            )
        last = [cell for cell in cells[width - 3 : width] if cell.strip()]
        if width - 3 <= len(cells) < width and last:
            raise BrokenLineError(f"line {line} has {len(cells)} of {width} values")
        longest, n_cells = max(longest, n_values), max(n_cells, len(cells))
    n_columns = -(-(longest - 2) // 3)
    n_numbered = len(_COORDINATE.findall(coordinates))
    confirmed = len(labels) in (n_stated, n_columns, (n_cells - 2) // 3, n_numbered)
    if rows and not confirmed:
        raise BrokenLineError(
            f"line 3 states {n_stated:g} markers, line 4 names {len(labels)} "
            f"and the frames have columns for {n_columns}"
        )
    return max(0, n_columns - len(labels))


def _require_increasing(time_s: Series, rows: list[tuple[int, str]]) -> None:
    """Raise ``BrokenLineError`` unless every row's time is a number and later than that of the row before."""
    if len(time_s) < 2:
        return
    for i, (line, _) in enumerate(rows):
        if not np.isfinite(time_s[i]):
            raise BrokenLineError(f"line {line}, column 2 holds no time")
        if i and time_s[i] <= time_s[i - 1]:
            raise BrokenLineError(
                f"line {line}, column 2 holds the time {time_s[i]:g} s after {time_s[i - 1]:g} s: "
                "the times do not increase"
            )
