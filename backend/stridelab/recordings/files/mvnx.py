"""Reads MVNX files of Xsens MVN: the anatomical points of its body model, and the centre of mass that it computed.

A frame gives the position p_s and orientation (quaternion wxyz) of each segment; a point of segment s, which the file
places at b in the segment's frame, is at p_s + R_s b. These are the points that MVN exports as C3D. In a file without
the points or the orientations the segments' origins, which lie in the joints, are used. World frame of the file: z up,
metres.
"""

from dataclasses import dataclass
from datetime import date, datetime
from typing import Final
from xml.etree.ElementTree import Element

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Vector3
from stridelab.errors import Fault, UnreadableFile
from stridelab.recordings.files.raw import LARGEST_PLAUSIBLE, NO_FORCE_FILE, Cloud, RawTrial
from stridelab.recordings.files.xml_tree import BrokenXmlError, parse_xml
from stridelab.recordings.recording import Remark, Subject

COM_LABEL: Final = "CentreOfMass"
MAX_SEGMENTS: Final = 100
MAX_POINTS: Final = 1_000
_MAX_NUMBERS: Final = 50_000_000
_SKIPPED: Final = frozenset(
    {"velocity", "acceleration", "angularVelocity", "angularAcceleration", "sensorFreeAcceleration"}
    | {"sensorMagneticField", "sensorOrientation", "jointAngle", "jointAngleXZY", "jointAngleErgo", "fingers"}
    | {"jointAngleErgoXZY", "footContacts", "contacts", "sensors", "joints", "ergonomicJointAngles", "marker"}
)
_SEGMENTS: Final = (
    *("Pelvis", "L5", "L3", "T12", "T8", "Neck", "Head"),
    *("RightShoulder", "RightUpperArm", "RightForeArm", "RightHand"),
    *("LeftShoulder", "LeftUpperArm", "LeftForeArm", "LeftHand"),
    *("RightUpperLeg", "RightLowerLeg", "RightFoot", "RightToe"),
    *("LeftUpperLeg", "LeftLowerLeg", "LeftFoot", "LeftToe"),
)
"""Order of MVN's segments; files without a list of segments have it."""


class _BrokenMvnxError(ValueError):
    """A part of a file that cannot be used; the message completes a sentence for users."""


@dataclass(frozen=True)
class _Point:
    label: str
    segment: int
    local_m: Vector3


def is_mvnx(text: str) -> bool:
    """Whether a text begins like an MVNX file."""
    return "<mvnx" in text and text.lstrip("\ufeff \t\r\n").startswith("<")


def read_mvnx(text: str, name: str) -> RawTrial:
    """Points and computed centre of mass of the frames of motion; calibration poses are left out.

    Raises ``UnreadableFile`` (``mvnx-broken``).
    """
    try:
        root = parse_xml(text, _SKIPPED)
        for element in root.iter():
            element.tag = element.tag.rpartition(":")[2]
        return _parse_subject(root.find("subject"))
    except (BrokenXmlError, _BrokenMvnxError) as error:
        raise UnreadableFile(
            "mvnx-broken", f"The MVNX file {name} cannot be read: {error}.", [Fault(name, str(error))]
        ) from error


def _parse_subject(subject: Element | None) -> RawTrial:
    if subject is None:
        raise _BrokenMvnxError("it has no subject")
    frames = [frame for frame in subject.findall("frames/frame") if frame.get("type", "normal") == "normal"]
    listed = [segment.get("label", "") for segment in subject.findall("segments/segment")]
    try:
        rate_hz = float(subject.get("frameRate", ""))
        n_segments = int(subject.get("segmentCount") or len(listed))
    except ValueError as error:
        raise _BrokenMvnxError("its subject states no number as frameRate or segmentCount") from error
    if not 1.0 <= rate_hz <= 10_000.0 or not 1 <= n_segments <= MAX_SEGMENTS:
        raise _BrokenMvnxError(f"its subject states {rate_hz:g} frames per second of {n_segments} segments")
    segments = listed or list(_SEGMENTS)
    if len(segments) != n_segments or len(set(segments)) != n_segments:
        raise _BrokenMvnxError(f"it names {len(set(segments))} of {n_segments} segments")
    if len(frames) * n_segments * 7 > _MAX_NUMBERS:
        raise _BrokenMvnxError(f"{len(frames)} frames are too many")
    if not frames:
        raise _BrokenMvnxError("it has no frames of motion")
    positions_m = _tracks(frames, "position", 3 * n_segments).reshape(len(frames), n_segments, 3)
    points = _listed_points(subject)
    remarks = [Remark(NO_FORCE_FILE, "An MVNX file holds no ground forces, only the motion of the body.")]
    if points and all(frame.find("orientation") is not None for frame in frames):
        R = _rotations(_tracks(frames, "orientation", 4 * n_segments).reshape(len(frames), n_segments, 4))
        labels = [point.label for point in points]
        tracks = [positions_m[:, p.segment] + R[:, p.segment] @ p.local_m for p in points]
        cloud: Cloud = np.stack(tracks, axis=1)
    else:
        labels, cloud = segments, positions_m
    outputs: frozenset[str] = frozenset()
    if all(frame.find("centerOfMass") is not None for frame in frames):
        com_m = _tracks(frames, "centerOfMass", 3)
        labels, cloud, outputs = (
            [*labels, COM_LABEL],
            np.concatenate([cloud, com_m[:, None]], axis=1),
            frozenset({COM_LABEL}),
        )
        message = (
            "The centre of mass that MVN computed is in the file; --segment-table carried (segment_table) uses it."
        )
        remarks.append(Remark("own-com", message))
    return RawTrial(
        labels=tuple(labels),
        outputs=outputs,
        points_m=cloud,
        marker_rate_hz=rate_hz,
        force_rate_hz=rate_hz,
        plates=(),
        contacts=(),
        subject=Subject(),
        events=(),
        up_hint="+z",
        up_is_known=True,
        remarks=tuple(remarks),
        metres_per_unit=1.0,
        recorded_on=_recorded_on(subject),
    )


def _listed_points(subject: Element) -> list[_Point]:
    """Anatomical points of all segments; of two with one name the first, as in the C3D export."""
    points: dict[str, _Point] = {}
    for k, segment in enumerate(subject.findall("segments/segment")):
        for element in segment.findall("points/point"):
            label, place = element.get("label", ""), element.findtext("pos_b") or element.findtext("pos_s")
            if label and place is not None:
                points.setdefault(label, _Point(label, k, _numbers(place, 3, f"the point {label[:40]}")))
    if len(points) > MAX_POINTS:
        raise _BrokenMvnxError(f"it has {len(points)} points")
    return list(points.values())


def _tracks(frames: list[Element], tag: str, width: int) -> Float[np.ndarray, "frames width"]:
    """The first ``width`` numbers of the element ``tag`` of each frame; a centre of mass may be followed by others."""
    exact = None if tag == "centerOfMass" else width
    rows = [_numbers(frame.findtext(tag), exact, f"frame {k}, {tag}") for k, frame in enumerate(frames)]
    short = next((k for k, row in enumerate(rows) if len(row) < width), None)
    if short is not None:
        raise _BrokenMvnxError(f"frame {short}, {tag} has {len(rows[short])} of {width} numbers")
    return np.array([row[:width] for row in rows])


def _numbers(text: str | None, count: int | None, where: str) -> Float[np.ndarray, " n"]:
    try:
        values = np.array([float(cell) for cell in (text or "").split()], dtype=np.float64)
    except ValueError as error:
        raise _BrokenMvnxError(f"{where} holds what is not a number") from error
    if count is not None and len(values) != count:
        raise _BrokenMvnxError(f"{where} has {len(values)} of {count} numbers")
    if not (np.abs(values) < LARGEST_PLAUSIBLE).all():
        raise _BrokenMvnxError(f"{where} holds a number that is not finite, or implausibly large")
    return values


def _rotations(q: Float[np.ndarray, "frames segments 4"]) -> Float[np.ndarray, "frames segments 3 3"]:
    """Rotation matrices of quaternions wxyz. Raises for one of length zero."""
    norm = np.linalg.norm(q, axis=-1, keepdims=True)
    if not (norm > 0.1).all():
        raise _BrokenMvnxError("an orientation is no unit quaternion")
    w, x, y, z = np.moveaxis(q / norm, -1, 0)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _recorded_on(subject: Element) -> str:
    """Day of the recording as YYYY-MM-DD, empty if the file does not state it."""
    try:
        day = datetime.strptime(" ".join((subject.get("recDate") or "").split()), "%a %b %d %H:%M:%S.%f %Y").date()
    except ValueError:
        return ""
    return day.isoformat() if day > date(1970, 1, 1) else ""
