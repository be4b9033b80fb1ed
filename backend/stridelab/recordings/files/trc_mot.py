"""Reads OpenSim trials: markers from TRC, ground forces from MOT or STO; or the markers alone.

A MOT file gives per contact the force f on the body, the centre of pressure p and the free moment T; the wrench at
the file's origin is (f, p x f + T). Where |f| is small, p is dominated by noise (hundreds of metres) and is replaced by
the nearest value of a loaded sample.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Corners, Mask, Points, Series, Vector3
from stridelab.errors import Fault, UnreadableFile
from stridelab.recordings.files import metadata as names
from stridelab.recordings.files.metadata import LENGTH_SCALE, length_scale, unit_of_body
from stridelab.recordings.files.opensim_zip import MAX_MEMBER_BYTES, TrialTexts, find_trial
from stridelab.recordings.files.raw import CONTACT_TYPE, NO_FORCE_FILE, Cloud, FilePlate, RawTrial
from stridelab.recordings.files.text_table import BrokenLineError, parse_storage, sampling_rate_hz
from stridelab.recordings.files.trc import (
    header_fields,
    is_marker_storage,
    parse_marker_storage,
    parse_trc,
    trc_broken,
    trc_lines,
)
from stridelab.recordings.gap_filling import bridge_force_gaps, mark_missing
from stridelab.recordings.orientation import axis_vector, nearest_axis
from stridelab.recordings.recording import Remark, Subject

COP_THRESHOLD_N = 20.0
_COLUMN = re.compile(
    r"^(?P<pre>.*?)ground_(?P<what>force|torque|moment)(?P<post>\d*(?:_\w+?)?)_(?P<kind>[vpm]?)(?P<axis>[xyz])$",
    re.IGNORECASE,
)
_MARGIN_M = 0.1
_UP = "+y"
"""Vertical axis by the convention of OpenSim; the formats state none."""


def read_text(path: Path, name: str, kind: str) -> str:
    """Content of a text file; raises ``UnreadableFile`` (``trc-too-large``, ``tsv-too-large`` ... by its ``kind``)."""
    if path.stat().st_size > MAX_MEMBER_BYTES:
        message = f"The {kind} file {name} exceeds the maximum size of {MAX_MEMBER_BYTES // 2**20} MB."
        raise UnreadableFile(f"{kind.lower()}-too-large", message, [Fault(name, f"{path.stat().st_size} bytes")])
    return path.read_bytes().decode("utf-8-sig", errors="replace")


def read_trc(path: Path, name: str) -> RawTrial:
    """Read a TRC file without forces; ``name`` is its name in error messages.

    Raises ``UnreadableFile`` as ``read_text`` and ``parse_trc``.
    """
    return _assemble_trial(TrialTexts(read_text(path, name, "TRC"), name, None, ""), "The TRC file")


def read_trc_mot(path: Path, texts: Mapping[str, str]) -> RawTrial:
    """Read one TRC and at most one force file among the unpacked ``texts`` of the zip ``path``.

    Raises ``UnreadableFile`` (``times-do-not-overlap``, and as ``find_trial``, ``parse_trc`` and ``parse_mot``).
    """
    return _assemble_trial(find_trial(path, texts), "The zip")


def _assemble_trial(texts: TrialTexts, source: str) -> RawTrial:
    """Trial of one TRC and at most one force file; ``source`` names the uploaded file in messages."""
    parse = parse_marker_storage if is_marker_storage(texts.trc) else parse_trc
    labels, time_s, points, rate_hz, unit, header_remarks = parse(texts.trc, texts.trc_name)
    cloud = mark_missing(points)
    scale, remarks = _length_scale(unit, cloud, texts.trc_name)
    remarks = (*header_remarks, *_frame_count_remark(texts, len(time_s)), *remarks)
    visible = [int(n) for n in (~np.isnan(cloud[:, :, 0])).sum(axis=0)]
    choice = names.select_labels(labels, visible, (), ())
    cloud = cloud[:, list(choice.column.values()), :] * scale
    remarks = (*choice.remarks, *remarks)
    contacts: tuple[FilePlate, ...] = ()
    force_rate_hz = rate_hz
    if texts.mot is None:
        message = (
            f"{source} holds markers only, no ground forces. Where a MOT or STO file has them, put it and the TRC file "
            "into one zip."
        )
        remarks = (*remarks, Remark(NO_FORCE_FILE, message))
    else:
        forces = read_contacts(texts.mot, texts.mot_name, time_s, rate_hz, texts.trc_name)
        cloud, time_s = cloud[forces.frames], time_s[forces.frames]
        contacts, force_rate_hz = forces.contacts, forces.rate_hz
        remarks = (*remarks, *forces.remarks)
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
        up_hint=_UP,
        remarks=remarks,
        metres_per_unit=scale,
    )


@dataclass(frozen=True)
class Contacts:
    """Contacts of a force file on a time grid from the first of the ``frames`` at which there are forces."""

    frames: Mask
    contacts: tuple[FilePlate, ...]
    rate_hz: float
    remarks: tuple[Remark, ...]


def read_contacts(
    text: str, name: str, time_s: Series, rate_hz: float, other: str, meaning: Mapping[str, str] = {}
) -> Contacts:
    """Contacts of the force file ``name`` for frames at ``time_s`` of the file ``other``; ``meaning`` as ``parse_mot``.

    Raises ``UnreadableFile`` (``times-do-not-overlap``, and as ``parse_mot``).
    """
    mot_time_s, forces = parse_mot(text, name, meaning)
    frames: Mask = (time_s >= mot_time_s[0] - 0.5 / rate_hz) & (time_s <= mot_time_s[-1] + 0.5 / rate_hz)
    if not frames.any():
        spans = [f"{t[0]:g} to {t[-1]:g} s" for t in (time_s, mot_time_s)]
        faults = [Fault(other, spans[0]), Fault(name, spans[1])]
        message = f"Markers ({spans[0]}) and forces ({spans[1]}) were recorded at different times."
        raise UnreadableFile("times-do-not-overlap", message, faults)
    remarks: tuple[Remark, ...] = ()
    if not frames.all():
        message = f"{int((~frames).sum())} frames have no force and were cut off."
        remarks = (Remark("cut-to-common-time", message),)
    force_rate_hz = sampling_rate_hz(mot_time_s)
    first_s = float(time_s[frames][0])
    for key, tracks in forces.items():
        for kind, track in tracks.items():
            tracks[kind], gaps = bridge_force_gaps(track, force_rate_hz, f"contact {key or 1}")
            remarks += gaps if kind == "v" else ()
    contacts, more = _resample_contacts(
        even_times_s(mot_time_s, first_s), forces, force_rate_hz, int(frames.sum()) / rate_hz
    )
    return Contacts(frames, contacts, force_rate_hz, (*remarks, *more))


def parse_mot(text: str, name: str, meaning: Mapping[str, str] = {}) -> tuple[Series, dict[str, dict[str, Points]]]:
    """Times, and per contact the arrays "v" (force), "p" (centre of pressure) and "t" (free moment), NaN where missing.

    Both header dialects (``nRows=``, ``datarows``) end in ``endheader``; contacts are distinguished by the prefix or
    suffix of the column name (``ground_force_vx``, ``1_ground_force_vx``, ``ground_force_r_vx``, ``ground_force1_vx``).
    ``meaning`` gives columns with other names such a name. Raises ``UnreadableFile`` (``mot-broken``,
    ``mot-without-forces``).
    """
    try:
        _, columns, table = parse_storage(text)
    except BrokenLineError as error:
        raise UnreadableFile(
            "mot-broken", f"The force file {name} is broken: {error}.", [Fault(name, str(error))]
        ) from error
    if len(table) < 2 or columns[0].lower() != "time" or not (np.diff(table[:, 0]) >= 0).all():
        raise UnreadableFile("mot-broken", "The force file has no increasing time column.", [Fault(name, "time")])
    contacts: dict[str, dict[str, Points]] = {}
    for i, column in enumerate(columns):
        match = _COLUMN.match(meaning.get(column, column))
        if match is None:
            continue
        contact = contacts.setdefault((match["pre"] + match["post"]).strip("_").lower(), {})
        kind = match["kind"].lower().replace("m", "t") if match["what"].lower() == "force" else "t"
        track = contact.setdefault(kind, np.zeros((len(table), 3)))
        track[:, "xyz".index(match["axis"].lower())] = np.where(np.isfinite(table[:, i]), table[:, i], np.nan)
    whole = {key: c for key, c in contacts.items() if {"v", "p"} <= set(c)}
    if not whole:
        raise UnreadableFile(
            "mot-without-forces", "The force file has no force and centre of pressure.", [Fault(name, "columns")]
        )
    return table[:, 0], whole


def even_times_s(time_s: Series, zero_s: float) -> Series:
    """Times from ``zero_s`` with even steps instead of rounded entries, and whole steps from zero if nearly so.

    A column that is not evenly sampled (off by half a step) is only shifted.
    """
    rate_hz = sampling_rate_hz(time_s)
    first = (time_s[0] - zero_s) * rate_hz
    steps = (round(first) if abs(first - round(first)) < 0.1 else first) + np.arange(len(time_s))
    even: Series = steps / rate_hz
    return even if np.abs(even - (time_s - zero_s)).max() < 0.5 / rate_hz else time_s - zero_s


def _length_scale(unit: str, cloud: Cloud, name: str) -> tuple[float, tuple[Remark, ...]]:
    """Factor to metres; a missing or unknown unit is inferred from the size of the body, with a remark.

    Raises ``UnreadableFile`` (``trc-broken``) if the size of the body fits no unit.
    """
    if unit.strip().lower() in LENGTH_SCALE:
        return length_scale(unit, cloud)
    stated = f"states {unit[:40]!r} as Units, which is not a unit of length" if unit else "states no Units"
    seen = unit_of_body(cloud)
    if seen is None:
        raise trc_broken(name, f"line 3 {stated}, and the markers span no body in mm, cm or m")
    message = f"Line 3 of {name} {stated}. The lengths are read in {seen}, in which the markers span a body."
    return LENGTH_SCALE[seen], (Remark("unit-assumed", message),)


def _frame_count_remark(texts: TrialTexts, n_frames: int) -> tuple[Remark, ...]:
    """Remark if the header states a different number of frames than the file contains."""
    try:
        stated = float(header_fields(trc_lines(texts.trc))["NumFrames"])
    except (KeyError, ValueError):
        return ()
    if stated == n_frames:
        return ()
    cut = " The file may have been cut off." if stated > n_frames else ""
    message = f"Line 3 of {texts.trc_name} states {stated:g} frames and {n_frames} follow; those are used.{cut}"
    return (Remark("trc-frame-count", message),)


def _resample_contacts(
    time_s: Series, forces: dict[str, dict[str, Points]], rate_hz: float, duration_s: float
) -> tuple[tuple[FilePlate, ...], tuple[Remark, ...]]:
    """Contacts on the time grid that starts at the first marker frame."""
    end_s = min(duration_s, float(time_s[-1]) + 0.5 / rate_hz)
    n = max(2, int(end_s * rate_hz) + 1)
    grid = np.arange(n) / rate_hz
    total: Vector3 = np.sum([c["v"].sum(axis=0) for c in forces.values()], axis=0)
    up = axis_vector(nearest_axis(total) or "+y")
    plates: list[FilePlate] = []
    for k, contact in enumerate(forces.values(), start=1):
        f = _interpolate_track(contact["v"], time_s, grid)
        loaded = np.linalg.norm(contact["v"], axis=1) > COP_THRESHOLD_N
        if not loaded.any():
            continue
        cop_m = np.column_stack([np.interp(grid, time_s[loaded], contact["p"][loaded, j]) for j in range(3)])
        T = _interpolate_track(contact["t"], time_s, grid) if "t" in contact else np.zeros_like(f)
        corners = bounding_rectangle(contact["p"][loaded], up)
        plates.append(FilePlate(k, CONTACT_TYPE, corners, f, np.cross(cop_m, f) + T, np.zeros(3)))
    message = "The force file names contacts, not plates; the plates shown here bound their centres of pressure."
    return tuple(plates), (Remark("plates-from-cop", message),)


def _interpolate_track(track: Points, time_s: Series, grid: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m 3"]:
    return np.column_stack([np.interp(grid, time_s, track[:, j]) for j in range(3)])


def bounding_rectangle(cop_m: Points, up: Vector3) -> Corners:
    """Horizontal rectangle around the centres of pressure with a margin of 10 cm, at their median height."""
    i, j = (k for k in range(3) if up[k] == 0.0)
    low, high = cop_m.min(axis=0) - _MARGIN_M, cop_m.max(axis=0) + _MARGIN_M
    corners = np.tile(np.median(cop_m, axis=0), (4, 1))
    for row, (a, b) in enumerate(((high[i], high[j]), (low[i], high[j]), (low[i], low[j]), (high[i], low[j]))):
        corners[row, i], corners[row, j] = a, b
    return corners
