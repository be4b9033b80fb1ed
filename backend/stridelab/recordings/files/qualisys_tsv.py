"""Reads the TSV export of Qualisys Track Manager: markers in one file, each plate in a file ``*_f_1.tsv`` of its own.

Both begin with lines of a key and its values. Frame and time columns before the data are optional; where both files
have them, they are read from the time at which both have begun. Forces "in local (force plate) coordinates", as the
line DESCRIPTION says, are turned into the laboratory's axes, which the plate's corners give.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from stridelab.conventions import Corners, Points
from stridelab.errors import Fault, UnreadableFile
from stridelab.recordings.files.lab_exports import ExportedMarkers, ExportedPlate, assemble_export
from stridelab.recordings.files.raw import RawTrial
from stridelab.recordings.files.text_table import BrokenLineError, Table, numbered_lines, parse_table
from stridelab.recordings.force_plates import corners_fault, plate_axes
from stridelab.recordings.recording import Remark

_MARKERS: Final = "NO_OF_FRAMES"
_SAMPLES: Final = "NO_OF_SAMPLES"
_CORNERS: Final = ("POSX_POSY", "NEGX_POSY", "NEGX_NEGY", "POSX_NEGY")
_HEADER_LINES: Final = 60
_MM: Final = 1e-3
_MOST_LEVERS: Final = 5.0
"""A lever in units of the largest coordinate of the pressure, plus a metre; in N mm it would be 1000 times as long."""
_LOCAL: Final = re.compile(r"\blocal\b", re.IGNORECASE)

Header = Mapping[str, list[str]]


def is_qualisys_markers(text: str) -> bool:
    """Whether a text begins like the markers of a TSV export."""
    return text[:200].lstrip("\ufeff \r\n").startswith(_MARKERS)


def is_qualisys_forces(text: str) -> bool:
    """Whether a text begins like the forces of a TSV export."""
    head = text[:6000]
    return _SAMPLES in head and "FORCE_PLATE" in head


def read_qualisys(texts: Mapping[str, str]) -> RawTrial:
    """Read one marker file and the force files beside it, given as texts by name.

    Raises ``UnreadableFile`` (``tsv-broken``, ``no-frames``, ``zip-several-trials``, ``times-do-not-overlap``, and as
    ``assemble_export``).
    """
    names = [name for name, text in texts.items() if is_qualisys_markers(text)]
    forces = sorted(name for name, text in texts.items() if is_qualisys_forces(text))
    if len(names) != 1:
        message = f"The zip holds {len(names)} files of markers; upload one of them and its force files at a time."
        raise UnreadableFile("zip-several-trials", message, [Fault(name, "one of several") for name in names])
    try:
        name = names[0]
        markers, marker_start_s, remarks = _parse_markers(texts[name], name)
        plates, rates_hz, starts_s = [], [], []
        for name in forces:
            plate, rate_hz, start_s = _parse_forces(texts[name], name)
            plates.append(plate)
            rates_hz.append(rate_hz)
            starts_s.append(start_s)
        if len(set(rates_hz)) > 1:
            raise BrokenLineError(f"its rate of {rates_hz[-1]:g} Hz is not that of {forces[0]}, {rates_hz[0]:g} Hz")
    except BrokenLineError as error:
        message = f"The TSV file {name} is broken: {error}."
        raise UnreadableFile("tsv-broken", message, [Fault(name, str(error))]) from error
    rate_hz = rates_hz[0] if rates_hz else markers.rate_hz
    markers, plates, more = _from_common_time(markers, marker_start_s, plates, starts_s, rate_hz)
    return assemble_export(markers, plates, rate_hz, [*remarks, *more])


def _from_common_time(
    markers: ExportedMarkers, start_s: float, plates: list[ExportedPlate], starts_s: list[float], rate_hz: float
) -> tuple[ExportedMarkers, list[ExportedPlate], list[Remark]]:
    """Both without what comes before the latest of their first times; unchanged where a file states no times.

    Raises ``UnreadableFile`` (``times-do-not-overlap``).
    """
    latest_s = max([start_s, *starts_s])
    if math.isnan(start_s + sum(starts_s)) or latest_s == min([start_s, *starts_s]):
        return markers, plates, []
    # the first frame at which every file has begun; to a tenth of a frame, since the times are rounded
    first = math.ceil((latest_s - start_s) * markers.rate_hz - 0.1)
    begin_s = start_s + first / markers.rate_hz
    cut = [_tail(plate, round((begin_s - begun_s) * rate_hz)) for plate, begun_s in zip(plates, starts_s, strict=True)]
    if first >= len(markers.points) or any(len(plate.force_n) == 0 for plate in cut):
        message = "The markers and the forces were recorded at different times: they have no time in common."
        raise UnreadableFile("times-do-not-overlap", message, [Fault(markers.name, f"begins at {start_s:g} s")])
    message = f"Markers begin at {start_s:g} s and forces at {max(starts_s):g} s; both are read from {begin_s:g} s on."
    return replace(markers, points=markers.points[first:]), cut, [Remark("cut-to-common-time", message)]


def _tail(plate: ExportedPlate, first: int) -> ExportedPlate:
    """The plate from the sample ``first`` on."""
    force_n, moment_nm, cop_m = (track[first:] for track in (plate.force_n, plate.moment_nm, plate.cop_m))
    return ExportedPlate(plate.name, force_n, moment_nm, cop_m, plate.corners_m)


def _parse_markers(text: str, name: str) -> tuple[ExportedMarkers, float, list[Remark]]:
    header, rows = _split_header(text)
    data = header.get("DATA_INCLUDED", ["3D"])[:1]
    if data != ["3D"]:
        raise BrokenLineError(f"it holds {''.join(data)[:20]} data; export the 3D data of the markers")
    labels = [label for label in header.get("MARKER_NAMES", []) if label]
    if not labels:
        raise BrokenLineError("its header has no line MARKER_NAMES with names")
    table, start_s = _parse_numbers(rows, 3 * len(labels), f"the {len(labels)} markers of the line MARKER_NAMES")
    if len(table) == 0:
        raise UnreadableFile("no-frames", f"The TSV file {name} holds no frames.", [Fault(name, "no frames")])
    remarks = []
    stated = _number(header, _MARKERS)
    if stated != len(table):
        message = f"The header of {name} states {stated:g} frames and {len(table)} follow; those are used."
        remarks.append(Remark("tsv-header-differs", message))
    points = table.reshape(len(table), len(labels), 3)
    return ExportedMarkers(name, labels, points, _rate_hz(header), "mm"), start_s, remarks


def _parse_forces(text: str, name: str) -> tuple[ExportedPlate, float, float]:
    """Forces (N), moments and centres of pressure (mm) of one plate, their rate in Hz and first time.

    Moments are in N m or N mm, by version and setting of the program; they must fit forces and pressures.
    """
    header, rows = _split_header(text)
    table, start_s = _parse_numbers(rows, 9, "force, moment and centre of pressure")
    if len(table) == 0:
        raise UnreadableFile("no-frames", f"The TSV file {name} holds no samples.", [Fault(name, "no samples")])
    force, moment, cop = table[:, :3], table[:, 3:6], _MM * table[:, 6:]
    moment = moment * _moment_unit(force, moment, cop)
    corners_m = _corners_m(header)
    if _LOCAL.search(" ".join(header.get("DESCRIPTION", []))):
        if corners_m is None or corners_fault(corners_m) is not None:
            raise BrokenLineError("its forces are in the axes of the plate, and its header does not state the corners")
        axes = plate_axes(corners_m)
        force, moment, cop = force @ axes.T, moment @ axes.T, cop @ axes.T + corners_m.mean(axis=0)
    return ExportedPlate(name, force, moment, cop, corners_m), _rate_hz(header), start_s


def _moment_unit(force_n: Points, moment: Points, cop_m: Points) -> float:
    """Factor to N m: 1 where the moments are at most as large as forces times metres, else 1e-3."""
    heavy = np.abs(force_n).sum(axis=1) > 0.3 * np.nanmax(np.abs(force_n).sum(axis=1))
    levers_m = np.abs(moment[heavy]).max(axis=1) / np.abs(force_n[heavy]).max(axis=1)
    reach_m = 1.0 + np.abs(cop_m[heavy]).max(axis=1)
    return 1.0 if len(levers_m) == 0 or float(np.nanmedian(levers_m / reach_m)) < _MOST_LEVERS else _MM


def _split_header(text: str) -> tuple[Header, list[tuple[int, str]]]:
    """The values of the header by key, and the numbered lines of data; a line of column names is skipped."""
    rows = numbered_lines(text.lstrip("\ufeff").splitlines(), 0)
    header: dict[str, list[str]] = {}
    for at, (_, line) in enumerate(rows[:_HEADER_LINES]):
        cells = [cell.strip() for cell in line.split("\t")]
        if not cells[0][:1].isalpha() and at:
            return header, rows[at:]
        header[cells[0].upper()] = cells[1:]
    return header, rows[_HEADER_LINES:]


def _parse_numbers(rows: list[tuple[int, str]], width: int, what: str) -> tuple[Table, float]:
    """The last ``width`` columns, after none or the two of frame and time, and the first time, NaN without one.

    A tab at the end of a line is ignored.
    """
    rows = [(line, row.rstrip("\r\n")) for line, row in rows]
    counts = {len(row.split("\t")) - row.endswith("\t") for _, row in rows}
    for extra in (0, 2):
        if counts and counts <= {width + extra, width + extra - 1}:
            table = parse_table(rows, width + extra)
            return table[:, extra:], float(table[0, 1]) if extra and len(table) else math.nan
    if not rows:
        return np.zeros((0, width)), math.nan
    line, row = next((one for one in rows if len(one[1].split("\t")) not in (width, width + 2)), rows[0])
    raise BrokenLineError(f"line {line} has {len(row.split(chr(9)))} values, {width} belong to {what}")


def _rate_hz(header: Header) -> float:
    rate_hz = _number(header, "FREQUENCY")
    if not 0.0 < rate_hz < 1e5:
        raise BrokenLineError(f"its header states a FREQUENCY of {rate_hz:g} Hz")
    return rate_hz


def _number(header: Header, key: str) -> float:
    value = "".join(header.get(key, [])[:1])
    try:
        return float(value)
    except ValueError as error:
        raise BrokenLineError(f"its header states {value[:40]!r} as {key}, which is not a number") from error


def _corners_m(header: Header) -> Corners | None:
    """Corners in the order of the plate's quadrants; None if the header does not state all."""
    keys = [[f"FORCE_PLATE_CORNER_{corner}_{axis}" for axis in "XYZ"] for corner in _CORNERS]
    if not all(key in header for row in keys for key in row):
        return None
    return _MM * np.array([[_number(header, key) for key in row] for row in keys])
