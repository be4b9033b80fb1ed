"""C3D files out: a recording as a whole, or an uploaded file with points added."""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import ezc3d
import numpy as np
from jaxtyping import Float

from stridelab.conventions import Points
from stridelab.errors import Fault, InvalidInput, UnreadableFile
from stridelab.recordings.axes import rotation_to_z_up
from stridelab.recordings.c3d import CARRIED_GROUP, read_c3d
from stridelab.recordings.plates import plate_axes
from stridelab.recordings.reader import up_axis_of
from stridelab.recordings.recording import Plate, Recording

_TEXT_CHUNK = 100
_KIND = {"foot_strike": "Foot Strike", "foot_off": "Foot Off"}


def write_c3d(path: Path, recording: Recording, *, extra_points: Mapping[str, Points] = {}) -> None:
    """Write a recording: markers in mm, plates as type 2 with channels in N and Nmm, events, subject, what it carries.

    ``extra_points`` (metres, world frame) are added after the markers. World axes are kept (z up). Reading the file
    back gives the same wrench to single precision; where the force rate is no multiple of the marker rate the channels
    are interpolated to the next higher one. The person's height and mass go to PROCESSING, never a name.
    """
    points = {**recording.markers_m, **recording.model_points_m, **extra_points}
    content = ezc3d.c3d()
    parameters = content["parameters"]
    cloud = np.stack([np.asarray(track, dtype=np.float64) for track in points.values()], axis=1)
    content["data"]["points"] = homogeneous(1000.0 * cloud)
    parameters["POINT"]["RATE"]["value"] = np.array([recording.marker_rate_hz])
    parameters["POINT"]["UNITS"]["value"] = ["mm"]
    parameters["POINT"]["LABELS"]["value"] = list(points)
    content.add_parameter("POINT", "X_SCREEN", "+X")
    content.add_parameter("POINT", "Y_SCREEN", "+Z")
    if recording.model_points_m:
        content.add_parameter("POINT", "MODELED_MARKERS", list(recording.model_points_m))
    _add_plates(content, recording)
    _add_events(content, recording)
    for name, value in (("Height", recording.subject.height_m), ("Bodymass", recording.subject.mass_kg)):
        if value is not None:
            content.add_parameter("PROCESSING", name, [value * (1000.0 if name == "Height" else 1.0)])
    for name, width_m in recording.joint_widths_m.items():
        side, joint = name.split("_")
        content.add_parameter("PROCESSING", f"{side.upper()}{joint.capitalize()}Width", [1000.0 * width_m])
    if recording.subject.age_years is not None:
        content.add_parameter(CARRIED_GROUP, "AGE", [recording.subject.age_years])
    if recording.subject.sex is not None:
        content.add_parameter(CARRIED_GROUP, "GENDER", [1.0 if recording.subject.sex == "male" else 0.0])
    for key, text in recording.carried.items():
        content.add_parameter(CARRIED_GROUP, key.upper(), chunks(text))
    _write(content, path)


def add_points_to_c3d(source: Path, target: Path, points: Mapping[str, Points]) -> None:
    """Copy a C3D file with points added; everything else in it stays as it was.

    ``points`` are in metres in the world frame, one row per frame of the file, and are turned back into the file's own
    axes and unit. A label that the file already has is replaced by ``<label>_stridelab``. Raises ``InvalidInput``
    (``wrong-frame-count``), and ``UnreadableFile`` (``c3d-unreadable``, and as ``read_c3d``).
    """
    raw = read_c3d(source)
    R = rotation_to_z_up(up_axis_of(raw))
    try:
        content = ezc3d.c3d(str(source))
    except (OSError, RuntimeError, ValueError, IndexError) as error:
        raise UnreadableFile(
            "c3d-unreadable", "The C3D file cannot be read.", [Fault(source.name, str(error))]
        ) from error
    parameters = content["parameters"]["POINT"]
    data = content["data"]
    n_frames = data["points"].shape[2]
    added: dict[str, Points] = {}
    taken_in_order = _entries(parameters, "LABELS")
    for label, track in points.items():
        if len(track) != n_frames:
            message = f"The file has {n_frames} frames, the point {label} has {len(track)}."
            raise InvalidInput("wrong-frame-count", message, [Fault(label, "frames")])
        added[f"{label}_stridelab" if label in taken_in_order else label] = (track @ R) / raw.metres_per_unit
    new = homogeneous(np.stack(list(added.values()), axis=1))
    data["points"] = np.concatenate([data["points"], new], axis=1)
    _extend_meta(data["meta_points"], new)
    described = len(_entries(parameters, "DESCRIPTIONS")) == len(taken_in_order)
    for label in added:
        _append(parameters, "LABELS", label)
        if described:
            _append(parameters, "DESCRIPTIONS", "added by stridelab")
    _readable_texts(content["parameters"])
    _write(content, target)


def homogeneous(cloud: Float[np.ndarray, "frames points 3"]) -> Float[np.ndarray, "4 points frames"]:
    """ezc3d's layout: x, y, z, 1 by point by frame."""
    ones = np.ones((*cloud.shape[:2], 1))
    return np.ascontiguousarray(np.concatenate([cloud, ones], axis=2).transpose(2, 1, 0))


def chunks(text: str) -> list[str]:
    """Cut a text into C3D strings, never beside a blank (blanks at the ends of C3D strings are lost)."""
    parts: list[str] = []
    while text:
        n = min(_TEXT_CHUNK, len(text))
        while 1 < n < len(text) and (text[n - 1].isspace() or text[n].isspace()):
            n -= 1
        parts.append(text[:n])
        text = text[n:]
    return parts or [""]


def _add_plates(content: Any, recording: Recording) -> None:
    plates = recording.plates
    if not plates:
        return
    ratio = max(1, int(np.ceil(recording.force_rate_hz / recording.marker_rate_hz - 1e-6)))
    n, rate_hz = ratio * recording.n_frames, ratio * recording.marker_rate_hz
    channels, labels, units = [], [], []
    for k, plate in enumerate(plates, start=1):
        force, moment = _plate_signals(plate)
        for track, name, unit in ((force, "F", "N"), (1000.0 * moment, "M", "Nmm")):
            channels.append(_resample(track, recording.force_rate_hz, n, rate_hz))
            labels += [f"{name}{axis}{k}" for axis in "xyz"]
            units += [unit] * 3
    m = len(plates)
    analog = content["parameters"]["ANALOG"]
    content["data"]["analogs"] = np.concatenate(channels, axis=1).T[None]
    analog["RATE"]["value"] = np.array([rate_hz])
    analog["LABELS"]["value"] = labels
    analog["UNITS"]["value"] = units
    analog["SCALE"]["value"] = np.ones(6 * m)
    analog["OFFSET"]["value"] = np.zeros(6 * m, dtype=int)
    group = "FORCE_PLATFORM"
    _add_integers(content, group, "USED", [m])
    _add_integers(content, group, "TYPE", [2] * m)
    _add_integers(content, group, "ZERO", [0, 0])
    _add_integers(content, group, "CHANNEL", np.arange(1, 6 * m + 1).reshape(m, 6).T)
    content.add_parameter(group, "CORNERS", 1000.0 * np.stack([plate.corners_m.T for plate in plates], axis=2))
    content.add_parameter(group, "ORIGIN", np.zeros((3, m)))


def _add_integers(content: Any, group: str, name: str, values: Any) -> None:
    """ezc3d stores every number as a float unless told; programs expect counts and channels to be integers."""
    content.add_parameter(group, name, np.asarray(values, dtype=np.float64))
    content["parameters"][group][name]["type"] = ezc3d.ezc3d.INT


def _plate_signals(plate: Plate) -> tuple[Points, Points]:
    """Force and moment about the centre of the corners, in the plate's axes: what a sensor at the surface reads."""
    R = plate_axes(plate.corners_m)
    c = plate.corners_m.mean(axis=0)
    return plate.force_n @ R, (plate.moment_nm - np.cross(c, plate.force_n)) @ R


def _resample(track: Points, from_hz: float, n: int, to_hz: float) -> Float[np.ndarray, "m 3"]:
    time_s, at_s = np.arange(len(track)) / from_hz, np.arange(n) / to_hz
    return np.column_stack([np.interp(at_s, time_s, track[:, j]) for j in range(3)])


def _add_events(content: Any, recording: Recording) -> None:
    if not recording.events:
        return
    events = recording.events
    _add_integers(content, "EVENT", "USED", [len(events)])
    content.add_parameter("EVENT", "LABELS", [_KIND[event.kind] for event in events])
    content.add_parameter("EVENT", "CONTEXTS", [(event.side or "General").capitalize() for event in events])
    times = np.array([[np.floor(event.time_s / 60.0) for event in events], [event.time_s % 60.0 for event in events]])
    content.add_parameter("EVENT", "TIMES", times)


def _entries(parameters: Any, name: str) -> list[str]:
    """A list that goes on in NAME2, NAME3 ... after 255 entries."""
    values, k = list(parameters[name]["value"]) if name in parameters else [], 2
    while f"{name}{k}" in parameters:
        values, k = values + list(parameters[f"{name}{k}"]["value"]), k + 1
    return values


def _append(parameters: Any, name: str, text: str) -> None:
    """Add to the last of NAME, NAME2, ... (each holds 255 entries at most)."""
    last, k = name, 2
    while f"{name}{k}" in parameters:
        last, k = f"{name}{k}", k + 1
    parameters[last]["value"] = [*parameters[last]["value"], text]


def _readable_texts(groups: Any) -> None:
    """Texts in files have any encoding and ezc3d writes UTF-8 only: others are taken for Latin-1 (raised 2, micro)."""
    for group in groups.values():
        for name, entry in group.items():
            if name != "__METADATA__" and isinstance(entry["value"], list):
                entry["value"] = [_decoded(text) for text in entry["value"]]


def _decoded(text: str) -> str:
    return text.encode("utf-8", "surrogateescape").decode("latin-1") if not text.isprintable() else text


def _extend_meta(meta: Any, new: Float[np.ndarray, "4 points frames"]) -> None:
    """Residuals and camera masks of the added points: computed, so residual 0 where present and -1 where not."""
    missing = np.isnan(new[:1])
    meta["residuals"] = np.concatenate([meta["residuals"], np.where(missing, -1.0, 0.0)], axis=1)
    masks = np.zeros((7, *new.shape[1:]), dtype=bool)
    meta["camera_masks"] = np.concatenate([meta["camera_masks"], masks], axis=1)


def _write(content: Any, path: Path) -> None:
    """ezc3d insists on the suffix .c3d; write beside the target and move it there whole."""
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".c3d-") as folder:
        written = Path(folder) / "out.c3d"
        content.write(str(written))
        written.replace(path)
