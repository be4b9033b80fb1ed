"""Reads C3D files with ezc3d, assembles the plate signals from their channels, and adds points to a copy."""

import math
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Corners, Points
from stridelab.errors import Fault, InvalidInput, UnreadableFile
from stridelab.recordings.files import metadata as names
from stridelab.recordings.files.c3d_byte_orders import check_c3d, read_content, with_points, write_content
from stridelab.recordings.files.c3d_ezc3d import EZC3D_ERRORS, open_c3d
from stridelab.recordings.files.c3d_records import find_continued
from stridelab.recordings.files.metadata import (
    LENGTH_SCALE,
    length_scale,
    moment_scale,
    read_events,
    read_joint_widths_m,
    read_subject,
    recorded_on,
)
from stridelab.recordings.files.raw import LARGEST_PLAUSIBLE, Cloud, PlateSignals, Ranges, RawTrial
from stridelab.recordings.force_plates import CHANNELS, corners_fault, sensor_wrench
from stridelab.recordings.gap_filling import bridge_force_gaps, mark_missing
from stridelab.recordings.orientation import rotation_to_z_up
from stridelab.recordings.recording import Event, Remark

CARRIED_GROUP = "STRIDELAB"
"""Parameter group with the embedded metadata of a simulated recording."""
_PLATE_WIDTH_M = (0.15, 2.0)
"""A plate or a belt is as wide as a foot is long, and narrower than two people side by side."""
_SCREEN = {"+X": "+x", "-X": "+x", "+Y": "+y", "-Y": "+y", "+Z": "+z", "-Z": "+z"}
_PRESSURES_OF_TYPE_1 = (3, 4)
"""Channels of plates of type 1 that are no load but its place, which is arbitrary while the plate is empty."""
_FEWEST_BITS, _MOST_BITS = 8, 24
_OUTPUT_LISTS = ("ANGLES", "POWERS", "FORCES", "MOMENTS", "SCALARS")


class Parameters:
    """Parameters of a C3D file by group and name, in any case; absent ones read as empty."""

    def __init__(self, tree: Mapping[str, Any]) -> None:
        self._tree = {
            group.upper(): {name.upper(): entry for name, entry in content.items() if name != "__METADATA__"}
            for group, content in tree.items()
        }

    def names(self, group: str) -> list[str]:
        """Names of a group's parameters, in upper case."""
        return list(self._tree.get(group, {}))

    def _raw_value(self, group: str, name: str) -> Any:
        return self._tree.get(group, {}).get(name, {}).get("value", [])

    def numbers(self, group: str, name: str) -> Float[np.ndarray, "..."]:
        """Values as a float array in the file's shape; empty where absent or not numeric."""
        try:
            return np.asarray(self._raw_value(group, name), dtype=np.float64)
        except (TypeError, ValueError):
            return np.zeros(0)

    def number(self, group: str, name: str, default: float) -> float:
        """The first value; ``default`` if absent or not numeric."""
        values = self.numbers(group, name).ravel()
        return float(values[0]) if len(values) else default

    def texts(self, group: str, name: str) -> list[str]:
        """The values without surrounding blanks; empty where absent."""
        value = self._raw_value(group, name)
        return [str(text).strip() for text in value] if isinstance(value, list) else []

    def text(self, group: str, name: str) -> str:
        """The first of the values; empty where absent."""
        values = self.texts(group, name)
        return values[0] if values else ""


def read_c3d(path: Path) -> RawTrial:
    """Read one C3D file.

    Raises ``UnreadableFile`` (``c3d-unreadable``, ``no-frames``, ``no-markers``, and as ``check_c3d``).
    """
    checked = check_c3d(path)
    try:
        content = open_c3d(path, checked)
    except EZC3D_ERRORS as error:
        raise UnreadableFile(
            "c3d-unreadable",
            "The file has the header of a C3D file, but its parameters contradict each other or its data.",
            [Fault(path.name, "the C3D reader cannot interpret its parameters")],
        ) from error
    P = Parameters(content["parameters"])
    points = np.asarray(content["data"]["points"][:3], dtype=np.float64).transpose(2, 1, 0)
    analogs = np.asarray(content["data"]["analogs"][0], dtype=np.float64).T
    rate_hz = P.number("POINT", "RATE", 0.0) or float(content["header"]["points"]["frame_rate"])
    if len(points) == 0 or not 0.0 < rate_hz < 1e5:
        raise UnreadableFile(
            "no-frames", "The C3D file holds no frames, or no frame rate.", [Fault(path.name, "no frames")]
        )
    cloud = mark_missing(points)
    choice = _choose_labels(P, cloud)
    segment_remarks: tuple[Remark, ...] = ()
    if not choice.column and (poses := np.asarray(content["data"]["rotations"], dtype=np.float64)).size:
        cloud = mark_missing(poses[:3, 3].transpose(2, 1, 0)[:: max(1, poses.shape[3] // len(points))])
        choice = names.select_labels(P.texts("ROTATION", "LABELS")[: cloud.shape[1]], _count_visible(cloud), (), ())
        message = "The file has poses of body segments and no markers: the origins of the segments are used."
        segment_remarks = (Remark("segment-origins", message),)
    if not choice.column:
        raise _no_markers_error(path.name, P, cloud.shape[1], analogs.shape[1])
    column = list(choice.column.values())
    frame_remarks: tuple[Remark, ...] = ()
    if checked.lacks_frame:
        n = checked.layout.n_frames
        message = (
            f"The header states {n + 1} frames, and the file ends after {n}, at the end of a frame; those are used."
        )
        frame_remarks = (Remark("c3d-frame-count", message),)
    scale, unit_remarks = length_scale(P.text("POINT", "UNITS"), cloud[:, column, :])
    subject, subject_remarks = read_subject(_stated_subject(P))
    force_rate_hz = P.number("ANALOG", "RATE", rate_hz) or rate_hz
    plates, plate_remarks = _read_plates(P, analogs, force_rate_hz, _scale_of_plates(P, scale))
    return RawTrial(
        labels=tuple(choice.column),
        outputs=choice.outputs,
        points_m=cloud[:, column, :] * scale,
        marker_rate_hz=rate_hz,
        force_rate_hz=force_rate_hz,
        plates=plates,
        contacts=(),
        subject=subject,
        events=_read_events(P, int(content["header"]["points"]["first_frame"]), rate_hz),
        up_hint=_SCREEN.get(P.text("POINT", "Y_SCREEN").upper()),
        remarks=(*frame_remarks, *choice.remarks, *segment_remarks, *unit_remarks, *subject_remarks, *plate_remarks),
        metres_per_unit=scale,
        joint_widths_m=read_joint_widths_m(
            {name: P.number("PROCESSING", name, math.nan) for name in P.names("PROCESSING")}
        ),
        carried=_embedded_texts(P),
        recorded_on=recorded_on(P.texts, lambda group, name: P.numbers(group, name).ravel().tolist()),
    )


def add_points_to_c3d(source: Path, target: Path, points: Mapping[str, Points], up_axis: str) -> None:
    """Copy a C3D file with points added; its points, analog samples and parameters are preserved.

    The copy uses Intel floats, and the scale of its header is that of POINT:SCALE. ``points`` are in metres in the
    world frame, one row per frame of the file; they are converted to the file's unit and axes, of which ``up_axis``
    points up. A label that the file already has is replaced by ``<label>_stridelab``. Raises ``InvalidInput``
    (``wrong-frame-count``), and ``UnreadableFile`` as ``read_c3d``.
    """
    R = rotation_to_z_up(up_axis)
    file = read_content(source, check_c3d(source))
    n_frames = file.layout.n_frames
    taken = {label for record in find_continued(file.records, "POINT", "LABELS") for label in record.texts()}
    labels: list[str] = []
    for label, track in points.items():
        if len(track) != n_frames:
            message = f"The file has {n_frames} frames, the point {label} has {len(track)}."
            raise InvalidInput("wrong-frame-count", message, [Fault(label, "frames")])
        labels.append(f"{label}_stridelab" if label in taken else label)
    cloud = np.stack([track @ R for track in points.values()], axis=1) / read_c3d(source).metres_per_unit
    content = write_content(with_points(file, labels, cloud))
    with tempfile.TemporaryDirectory(dir=target.parent, prefix=".c3d-") as folder:
        written = Path(folder) / "out.c3d"
        written.write_bytes(content)
        shutil.move(written, target)


def _no_markers_error(file_name: str, P: Parameters, n_points: int, n_channels: int) -> UnreadableFile:
    """Error that names what a C3D file holds instead of markers."""
    labels = [label for label in _continued_texts(P, "LABELS") if label][:3]
    what = f"{n_points} points, none of them a named marker" if n_points else "no points"
    what += f" ({', '.join(labels)} ...)" if n_points and labels else ""
    if n_channels:
        what += f", and {n_channels} analog channels"
    if int(P.number("ROTATION", "USED", 0.0)) > 0:
        what += ", and the rotations of body segments, as systems without markers write them"
    message = f"The C3D file holds {what}; an estimate needs labelled markers."
    return UnreadableFile("no-markers", message, [Fault(file_name, "no labelled marker")])


def _choose_labels(P: Parameters, cloud: Cloud) -> names.LabelSelection:
    labels = _continued_texts(P, "LABELS")[: cloud.shape[1]]
    labels += [""] * (cloud.shape[1] - len(labels))
    not_positions = [name for group in _OUTPUT_LISTS for name in _continued_texts(P, group)]
    return names.select_labels(labels, _count_visible(cloud), not_positions, _continued_texts(P, "MODELED_MARKERS"))


def _count_visible(cloud: Cloud) -> list[int]:
    """Number of frames in which each point is visible."""
    return [int(n) for n in (~np.isnan(cloud[:, :, 0])).sum(axis=0)]


def _continued_texts(P: Parameters, name: str) -> list[str]:
    """A list of the POINT group that continues in NAME2, NAME3 ... after 255 entries."""
    values, k = P.texts("POINT", name), 2
    while more := P.texts("POINT", f"{name}{k}"):
        values, k = values + more, k + 1
    return values


def _embedded_texts(P: Parameters) -> dict[str, str]:
    """Texts of ``CARRIED_GROUP``, joined from their pieces."""
    pieces = {name.lower(): P.texts(CARRIED_GROUP, name) for name in P.names(CARRIED_GROUP)}
    return {name: "".join(texts) for name, texts in pieces.items() if texts}


def _stated_subject(P: Parameters) -> dict[str, float]:
    """Numbers about the subject: group SUBJECT (labels and values) or PROCESSING (one parameter each)."""
    values = P.numbers("SUBJECT", "VALUES").ravel()
    stated = {name: float(value) for name, value in zip(P.texts("SUBJECT", "LABELS"), values, strict=False)}
    for group in ("PROCESSING", "SUBJECT", CARRIED_GROUP):
        for name in ("HEIGHT", "BODYMASS", "MASS", "WEIGHT", "AGE", "GENDER"):
            number = P.number(group, name, math.nan)
            if not math.isnan(number) and name.lower() not in stated:
                stated[name.lower()] = number
    return stated


def _read_events(P: Parameters, first_frame: int, rate_hz: float) -> tuple[Event, ...]:
    """Events of the file; EVENT:TIMES is 2 x n, minutes and seconds."""
    times = P.numbers("EVENT", "TIMES")
    if times.size == 0:
        return ()
    times = times.reshape(2, -1) if times.shape[0] == 2 else times.reshape(-1, 2).T
    seconds = [float(t) for t in 60.0 * times[0] + times[1]]
    return read_events(P.texts("EVENT", "LABELS"), P.texts("EVENT", "CONTEXTS"), seconds, first_frame, rate_hz)


def _scale_of_plates(P: Parameters, scale: float) -> float:
    """Factor to metres of the plates' corners: that of the markers, or the stated one if only that gives plates.

    A program that exports markers in another unit than it states may leave the corners as they were.
    """
    corners = P.numbers("FORCE_PLATFORM", "CORNERS")
    stated = LENGTH_SCALE.get(P.text("POINT", "UNITS").strip().lower(), 1e-3)
    if stated == scale or corners.size < 12 or corners.size % 12:
        return scale
    plates = corners.reshape(3, 4, -1).transpose(2, 1, 0)
    sides = np.linalg.norm(np.roll(plates, -1, axis=1) - plates, axis=2)
    widths = sides.min(axis=1)

    def n_plausible(factor: float) -> int:
        return int(((widths * factor > _PLATE_WIDTH_M[0]) & (widths * factor < _PLATE_WIDTH_M[1])).sum())

    return stated if n_plausible(stated) > n_plausible(scale) else scale


def _read_plates(
    P: Parameters, analogs: np.ndarray, rate_hz: float, scale: float
) -> tuple[tuple[PlateSignals, ...], list[Remark]]:
    group = "FORCE_PLATFORM"
    kinds = P.numbers(group, "TYPE").ravel()
    n = min(int(P.number(group, "USED", 0.0)), len(kinds))
    if n <= 0:
        return (), []
    channel = P.numbers(group, "CHANNEL")
    channel = channel.reshape(channel.shape[0], -1) if channel.ndim >= 2 else channel.reshape(-1, n, order="F")
    corners = P.numbers(group, "CORNERS")
    origin = P.numbers(group, "ORIGIN")
    calibration = P.numbers(group, "CAL_MATRIX")
    zero = P.numbers(group, "ZERO").ravel()
    zero_samples = (int(zero[0]), int(zero[1])) if len(zero) >= 2 else None
    plates: list[PlateSignals] = []
    remarks: list[Remark] = []
    for k in range(n):
        kind = int(kinds[k])
        fault = _layout_fault(kind, k, channel, corners, origin, analogs.shape[1])
        corners_m: Corners = np.full((4, 3), np.nan)
        if fault is None:
            corners_m = corners.reshape(3, 4, -1)[:, :, k].T * scale
            fault = corners_fault(corners_m)
        if fault is not None:
            remarks.append(Remark("plate-unusable", f"Plate {k + 1} was left out: {fault}."))
            continue
        used = [int(i) - 1 for i in channel[: CHANNELS[kind], k]]
        if np.isnan(analogs[:, used]).all(axis=0).any():
            remarks.append(Remark("plate-unusable", f"Plate {k + 1} was left out: one of its channels has no scale."))
            continue
        unit = _moment_unit(P, used[-1])
        matrix = calibration.reshape(6, 6, -1)[:, :, k] if kind == 4 and calibration.size >= 36 * (k + 1) else None
        if matrix is not None and P.text(group, "MATRIX_STORE").upper() == "BYROW":
            matrix = matrix.T
        origin_m = origin.reshape(3, -1)[:, k] * scale
        signals, gaps = bridge_force_gaps(analogs[:, used], rate_hz, f"plate {k + 1}")
        remarks += gaps
        if (np.abs(signals) > LARGEST_PLAUSIBLE).any():
            remarks.append(
                Remark("plate-unusable", f"Plate {k + 1} was left out: its channels hold impossible values.")
            )
            continue
        force, moment, o = sensor_wrench(kind, signals, origin_m, matrix, moment_scale(unit, scale), scale)
        moment_unit = unit if kind in (2, 4) else None
        plate = PlateSignals(k + 1, kind, corners_m, o, force, moment, zero_samples, moment_unit)
        loadable = [i for i in range(len(used)) if kind != 1 or i not in _PRESSURES_OF_TYPE_1]
        ranges = _converter_ranges(P, [used[i] for i in loadable])
        plates.append(replace(plate, channels=signals[:, loadable], ranges=ranges))
    return tuple(plates), remarks


def _converter_ranges(P: Parameters, channels: Sequence[int]) -> Ranges:
    """Values at either end of the range of ANALOG:BITS bits, about the offset; NaN where a channel has no scale."""
    bits = P.number("ANALOG", "BITS", 0.0)
    scales = P.numbers("ANALOG", "SCALE").ravel() * P.number("ANALOG", "GEN_SCALE", 1.0)
    if not _FEWEST_BITS <= bits <= _MOST_BITS:
        return np.full((len(channels), 2), np.nan)
    half = 2.0 ** (int(bits) - 1)
    ends = [np.array([-half, half - 1.0]) * (scales[i] if i < len(scales) else np.nan) for i in channels]
    return np.sort(np.array(ends), axis=1)


def _layout_fault(
    kind: int, k: int, channel: np.ndarray, corners: np.ndarray, origin: np.ndarray, n_channels: int
) -> str | None:
    """Reason why the parameters do not describe plate ``k``, or None."""
    if kind not in CHANNELS:
        return f"plate type {kind} is not one of 1 to 4"
    if channel.shape[0] < CHANNELS[kind] or channel.shape[1] <= k:
        return "its channels are not listed"
    indices = channel[: CHANNELS[kind], k]
    if not ((indices >= 1) & (indices <= n_channels)).all():
        return "its channels are not in the file"
    if corners.size < 12 * (k + 1):
        return "its corners are missing"
    return "its ORIGIN is missing" if origin.size < 3 * (k + 1) else None


def _moment_unit(P: Parameters, channel: int) -> str:
    """Unit of a moment channel as in the file; empty if absent."""
    units: Sequence[str] = P.texts("ANALOG", "UNITS")
    return units[channel] if channel < len(units) else ""
