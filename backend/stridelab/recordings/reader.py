"""Reads recordings of all supported formats, detected by content, and converts them to the world frame."""

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from stridelab.conventions import Mask, Points, Rotation, Vector3
from stridelab.errors import Fault, InvalidInput, UnreadableFile
from stridelab.recordings import orientation
from stridelab.recordings.clipped_force import clipped_intervals_s, clipped_remark
from stridelab.recordings.file_axes import with_common_axes
from stridelab.recordings.files.c3d import read_c3d
from stridelab.recordings.files.foreign_formats import unknown_format_error
from stridelab.recordings.files.mvnx import is_mvnx, read_mvnx
from stridelab.recordings.files.nexus_csv import is_nexus_csv, read_nexus_csv
from stridelab.recordings.files.opensim_zip import is_trc, unpack_texts
from stridelab.recordings.files.qualisys_tsv import is_qualisys_markers, read_qualisys
from stridelab.recordings.files.raw import FilePlate, RawTrial
from stridelab.recordings.files.trc import is_marker_storage
from stridelab.recordings.files.trc_mot import read_text, read_trc, read_trc_mot
from stridelab.recordings.foot_contact import detect_treadmill
from stridelab.recordings.force_plates import LOADED_N, plate_wrench, with_true_moment_units
from stridelab.recordings.gap_filling import fill_short_gaps
from stridelab.recordings.opensim.model_trial import has_body_model, read_model_trial
from stridelab.recordings.plate_contacts import fore_aft_remarks
from stridelab.recordings.recording import Plate, PlateSwitches, Recording, Remark
from stridelab.recordings.repeated_plates import without_repeated

_HEAD_BYTES: Final = 20_000
_C3D_KEY: Final = b"P"
"""Second byte of every C3D file."""


def read_recording(
    path: Path,
    *,
    name: str | None = None,
    marker_map: Mapping[str, str] = {},
    plate_switches: Mapping[int, PlateSwitches] = {},
) -> Recording:
    """Read a C3D, TRC or MVNX file, a TSV export of Qualisys, a CSV export of Vicon Nexus, or a zip.

    A zip holds one TRC and one MOT or STO file, the TSV files of one recording, or an OpenSim model and its joint
    angles, with forces if there are any. A TRC, TSV or MVNX file alone gives markers and no plates. ``name`` is the
    file name in error messages, by default that of ``path``. ``marker_map`` maps landmark names to labels of this file;
    ``plate_switches`` maps a plate's index to the user's settings. Raises ``InvalidInput`` (``unknown-marker``,
    ``unknown-plate``, ``belt-speed-contradicts-feet``), and ``UnreadableFile``: ``no-markers``, ``all-missing``,
    ``unknown-format``, and as ``read_c3d``, ``read_trc``, ``read_trc_mot``, ``read_model_trial``, ``read_mvnx``,
    ``read_qualisys`` and ``read_nexus_csv``.
    """
    raw = _read_raw(path, name or path.name)
    if np.isnan(raw.points_m).all():
        code, what = ("no-markers", "no labelled marker") if raw.points_m.shape[1] == 0 else ("all-missing", "only NaN")
        raise UnreadableFile(code, f"The recording shows no marker at any time ({what}).", [Fault(path.name, what)])
    recording = to_world(raw, plate_switches)
    unknown = sorted(set(marker_map.values()) - set(recording.markers_m))
    if unknown:
        faults = [Fault(label, "no such label in the file") for label in unknown]
        raise InvalidInput("unknown-marker", "The marker map names labels that the file does not have.", faults)
    return recording


def is_c3d(path: Path) -> bool:
    """Whether ``read_recording`` reads a file as C3D."""
    with path.open("rb") as file:
        return file.read(2)[1:] == _C3D_KEY and not zipfile.is_zipfile(path)


def _read_raw(path: Path, name: str) -> RawTrial:
    if path.stat().st_size == 0:
        raise UnreadableFile("empty-file", "The file is empty (0 bytes).", [Fault(path.name, "0 bytes")])
    if zipfile.is_zipfile(path):
        texts = unpack_texts(path)
        if any(map(is_qualisys_markers, texts.values())):
            return read_qualisys(texts)
        of_model = read_model_trial(texts) if has_body_model(texts) else None
        return read_trc_mot(path, texts) if of_model is None else of_model
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    if head[:2] == b"PK":
        raise UnreadableFile("zip-damaged", "The zip file is damaged or truncated.", [Fault(path.name, "not readable")])
    if head[1:2] == _C3D_KEY:
        try:
            return read_c3d(path)
        except UnreadableFile as error:
            if error.code != "not-c3d":
                raise
            raise unknown_format_error(head, name) from error
    text = head.decode("utf-8-sig", errors="replace")
    if is_trc(text) or is_marker_storage(text):
        return read_trc(path, name)
    if is_qualisys_markers(text):
        return read_qualisys({name: read_text(path, name, "TSV")})
    if is_mvnx(text):
        return read_mvnx(read_text(path, name, "MVNX"), name)
    if is_nexus_csv(text):
        return read_nexus_csv(read_text(path, name, "CSV"), name)
    if name.lower().endswith(".trc"):
        why = "line 1 does not begin with PathFileType"
        raise UnreadableFile("trc-broken", f"The TRC file {name} is broken: {why}.", [Fault(name, why)])
    raise unknown_format_error(head, name)


def to_world(raw: RawTrial, switches: Mapping[int, PlateSwitches]) -> Recording:
    """Rotate the trial into the world frame (z up), tare and repair the plates, fill short gaps."""
    raw, up, axes_remarks = with_common_axes(raw)
    remarks = [*raw.remarks, *axes_remarks]
    if not (raw.plates or raw.contacts) and raw.up_hint not in (None, up):
        message = f"The body stands along {up} of the file, which is used as the vertical axis, not {raw.up_hint}."
        remarks.append(Remark("up-axis-from-body", message))
    R = orientation.rotation_to_z_up(up)
    plates, plate_remarks = _world_plates(raw, orientation.axis_vector(up), R, switches)
    belts_m_s = _belts_m_s(plates, switches)
    remarks += plate_remarks
    points = raw.points_m @ R.T
    markers, outputs, filled = _split_tracks(raw, points)
    if filled:
        n = sum(int(mask.sum()) for mask in filled.values())
        message = f"Short gaps of {len(filled)} markers were interpolated ({n} samples)."
        remarks.append(Remark("gaps-filled", message))
    is_marker = [label not in raw.outputs for label in raw.labels]
    body = points[:, is_marker, :]
    direction = orientation.walking_direction(body, raw.marker_rate_hz)
    treadmill = detect_treadmill(
        list(markers.values()), belts_m_s, body, direction, raw.marker_rate_hz, plates=bool(plates)
    )
    if treadmill is not None:
        direction, remark = treadmill
        remarks.append(remark)
    remarks += fore_aft_remarks(plates, direction, raw.force_rate_hz)
    return Recording(
        markers_m=markers,
        marker_rate_hz=raw.marker_rate_hz,
        force_rate_hz=raw.force_rate_hz,
        plates=plates,
        subject=raw.subject,
        events=raw.events,
        up_axis=up,
        walking_direction=direction,
        remarks=tuple(remarks),
        carried=raw.carried,
        joint_widths_m=raw.joint_widths_m,
        model_points_m=outputs,
        filled=filled,
        recorded_on=raw.recorded_on,
        segments={name: replace(part, com_m=part.com_m @ R.T) for name, part in raw.segments.items()},
        belts_m_s={} if plates else belts_m_s,
    )


def _belts_m_s(plates: Sequence[Plate], switches: Mapping[int, PlateSwitches]) -> dict[int, float]:
    """Stated belt speeds by the index of their plates; without any plate the index numbers the belts."""
    stated = {index: one.belt_speed_m_s for index, one in switches.items() if one.belt_speed_m_s is not None}
    known = sorted(plate.index for plate in plates)
    absent = sorted(stated.keys() - set(known))
    if plates and absent:
        faults = [Fault(f"plates.{index}.belt_speed_m_s", "no such plate") for index in absent]
        message = f"A belt speed is stated for a plate that the file does not have; its plates: {known}."
        raise InvalidInput("unknown-plate", message, faults)
    return stated


def _world_plates(
    raw: RawTrial, up: Vector3, R: Rotation, switches: Mapping[int, PlateSwitches]
) -> tuple[tuple[Plate, ...], list[Remark]]:
    file_plates: list[FilePlate] = []
    remarks: list[Remark] = []
    for contact in raw.contacts:
        loaded = np.linalg.norm(contact.force_n, axis=1) > LOADED_N
        clipped_s = clipped_intervals_s(contact.force_n, loaded, raw.force_rate_hz)
        file_plates.append(replace(contact, clipped_s=clipped_s))
    all_signals, unit_remarks = with_true_moment_units(raw.plates, up, raw.force_rate_hz)
    remarks += unit_remarks
    for signals in all_signals:
        plate, more = plate_wrench(signals, up, raw.force_rate_hz)
        file_plates.append(plate)
        remarks += more
    remarks += [clipped_remark(plate) for plate in file_plates if plate.clipped_s]
    plates = []
    for plate in file_plates:
        switch = switches.get(plate.index, PlateSwitches())
        offset_m = np.asarray(switch.moment_offset_m or (0.0, 0.0, 0.0))
        force_n, zero_n = plate.force_n @ R.T, R @ plate.tare_force_n
        plates.append(
            Plate(
                index=plate.index,
                type=plate.type,
                corners_m=plate.corners_m @ R.T,
                force_n=force_n,
                moment_nm=plate.moment_nm @ R.T + np.cross(offset_m, force_n),
                tare_force_n=zero_n,
                tare_moment_nm=R @ plate.tare_moment_nm + np.cross(offset_m, zero_n),
                zero_is_known=plate.zero_is_known,
                use=plate.usable and switch.use is not False,
                threshold_n=20.0 if switch.threshold_n is None else switch.threshold_n,
                belt_speed_m_s=switch.belt_speed_m_s,
                moment_offset_m=switch.moment_offset_m,
                clipped_s=plate.clipped_s,
            )
        )
    used, repeated_remarks = without_repeated(plates)
    return used, [*remarks, *repeated_remarks]


def _split_tracks(raw: RawTrial, points: np.ndarray) -> tuple[dict[str, Points], dict[str, Points], dict[str, Mask]]:
    """Markers, model points and the masks of filled frames, by label; labels that are never visible are omitted."""
    markers: dict[str, Points] = {}
    outputs: dict[str, Points] = {}
    filled: dict[str, Mask] = {}
    for i, label in enumerate(raw.labels):
        track = points[:, i, :]
        if np.isnan(track).all():
            continue
        track, mask = fill_short_gaps(track, raw.marker_rate_hz)
        if label in raw.outputs:
            outputs[label] = track
            continue
        markers[label] = track
        if mask.any():
            filled[label] = mask
    return markers, outputs, filled
