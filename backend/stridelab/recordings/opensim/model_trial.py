"""Reads trials of an OpenSim model: the model (.osim), its joint angles (.mot or .sto), and ground forces if given.

The angles come from inverse kinematics. The model's masses and forward kinematics give the centres of mass of the body
and of its segments, so no marker set is needed; the origins of the bodies, which lie in the joints, are the points of
the trial.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Series
from stridelab.errors import Fault, UnreadableFile
from stridelab.recordings.files.opensim_zip import has_ground_forces, is_trc
from stridelab.recordings.files.raw import NO_FORCE_FILE, RawTrial
from stridelab.recordings.files.text_table import BrokenLineError, parse_storage, sampling_rate_hz
from stridelab.recordings.files.trc_mot import Contacts, read_contacts
from stridelab.recordings.files.xml_tree import BrokenXmlError, parse_xml
from stridelab.recordings.opensim.body_model import GROUND, BodyModel, is_body_model, read_body_model
from stridelab.recordings.opensim.kinematics import body_poses, complete_coordinates
from stridelab.recordings.recording import Remark, SegmentMotion, Subject

MAX_POSES: Final = 2_000_000
"""Frames times bodies: ten minutes of 30 bodies at 100 Hz."""
_HEAD: Final = 20_000
_ROUND_RAD: Final = 2.0 * np.pi
"""No joint of a body turns further; larger angles are in degrees, whatever their file states."""
_DERIVATIVES: Final = re.compile(r"^\s*(speeds?|velocit|accelerations?)", re.IGNORECASE)
_IDENTIFIERS: Final = {"force": "ground_force_v", "point": "ground_force_p", "torque": "ground_torque_"}


@dataclass(frozen=True)
class Motion:
    """Values of coordinates by name (radians or metres) at evenly spaced times."""

    time_s: Series
    rate_hz: float
    coordinates: Mapping[str, Series]
    remarks: tuple[Remark, ...]


def has_body_model(texts: Mapping[str, str]) -> bool:
    """Whether one of the unpacked texts is an OpenSim model."""
    return any(map(is_body_model, texts.values()))


def read_model_trial(texts: Mapping[str, str]) -> RawTrial | None:
    """Trial of the one model and the one file of its joint angles among texts by name; forces are optional.

    Columns of the forces that do not have OpenSim's usual names are named in a file of external loads (.xml). Returns
    None for a model without angles beside a TRC file, whose markers are then the trial. Raises ``UnreadableFile``
    (``zip-several-trials``, ``motion-missing``, ``motion-broken``, ``motion-incomplete``, ``osim-broken``,
    ``osim-too-large``, ``mot-broken``, ``times-do-not-overlap``).
    """
    models = [name for name, text in texts.items() if is_body_model(text)]
    _require_one(models, "OpenSim model")
    model_name = models[0]
    model = read_body_model(texts[model_name], model_name)
    if not model.mass_kg > 0.0:
        raise UnreadableFile("osim-broken", f"The bodies of {model_name} have no mass.", [Fault(model_name, "0 kg")])
    markers = [name for name, text in texts.items() if is_trc(text)]
    motions = [name for name, text in texts.items() if _is_motion(text, model)]
    if not motions and markers:
        return None
    if not motions:
        message = f"No file in the zip holds values of the coordinates of {model_name}: add the joint angles (.mot)."
        faults = [Fault(model_name, f"has the coordinates {', '.join([*model.coordinates][:3])} ...")]
        raise UnreadableFile("motion-missing", message, faults)
    _require_one(motions, "file of joint angles")
    motion = read_motion(texts[motions[0]], motions[0], model)
    n = len(motion.time_s)
    if n * len(model.bodies) > MAX_POSES:
        message = f"{n} frames of {len(model.bodies)} bodies are too many: at most {MAX_POSES} poses are computed."
        raise UnreadableFile("osim-too-large", message, [Fault(motions[0], f"{n} frames")])
    q = complete_coordinates(model, motion.coordinates, n)
    poses = body_poses(model, q, n)
    message = (
        f"The centre of mass is that of the body model {model_name}: {model.mass_kg:.1f} kg in {len(model.bodies)} "
        f"bodies, moved by the joint angles in {motions[0]}."
    )
    remarks = [Remark("body-model", message), *motion.remarks]
    if markers:
        message = f"The markers in {markers[0]} are not used beside the body model; upload them without it to use them."
        remarks.append(Remark("markers-not-used", message))
    forces = _read_forces(texts, motions[0], motion)
    frames = np.ones(n, dtype=bool) if forces is None else forces.frames
    if forces is None:
        message = "The zip holds no ground forces. Where a MOT or STO file has them, put it into the zip."
        remarks.append(Remark(NO_FORCE_FILE, message))
    else:
        remarks += forces.remarks
    return RawTrial(
        labels=tuple(poses),
        outputs=frozenset(),
        points_m=np.stack([pose.p[frames] for pose in poses.values()], axis=1),
        marker_rate_hz=motion.rate_hz,
        force_rate_hz=motion.rate_hz if forces is None else forces.rate_hz,
        plates=(),
        contacts=() if forces is None else forces.contacts,
        subject=Subject(mass_kg=round(model.mass_kg, 4)),
        events=(),
        up_is_known=True,
        up_hint="+-"[int(model.up.sum() < 0.0)] + "xyz"[int(np.argmax(np.abs(model.up)))],
        remarks=tuple(remarks),
        metres_per_unit=1.0,
        segments={
            name: SegmentMotion(body.mass_kg, poses[name].point_at(body.com_m)[frames])
            for name, body in model.bodies.items()
            if body.mass_kg > 0.0
        },
    )


def read_motion(text: str, name: str, model: BodyModel) -> Motion:
    """Values of the model's coordinates in a MOT or STO file, at evenly spaced times.

    Raises ``UnreadableFile`` (``motion-broken``; ``motion-incomplete`` if the place of the body is not in the file).
    """
    try:
        header, columns, table = parse_storage(text)
    except BrokenLineError as error:
        raise _motion_broken(name, str(error)) from error
    if len(table) < 2 or columns[0].lower() != "time" or not (np.diff(table[:, 0]) >= 0.0).all():
        raise _motion_broken(name, "it has no increasing time column")
    if not table[-1, 0] > table[0, 0]:
        raise _motion_broken(name, "its times do not increase")
    values = {}
    for i, column in enumerate(columns):
        coordinate = coordinate_of(column)
        if coordinate in model.coordinates:
            values[coordinate] = np.where(np.isfinite(table[:, i]), table[:, i], np.nan)
    time_s, rate_hz, resampled = _evenly(table[:, 0])
    values = {one: np.interp(time_s, table[:, 0], track) for one, track in values.items()} if resampled else values
    degrees, remarks = _in_degrees("\n".join(header), name, values, model)
    if degrees:
        values = {
            one: np.radians(track) if model.coordinates[one].rotational else track for one, track in values.items()
        }
    if resampled:
        message = f"The times in {name} are not evenly spaced; its values were interpolated at {rate_hz:g} Hz."
        remarks = (*remarks, Remark("resampled", message))
    return Motion(time_s, rate_hz, values, (*remarks, *_missing(name, values, model)))


def coordinate_of(column: str) -> str:
    """Name of the coordinate in the name of a column: ``knee_angle_r``, ``/jointset/knee_r/knee_angle_r/value``."""
    parts = column.split("/")
    return column if len(parts) == 1 else parts[-2] if parts[-1] == "value" else ""


def _require_one(names: list[str], what: str) -> None:
    if len(names) > 1:
        faults = [Fault(name, "one of several") for name in sorted(names)]
        message = f"The zip holds more than one {what}; upload one trial at a time."
        raise UnreadableFile("zip-several-trials", message, faults)


def _motion_broken(name: str, why: str) -> UnreadableFile:
    return UnreadableFile("motion-broken", f"The joint angles in {name} cannot be read: {why}.", [Fault(name, why)])


def _is_motion(text: str, model: BodyModel) -> bool:
    """Whether a text is a MOT or STO file with values of coordinates of the model; speeds have the same names."""
    lines = text[: 8 * _HEAD].splitlines()
    end = next((i for i, line in enumerate(lines) if line.strip().lower() == "endheader"), None)
    if end is None or has_ground_forces(text) or _DERIVATIVES.match(lines[0]):
        return False
    columns = next((line.split() for line in lines[end + 1 :] if line.strip()), [])
    return any(coordinate_of(column) in model.coordinates for column in columns)


def _evenly(time_s: Series) -> tuple[Float[np.ndarray, " m"], float, bool]:
    """Evenly spaced times, their rate, and whether they differ from the given ones by more than half a step."""
    rate_hz = sampling_rate_hz(time_s)
    even = time_s[0] + np.arange(len(time_s)) / rate_hz
    if np.abs(even - time_s).max() < 0.5 / rate_hz:
        return even, rate_hz, False
    n = int((time_s[-1] - time_s[0]) * rate_hz + 1e-6) + 1
    return time_s[0] + np.arange(n) / rate_hz, rate_hz, True


def _in_degrees(
    header: str, name: str, values: Mapping[str, Series], model: BodyModel
) -> tuple[bool, tuple[Remark, ...]]:
    """Whether angles are in degrees: by the header, unless a joint would then turn by more than a whole revolution."""
    stated = re.search(r"indegrees\s*=\s*(\w+)", header, re.IGNORECASE)
    if stated is not None and stated[1].lower() in {"yes", "y", "true", "1"}:
        return True, ()
    if stated is None and re.search(r"datacolumns|in degrees", header, re.IGNORECASE):
        return True, ()
    at_the_root = {one for joint in model.joints if joint.parent == GROUND for one in joint.coordinates}
    angles = [
        float(np.nanmax(np.abs(track), initial=0.0))
        for one, track in values.items()
        if model.coordinates[one].rotational and one not in at_the_root
    ]
    largest = max(angles, default=0.0)
    if largest <= _ROUND_RAD:
        return False, ()
    states = "states radians" if stated else "states no unit of angles"
    message = f"{name} {states}, but a joint would turn by {largest:.1f} rad: the angles are read as degrees."
    return True, (Remark("unit-corrected", message),)


def _missing(name: str, values: Mapping[str, Series], model: BodyModel) -> tuple[Remark, ...]:
    """Remark on free coordinates without values. Raises ``motion-incomplete`` if one of them places the body."""
    coupled = {coupling.coordinate for coupling in model.couplings}
    mass_kg = {body: model.bodies[body].mass_kg for body in model.bodies} | {GROUND: 0.0}
    lacking = []
    for joint in reversed(model.joints):
        absent = [
            one
            for one in joint.coordinates
            if one not in values and one not in coupled and not model.coordinates[one].locked
        ]
        lacking += absent
        if absent and joint.parent == GROUND and mass_kg[joint.child] > 0.5 * model.mass_kg:
            message = f"{name} has no values of {', '.join(absent[:6])}, which place the body."
            raise UnreadableFile("motion-incomplete", message, [Fault(name, one) for one in absent[:6]])
        mass_kg[joint.parent] += mass_kg[joint.child]
    if not lacking:
        return ()
    listed = ", ".join(lacking[:8]) + (" ..." if len(lacking) > 8 else "")
    message = f"{name} has no values of {len(lacking)} coordinates, which keep the model's default: {listed}."
    return (Remark("coordinates-missing", message),)


def _read_forces(texts: Mapping[str, str], motion_name: str, motion: Motion) -> Contacts | None:
    """Contacts of the one force file, whose columns external loads may name; None without one."""
    meaning: dict[str, str] = {}
    for name, text in texts.items():
        if "<ExternalLoads" in text[:_HEAD]:
            meaning |= external_load_columns(text, name)
    files = [
        name
        for name, text in texts.items()
        if name != motion_name and (has_ground_forces(text) or _has_columns(text, meaning))
    ]
    _require_one(files, "file of ground forces")
    if not files:
        return None
    return read_contacts(texts[files[0]], files[0], motion.time_s, motion.rate_hz, motion_name, meaning)


def _has_columns(text: str, meaning: Mapping[str, str]) -> bool:
    head = text[:_HEAD]
    return bool(meaning) and "endheader" in head and set(meaning) & set(head.split()) != set()


def external_load_columns(text: str, name: str) -> dict[str, str]:
    """OpenSim's usual name of each column that a file of external loads names.

    Raises ``UnreadableFile`` (``external-loads-broken``) for XML that cannot be read.
    """
    try:
        root = parse_xml(text)
    except BrokenXmlError as error:
        message = f"The external loads {name} cannot be read: {error}."
        raise UnreadableFile("external-loads-broken", message, [Fault(name, str(error))]) from error
    meaning: dict[str, str] = {}
    for k, load in enumerate(root.iter("ExternalForce"), start=1):
        for kind, usual in _IDENTIFIERS.items():
            identifier = PurePosixPath((load.findtext(f"{kind}_identifier") or "").strip()).name
            if identifier and identifier.lower() != "unassigned":
                meaning |= {f"{identifier}{axis}": f"load{k}_{usual}{axis}" for axis in "xyz"}
    return meaning
