"""OpenSim trials: markers from TRC, ground forces from MOT or STO.

A MOT file gives per contact the force f on the body, the centre of pressure p and the free moment T; the wrench at
the file's origin is (f, p x f + T). Where |f| is small p is noise divided by nearly nothing (hundreds of metres) and
is replaced by the nearest meaningful one.
"""

import re
from pathlib import Path

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Corners, Points, Series, Vector3
from stridelab.errors import Fault, UnreadableFile
from stridelab.recordings import labels as names
from stridelab.recordings.archive import open_trial
from stridelab.recordings.axes import axis_vector, nearest_axis
from stridelab.recordings.gaps import mark_missing
from stridelab.recordings.raw import CONTACT_TYPE, LARGEST, Cloud, FilePlate, RawTrial
from stridelab.recordings.recording import Remark, Subject
from stridelab.recordings.units import length_scale

COP_THRESHOLD_N = 20.0
_COLUMN = re.compile(
    r"^(?P<pre>.*?)ground_(?P<what>force|torque|moment)(?P<post>_\w+?)?_(?P<kind>[vpm]?)(?P<axis>[xyz])$", re.IGNORECASE
)
_MARGIN_M = 0.1

Table = Float[np.ndarray, "rows columns"]


def read_trc_mot(path: Path) -> RawTrial:
    """Read a zip of one TRC and at most one force file.

    Raises ``UnreadableFile`` (``times-do-not-overlap``, and as ``open_trial``, ``parse_trc`` and ``parse_mot``).
    """
    texts = open_trial(path)
    labels, time_s, points, rate_hz, unit = parse_trc(texts.trc, texts.trc_name)
    cloud = mark_missing(points)
    scale, remarks = length_scale(unit, cloud)
    visible = [int(n) for n in (~np.isnan(cloud[:, :, 0])).sum(axis=0)]
    choice = names.choose(labels, visible, (), ())
    cloud = cloud[:, list(choice.column.values()), :] * scale
    remarks = (*choice.remarks, *remarks)
    contacts: tuple[FilePlate, ...] = ()
    force_rate_hz = rate_hz
    if texts.mot is None:
        remarks = (*remarks, Remark("no-force-file", "The zip holds markers only, no ground forces."))
    else:
        mot_time_s, forces = parse_mot(texts.mot, texts.mot_name)
        keep = (time_s >= mot_time_s[0] - 0.5 / rate_hz) & (time_s <= mot_time_s[-1] + 0.5 / rate_hz)
        if not keep.any():
            spans = [f"{t[0]:g} to {t[-1]:g} s" for t in (time_s, mot_time_s)]
            faults = [Fault(texts.trc_name, spans[0]), Fault(texts.mot_name, spans[1])]
            message = f"Markers ({spans[0]}) and forces ({spans[1]}) were recorded at different times."
            raise UnreadableFile("times-do-not-overlap", message, faults)
        if not keep.all():
            remarks = (
                *remarks,
                Remark("cut-to-common-time", f"{int((~keep).sum())} frames have no force and were cut off."),
            )
        cloud, time_s = cloud[keep], time_s[keep]
        force_rate_hz = sampling_rate_hz(mot_time_s)
        contacts, more = _contacts(even_times_s(mot_time_s, time_s[0]), forces, force_rate_hz, len(cloud) / rate_hz)
        remarks = (*remarks, *more)
    return RawTrial(
        labels=tuple(choice.column),
        outputs=choice.outputs,
        points_m=cloud,
        marker_rate_hz=rate_hz,
        force_rate_hz=force_rate_hz,
        plates=(),
        contacts=contacts,
        subject=Subject(),
        events=(),
        up_hint="+y",
        remarks=remarks,
        metres_per_unit=scale,
    )


def parse_trc(text: str, name: str) -> tuple[list[str], Series, Cloud, float, str]:
    """Labels, times in seconds, points (file's unit), rate in Hz and unit of length of a TRC file.

    The rate is the header's unless the times say otherwise. Raises ``UnreadableFile`` (``trc-broken``, ``no-frames``).
    """
    lines = text.splitlines()
    try:
        labels, rate_hz, unit = _trc_header(lines)
        table = _table(_numbered(lines, 5), 2 + 3 * len(labels))
    except _BrokenLineError as error:
        raise UnreadableFile(
            "trc-broken", f"The TRC file {name} is broken: {error}.", [Fault(name, str(error))]
        ) from error
    if len(table) == 0:
        raise UnreadableFile("no-frames", "The TRC file holds no frames.", [Fault(name, "no frames")])
    time_s = table[:, 1]
    if len(time_s) > 1 and not (np.isfinite(time_s).all() and (np.diff(time_s) > 0).all()):
        raise UnreadableFile("trc-broken", "The times in the TRC file do not increase.", [Fault(name, "time")])
    if len(time_s) > 1:
        measured_hz = sampling_rate_hz(time_s)
        if not abs(measured_hz - rate_hz) <= 0.01 * rate_hz:
            rate_hz = measured_hz
    if not 0.0 < rate_hz < 1e5:
        raise UnreadableFile("trc-broken", "The TRC file states no frame rate.", [Fault(name, "DataRate")])
    return labels, time_s, table[:, 2:].reshape(len(table), len(labels), 3), rate_hz, unit


def parse_mot(text: str, name: str) -> tuple[Series, dict[str, dict[str, Points]]]:
    """Times, and per contact the arrays "v" (force), "p" (centre of pressure) and "t" (free moment).

    Both header dialects (``nRows=``, ``datarows``) end in ``endheader``; contacts are told apart by what is left of
    the column name (``ground_force_vx``, ``1_ground_force_vx``, ``ground_force_r_vx``). Raises ``UnreadableFile``
    (``mot-broken``, ``mot-without-forces``).
    """
    lines = text.splitlines()
    try:
        ends = [i for i, line in enumerate(lines) if line.strip().lower() == "endheader"]
        if not ends:
            raise _BrokenLineError("no line says endheader")
        numbered = _numbered(lines, ends[0] + 1)
        if not numbered:
            raise _BrokenLineError(
                f"the file ends with endheader in line {ends[0] + 1}, before the names of its columns"
            )
        columns = numbered[0][1].split()
        table = _table(numbered[1:], len(columns))
    except _BrokenLineError as error:
        raise UnreadableFile(
            "mot-broken", f"The force file {name} is broken: {error}.", [Fault(name, str(error))]
        ) from error
    if len(table) < 2 or columns[0].lower() != "time" or not (np.diff(table[:, 0]) >= 0).all():
        raise UnreadableFile("mot-broken", "The force file has no increasing time column.", [Fault(name, "time")])
    contacts: dict[str, dict[str, Points]] = {}
    for i, column in enumerate(columns):
        match = _COLUMN.match(column)
        if match is None:
            continue
        contact = contacts.setdefault((match["pre"] + (match["post"] or "")).strip("_").lower(), {})
        kind = match["kind"].lower() if match["what"].lower() == "force" else "t"
        track = contact.setdefault(kind, np.zeros((len(table), 3)))
        track[:, "xyz".index(match["axis"].lower())] = np.nan_to_num(table[:, i], posinf=0.0, neginf=0.0)
    whole = {key: c for key, c in contacts.items() if {"v", "p"} <= set(c)}
    if not whole:
        raise UnreadableFile(
            "mot-without-forces", "The force file has no force and centre of pressure.", [Fault(name, "columns")]
        )
    return table[:, 0], whole


def sampling_rate_hz(time_s: Series) -> float:
    """Rate of a time column whose entries are rounded: the mean over the whole column, not one step."""
    rate_hz = float((len(time_s) - 1) / (time_s[-1] - time_s[0]))
    nearest = round(rate_hz)
    return float(nearest) if nearest and abs(rate_hz - nearest) < 1e-3 * nearest else rate_hz


def even_times_s(time_s: Series, zero_s: float) -> Series:
    """Times counted from ``zero_s`` without their rounding: even steps, a whole step from zero where nearly so.

    A column that is not evenly sampled (off by half a step) is left as it is.
    """
    rate_hz = sampling_rate_hz(time_s)
    first = (time_s[0] - zero_s) * rate_hz
    steps = (round(first) if abs(first - round(first)) < 0.1 else first) + np.arange(len(time_s))
    even: Series = steps / rate_hz
    return even if np.abs(even - (time_s - zero_s)).max() < 0.5 / rate_hz else time_s - zero_s


class _BrokenLineError(ValueError):
    """What is wrong with a text file and in which line, as the part of a sentence that users read."""


def _trc_header(lines: list[str]) -> tuple[list[str], float, str]:
    """Labels, rate in Hz and unit of length of a TRC file; raises ``_BrokenLineError``."""
    if len(lines) < 4:
        raise _BrokenLineError(f"the file ends after line {len(lines)}, before the marker names in line 4")
    head = dict(zip(lines[1].split(), lines[2].split(), strict=False))
    n_markers, rate_hz = _header_number(head, "NumMarkers"), _header_number(head, "DataRate")
    cells = lines[3].rstrip("\t\r ").split("\t")[2:]
    labels = [cell.strip() for cell in cells if cell.strip()]
    if len(labels) != n_markers or n_markers < 1:
        raise _BrokenLineError(f"line 3 states {n_markers:g} markers and line 4 names {len(labels)}")
    return labels, rate_hz, head.get("Units", "")


def _header_number(head: dict[str, str], key: str) -> float:
    if key not in head:
        raise _BrokenLineError(f"lines 2 and 3 of the header state no {key}")
    try:
        return float(head[key])
    except ValueError as error:
        raise _BrokenLineError(f"line 3 states {head[key][:40]!r} as {key}, which is no number") from error


def _numbered(lines: list[str], start: int) -> list[tuple[int, str]]:
    """The lines from index ``start`` that are not blank, each with its number in the file, counted from one."""
    return [(i + 1, line) for i, line in enumerate(lines) if i >= start and line.strip()]


def _table(rows: list[tuple[int, str]], width: int) -> Table:
    """Numbers of tab (or blank) separated rows; empty cells are NaN.

    Raises ``_BrokenLineError`` on a short row, a cell that is no number, or a number that no laboratory measures.
    """
    values = []
    for line, row in rows:
        cells = row.rstrip("\r\n").split("\t") if "\t" in row else row.split()
        if len(cells) < width and "\t" in row and width - len(cells) <= 3:
            cells += [""] * (width - len(cells))
        if len(cells) < width:
            raise _BrokenLineError(f"line {line} has {len(cells)} of {width} values")
        values.append([_value(cell, line, column) for column, cell in enumerate(cells[:width], start=1)])
    return np.array(values, dtype=np.float64).reshape(len(values), width)


def _value(cell: str, line: int, column: int) -> float:
    try:
        value = float(cell) if cell.strip() else np.nan
    except ValueError as error:
        raise _BrokenLineError(
            f"line {line}, column {column} holds {cell.strip()[:40]!r}, which is no number"
        ) from error
    if LARGEST < abs(value) < np.inf:
        raise _BrokenLineError(f"line {line}, column {column} holds {value:.3g}, which no laboratory measures")
    return value


def _contacts(
    time_s: Series, forces: dict[str, dict[str, Points]], rate_hz: float, duration_s: float
) -> tuple[tuple[FilePlate, ...], tuple[Remark, ...]]:
    """Contacts on the time grid that starts at the first marker frame."""
    end_s = min(duration_s, float(time_s[-1]) + 0.5 / rate_hz)
    n = max(2, int(end_s * rate_hz) + 1)
    grid = np.arange(n) / rate_hz
    total: Vector3 = np.sum([c["v"].sum(axis=0) for c in forces.values()], axis=0)
    up = axis_vector(nearest_axis(total) or "+y")
    found: list[FilePlate] = []
    for k, contact in enumerate(forces.values(), start=1):
        f = _resample(contact["v"], time_s, grid)
        loaded = np.linalg.norm(contact["v"], axis=1) > COP_THRESHOLD_N
        if not loaded.any():
            continue
        kept = np.column_stack([np.interp(grid, time_s[loaded], contact["p"][loaded, j]) for j in range(3)])
        T = _resample(contact["t"], time_s, grid) if "t" in contact else np.zeros_like(f)
        corners = bounding_rectangle(contact["p"][loaded], up)
        found.append(FilePlate(k, CONTACT_TYPE, corners, f, np.cross(kept, f) + T, np.zeros(3)))
    message = "The force file names contacts, not plates; the plates drawn here bound their centres of pressure."
    return tuple(found), (Remark("plates-from-cop", message),)


def _resample(track: Points, time_s: Series, grid: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m 3"]:
    return np.column_stack([np.interp(grid, time_s, track[:, j]) for j in range(3)])


def bounding_rectangle(cop_m: Points, up: Vector3) -> Corners:
    """Horizontal rectangle around the centres of pressure with a margin of 10 cm, at their median height."""
    i, j = (k for k in range(3) if up[k] == 0.0)
    low, high = cop_m.min(axis=0) - _MARGIN_M, cop_m.max(axis=0) + _MARGIN_M
    corners = np.tile(np.median(cop_m, axis=0), (4, 1))
    for row, (a, b) in enumerate(((high[i], high[j]), (low[i], high[j]), (low[i], low[j]), (high[i], low[j]))):
        corners[row, i], corners[row, j] = a, b
    return corners
