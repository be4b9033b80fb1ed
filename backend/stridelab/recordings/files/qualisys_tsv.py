"""Reads the TSV export of Qualisys Track Manager: markers in one file, each plate in a file ``*_f_1.tsv`` of its own.

Both begin with lines of a key and its values. Frame and time columns before the data are optional.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np

from stridelab.conventions import Corners
from stridelab.errors import Fault, UnreadableFile
from stridelab.recordings.files.lab_exports import ExportedMarkers, ExportedPlate, assemble_export
from stridelab.recordings.files.raw import RawTrial
from stridelab.recordings.files.text_table import BrokenLineError, Table, numbered_lines, parse_table
from stridelab.recordings.recording import Remark

_MARKERS: Final = "NO_OF_FRAMES"
_SAMPLES: Final = "NO_OF_SAMPLES"
_CORNERS: Final = ("POSX_POSY", "NEGX_POSY", "NEGX_NEGY", "POSX_NEGY")
_HEADER_LINES: Final = 60
_MM: Final = 1e-3

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

    Raises ``UnreadableFile`` (``tsv-broken``, ``no-frames``, ``zip-several-trials``, and as ``assemble_export``).
    """
    names = [name for name, text in texts.items() if is_qualisys_markers(text)]
    forces = sorted(name for name, text in texts.items() if is_qualisys_forces(text))
    if len(names) != 1:
        message = f"The zip holds {len(names)} files of markers; upload one of them and its force files at a time."
        raise UnreadableFile("zip-several-trials", message, [Fault(name, "one of several") for name in names])
    try:
        name = names[0]
        markers, remarks = _parse_markers(texts[name], name)
        plates, rates_hz = [], []
        for name in forces:
            plate, rate_hz = _parse_forces(texts[name], name)
            plates.append(plate)
            rates_hz.append(rate_hz)
        if len(set(rates_hz)) > 1:
            raise BrokenLineError(f"its rate of {rates_hz[-1]:g} Hz is not that of {forces[0]}, {rates_hz[0]:g} Hz")
    except BrokenLineError as error:
        message = f"The TSV file {name} is broken: {error}."
        raise UnreadableFile("tsv-broken", message, [Fault(name, str(error))]) from error
    return assemble_export(markers, plates, rates_hz[0] if rates_hz else markers.rate_hz, remarks)


def _parse_markers(text: str, name: str) -> tuple[ExportedMarkers, list[Remark]]:
    header, rows = _split_header(text)
    data = header.get("DATA_INCLUDED", ["3D"])[:1]
    if data != ["3D"]:
        raise BrokenLineError(f"it holds {''.join(data)[:20]} data; export the 3D data of the markers")
    labels = [label for label in header.get("MARKER_NAMES", []) if label]
    if not labels:
        raise BrokenLineError("its header has no line MARKER_NAMES with names")
    table = _parse_numbers(rows, 3 * len(labels), f"the {len(labels)} markers of the line MARKER_NAMES")
    if len(table) == 0:
        raise UnreadableFile("no-frames", f"The TSV file {name} holds no frames.", [Fault(name, "no frames")])
    remarks = []
    stated = _number(header, _MARKERS)
    if stated != len(table):
        message = f"The header of {name} states {stated:g} frames and {len(table)} follow; those are used."
        remarks.append(Remark("tsv-header-differs", message))
    points = table.reshape(len(table), len(labels), 3)
    return ExportedMarkers(name, labels, points, _rate_hz(header), "mm"), remarks


def _parse_forces(text: str, name: str) -> tuple[ExportedPlate, float]:
    """Forces, moments and centres of pressure, in N, N mm and mm, of one plate, and their rate in Hz."""
    header, rows = _split_header(text)
    table = _parse_numbers(rows, 9, "force, moment and centre of pressure")
    if len(table) == 0:
        raise UnreadableFile("no-frames", f"The TSV file {name} holds no samples.", [Fault(name, "no samples")])
    force, moment, cop = table[:, :3], _MM * table[:, 3:6], _MM * table[:, 6:]
    return ExportedPlate(name, force, moment, cop, _corners_m(header)), _rate_hz(header)


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


def _parse_numbers(rows: list[tuple[int, str]], width: int, what: str) -> Table:
    """The last ``width`` columns, after none or the two of frame and time; a tab at the end of a line is ignored."""
    rows = [(line, row.rstrip("\r\n")) for line, row in rows]
    counts = {len(row.split("\t")) - row.endswith("\t") for _, row in rows}
    for extra in (0, 2):
        if counts and counts <= {width + extra, width + extra - 1}:
            return parse_table(rows, width + extra)[:, extra:]
    if not rows:
        return np.zeros((0, width))
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
