"""Writes a whole recording as a C3D file."""

import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import ezc3d
import numpy as np
from jaxtyping import Float

from stridelab.conventions import Points
from stridelab.recordings.files.c3d import CARRIED_GROUP
from stridelab.recordings.force_plates import plate_axes
from stridelab.recordings.recording import Plate, Recording

_TEXT_CHUNK = 100
_MAX_FRAMES = 65535
"""Maximum number of frames in the header of a C3D file; larger counts go to the TRIAL group."""
_KIND = {"foot_strike": "Foot Strike", "foot_off": "Foot Off"}


def write_c3d(path: Path, recording: Recording, *, extra_points: Mapping[str, Points] = {}) -> None:
    """Write a recording: markers in mm, plates as type 2 with channels in N and Nmm, events, subject, metadata.

    ``extra_points`` (metres, world frame) are added after the markers. The axes of the file are those of the world (z
    up). Reading the file back gives the same wrench to single precision; if the force rate is not a multiple of the
    marker rate, the channels are interpolated to the next higher multiple. The subject's height and mass go to
    PROCESSING; no name is written.
    """
    points = {**recording.markers_m, **recording.model_points_m, **extra_points}
    content = ezc3d.c3d()
    parameters = content["parameters"]
    cloud = np.stack([np.asarray(track, dtype=np.float64) for track in points.values()], axis=1)
    content["data"]["points"] = homogeneous_points(1000.0 * cloud)
    parameters["POINT"]["RATE"]["value"] = np.array([recording.marker_rate_hz])
    parameters["POINT"]["UNITS"]["value"] = ["mm"]
    parameters["POINT"]["LABELS"]["value"] = list(points)
    content.add_parameter("POINT", "X_SCREEN", "+X")
    content.add_parameter("POINT", "Y_SCREEN", "+Z")
    if recording.model_points_m:
        content.add_parameter("POINT", "MODELED_MARKERS", list(recording.model_points_m))
    if recording.n_frames > _MAX_FRAMES:
        _add_frame_count(content, recording.n_frames)
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
        content.add_parameter(CARRIED_GROUP, key.upper(), split_text(text))
    _write_atomically(content, path)


def homogeneous_points(cloud: Float[np.ndarray, "frames points 3"]) -> Float[np.ndarray, "4 points frames"]:
    """Points in the array layout of ezc3d: (x, y, z, 1) by point by frame."""
    ones = np.ones((*cloud.shape[:2], 1))
    return np.ascontiguousarray(np.concatenate([cloud, ones], axis=2).transpose(2, 1, 0))


def split_text(text: str) -> list[str]:
    """Split a text into C3D strings, never next to a blank: blanks at the ends of C3D strings are lost."""
    parts: list[str] = []
    while text:
        n = min(_TEXT_CHUNK, len(text))
        while 1 < n < len(text) and (text[n - 1].isspace() or text[n].isspace()):
            n -= 1
        parts.append(text[:n])
        text = text[n:]
    return parts or [""]


def _add_frame_count(content: Any, n_frames: int) -> None:
    """Write the first and last frame as two 16-bit words each, the lower one first."""
    for name, frame in (("ACTUAL_START_FIELD", 1), ("ACTUAL_END_FIELD", n_frames)):
        low, high = frame % 65536, frame // 65536
        content.add_parameter("TRIAL", name, [float(low - 65536 if low > 32767 else low), float(high)])
        content["parameters"]["TRIAL"][name]["type"] = ezc3d.ezc3d.INT


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
            channels.append(_resample_track(track, recording.force_rate_hz, n, rate_hz))
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
    """Add a parameter as integers: ezc3d stores floats by default, but programs expect counts to be integers."""
    content.add_parameter(group, name, np.asarray(values, dtype=np.float64))
    content["parameters"][group][name]["type"] = ezc3d.ezc3d.INT


def _plate_signals(plate: Plate) -> tuple[Points, Points]:
    """Force and moment about the centre of the corners, in the plate's axes: signals of a sensor at the surface."""
    R = plate_axes(plate.corners_m)
    c = plate.corners_m.mean(axis=0)
    return plate.force_n @ R, (plate.moment_nm - np.cross(c, plate.force_n)) @ R


def _resample_track(track: Points, from_hz: float, n: int, to_hz: float) -> Float[np.ndarray, "m 3"]:
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


def _write_atomically(content: Any, path: Path) -> None:
    """Write to a temporary .c3d file (ezc3d requires the suffix) and move it to ``path`` atomically."""
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".c3d-") as folder:
        written = Path(folder) / "out.c3d"
        content.write(str(written))
        shutil.move(written, path)
