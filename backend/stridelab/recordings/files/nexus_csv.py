"""Reads the ASCII export of Vicon Nexus: sections such as Devices and Trajectories in one CSV (or tabbed) file.

A section is a line with its title, a line with its rate in Hz, a line of names, a line of columns (Frame, Sub Frame,
...), a line of units, and rows of numbers up to a blank line.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from stridelab.conventions import Points
from stridelab.errors import Fault, UnreadableFile
from stridelab.recordings.files.lab_exports import ExportedMarkers, ExportedPlate, assemble_export
from stridelab.recordings.files.raw import RawTrial
from stridelab.recordings.files.text_table import BrokenLineError, Table, parse_table
from stridelab.recordings.recording import Remark

_TITLES: Final = ("Devices", "Trajectories", "Joints", "Model Outputs", "Segments", "Events")
_KINDS: Final = {"force": "Fx Fy Fz", "moment": "Mx My Mz", "cop": "Cx Cy Cz"}
_DEVICE: Final = re.compile(r"^(?P<name>.+) - (?P<kind>Force|Moment|CoP)$", re.IGNORECASE)
_COLUMNS: Final = re.compile(r"^\s*frame\s*(?P<mark>[,;\t])\s*sub frame", re.IGNORECASE | re.MULTILINE)
_METRES: Final = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}


@dataclass(frozen=True)
class _Section:
    """A section: ``names`` and ``units`` by column, ``frame`` and ``sub_frame`` of its first row."""

    rate_hz: float
    names: list[str]
    columns: list[str]
    units: list[str]
    table: Table


def is_nexus_csv(text: str) -> bool:
    """Whether a text begins with a section of an ASCII export."""
    lines = text[:2000].lstrip("\ufeff \r\n").splitlines()
    return len(lines) > 1 and re.split(r"[,;\t]", lines[0])[0].strip() in _TITLES


def read_nexus_csv(text: str, name: str) -> RawTrial:
    """Read the sections Trajectories and, if present, Devices; the others are ignored.

    Raises ``UnreadableFile`` (``csv-broken``, ``no-markers``, and as ``assemble_export``).
    """
    try:
        sections: dict[str, _Section] = {}
        for title, section in _sections(text):
            if title not in sections or not _plates(sections[title])[0]:
                sections[title] = section
        if "Trajectories" not in sections:
            held = ", ".join(sections) or "none"
            message = f"The CSV file {name} has no section Trajectories (it has {held}); export the markers, too."
            raise UnreadableFile("no-markers", message, [Fault(name, "no Trajectories")])
        markers, frames = _markers(sections["Trajectories"], name)
        devices = sections.get("Devices")
        if devices is None:
            return assemble_export(markers, (), markers.rate_hz)
        plates, remarks = _plates(devices)
        skipped = round((frames - devices.table[0, 0]) * devices.rate_hz / markers.rate_hz - devices.table[0, 1])
        if skipped < 0:
            raise BrokenLineError(f"its Devices begin at frame {devices.table[0, 0]:g}, Trajectories at {frames:g}")
    except BrokenLineError as error:
        message = f"The CSV file {name} is broken: {error}."
        raise UnreadableFile("csv-broken", message, [Fault(name, str(error))]) from error
    plates = [
        ExportedPlate(p.name, p.force_n[skipped:], p.moment_nm[skipped:], p.cop_m[skipped:])
        for p in plates
        if len(p.force_n) > skipped
    ]
    return assemble_export(markers, plates, devices.rate_hz, remarks)


def _sections(text: str) -> Iterator[tuple[str, _Section]]:
    """Title and content of every section of numbers; those without the columns Frame and Sub Frame are ignored."""
    lines = text.lstrip("\ufeff").splitlines()
    found = _COLUMNS.search(text)
    mark = found["mark"] if found else "," if "," in "".join(lines[:6]) else "\t"
    rows = [(i + 1, line.replace(mark, "\t").replace(",", ".")) for i, line in enumerate(lines)]
    starts = [at for at, (_, row) in enumerate(rows) if row.split("\t")[0].strip() in _TITLES and row.strip()]
    for start, stop in zip(starts, [*starts[1:], len(rows)], strict=True):
        part = [(line, row) for line, row in rows[start:stop] if row.strip()]
        title = part[0][1].split("\t")[0].strip()
        if title in ("Devices", "Trajectories"):
            yield title, _parse_section(part, title)


def _parse_section(part: list[tuple[int, str]], title: str) -> _Section:
    if len(part) < 6:
        raise BrokenLineError(f"its section {title} ends after line {part[-1][0]}, before its first frame")
    (_, _), (rate_line, rate), (_, names), (line, columns), (_, units), *rows = part
    try:
        rate_hz = float(rate.split("\t")[0])
    except ValueError as error:
        raise BrokenLineError(f"line {rate_line} holds no rate of {title}") from error
    if not 0.0 < rate_hz < 1e5:
        raise BrokenLineError(f"line {rate_line} states a rate of {rate_hz:g} Hz")
    cells = [cell.strip() for cell in columns.rstrip("\t\r ").split("\t")]
    if [cell.lower() for cell in cells[:2]] != ["frame", "sub frame"]:
        raise BrokenLineError(f"line {line} does not begin with Frame and Sub Frame")
    table = parse_table(rows, len(cells))
    if not np.isfinite(table[:, :2]).all():
        raise BrokenLineError(f"a row of its section {title} has no number of its frame")
    return _Section(rate_hz, _filled(names, len(cells)), cells, _padded(units, len(cells)), table)


def _padded(row: str, n: int) -> list[str]:
    cells = [cell.strip() for cell in row.split("\t")][:n]
    return cells + [""] * (n - len(cells))


def _filled(row: str, n: int) -> list[str]:
    """Names of all columns; an empty cell continues the name before it."""
    names: list[str] = []
    for cell in _padded(row, n):
        names.append(cell or (names[-1] if names else ""))
    return names


def _markers(section: _Section, name: str) -> tuple[ExportedMarkers, float]:
    """The markers and the number of their first frame."""
    frames = section.table[:, 0]
    if (np.diff(frames) != 1.0).any():
        raise BrokenLineError("its Trajectories are not numbered frame by frame")
    first = [
        i for i in range(2, len(section.columns) - 2) if [c.upper() for c in section.columns[i : i + 3]] == list("XYZ")
    ]
    labels = [section.names[i] for i in first]
    if not labels or not all(labels):
        raise BrokenLineError("its section Trajectories names no columns X, Y, Z of markers")
    points = section.table[:, [i + k for i in first for k in range(3)]].reshape(len(frames), len(first), 3)
    units = {section.units[i + k].lower() for i in first for k in range(3)}
    if len(units) > 1:
        raise BrokenLineError(f"its Trajectories have several units: {', '.join(sorted(units))[:60]}")
    return ExportedMarkers(name, labels, points, section.rate_hz, units.pop()), float(frames[0])


def _plates(section: _Section) -> tuple[list[ExportedPlate], list[Remark]]:
    """The plates among the devices; one without force, moment or centre of pressure is left out with a remark."""
    kinds: dict[str, dict[str, Points]] = {}
    for i, title in enumerate(section.names[: len(section.columns) - 2]):
        match = _DEVICE.match(title)
        if match is None or section.columns[i : i + 3] != _KINDS[match["kind"].lower()].split():
            continue
        kind = match["kind"].lower()
        kinds.setdefault(match["name"], {})[kind] = section.table[:, i : i + 3] * _scale(kind, section.units[i])
    remarks = [
        Remark("plate-unusable", f"{name} was left out: {', '.join(sorted(_KINDS.keys() - tracks))} not exported.")
        for name, tracks in kinds.items()
        if _KINDS.keys() - tracks
    ]
    whole = {name: tracks for name, tracks in kinds.items() if not _KINDS.keys() - tracks}
    return [ExportedPlate(n, t["force"], t["moment"], t["cop"]) for n, t in whole.items()], remarks


def _scale(kind: str, unit: str) -> float:
    if kind == "force":
        return 1e3 if unit.lower() == "kn" else 1.0
    if kind == "moment":
        return 1e-3 if "mm" in unit.lower() else 1.0
    return _METRES.get(unit.lower(), 1e-3)
