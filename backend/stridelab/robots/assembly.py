"""Assembles a ``Robot`` from its card and its description.

Also computes the hash that identifies a robot: it covers everything that affects a motion, and nothing else.

Forward, left and up axes of the trunk, estimated from the reference posture.

Descriptions differ in the axes of their root link: that of iCub points backwards. The up axis is the mean of the sole
normals, the forward axis the mean of the sole x axes, made horizontal:

    z ~ sum_i n_i ,    x ~ sum_i x_i - (z' sum_i x_i) z ,    y = z x x

The result is rounded to the nearest of the 24 rotations that map coordinate axes to coordinate axes if that is within
``MAX_LEAN_DEG``: a link that leans in the reference posture keeps its own axes.
"""

import hashlib
import re
from collections.abc import Mapping
from itertools import permutations, product
from pathlib import Path
from typing import Final, TypeVar

import numpy as np
import pinocchio as pin
from jaxtyping import Float
from scipy.spatial.transform import Rotation as ScipyRotation

from stridelab.conventions import Rotation
from stridelab.dynamics.spatial import Placement
from stridelab.errors import Fault, InvalidInput
from stridelab.robots import card as cards
from stridelab.robots import card_validation, inertias
from stridelab.robots.card import EffectorCard, RobotCard
from stridelab.robots.data_files import DataFiles
from stridelab.robots.robot import Effector, Robot
from stridelab.robots.self_collision import collision_model, matches_any, without_fixed_pairs, without_shapes
from stridelab.robots.urdf import collision_geometry, full_model, matching_visuals, parse_xml, read_srdf

V = TypeVar("V")


def assemble_robot(name: str, card: RobotCard, files: DataFiles) -> Robot:
    """Build the robot: set limits, lock joints, prune collision pairs, put the reference posture on the ground.

    Raises ``InvalidInput``: ``robot-card-invalid`` if the card names something that the description lacks,
    ``robot-description-invalid`` if a link is physically impossible or a joint has no range; ``Unavailable``
    (``robot-data-unreadable``, ``robot-meshes-missing``).
    """
    full = full_model(files.urdf)
    if files.srdf is not None:
        read_srdf(full, files.srdf)
    collision_shapes = collision_geometry(full, files.urdf, (files.package_dir,))
    visual_shapes = matching_visuals(full, files.urdf, (files.package_dir,), card.collision.visual)
    sizes = inertias.sizes_m(full, collision_shapes)
    if faults := list(inertias.inertia_faults(parse_xml(files.urdf), sizes, card.accepted_inertias)):
        raise invalid_description(name, faults)
    if faults := list(card_validation.card_mismatches(card, full, collision_shapes, visual_shapes)):
        raise cards.invalid_card(name, faults)
    set_limits(full, card)
    shapes = collision_model(full, collision_shapes, visual_shapes, card.collision, files.srdf)

    q_full = reference_posture(full, card)
    joints = list(full.names)[2:]
    locked = [joint for joint in joints if matches_any(card.locked_joints, joint)]
    model, every_shape = pin.buildReducedModel(full, shapes, [full.getJointId(joint) for joint in locked], q_full)
    names = [part.name for part in collision_shapes.geometryObjects]
    collision = without_shapes(every_shape, [name for name in names if matches_any(card.collision.left_out, name)])
    effectors = {key: effector_of(key, effector) for key, effector in card.effectors.items()}
    moving = list(model.names)[2:]
    q = np.concatenate([q_full[:7], [q_full[_configuration_index(full, joint)] for joint in moving]])
    if faults := list(card_validation.joints_without_limits(model)):
        raise invalid_description(name, faults)
    if faults := [
        *card_validation.fixed_effectors(model, card.base_frame, effectors),
        *card_validation.joints_out_of_range(model, q),
    ]:
        raise cards.invalid_card(name, faults)
    try:
        q = place_on_ground(model, align_base(q, level_axes(model, q, effectors)), effectors)
    except ValueError as error:
        raise cards.invalid_card(name, [Fault("effectors", str(error))]) from error
    R_root_trunk, R_base_trunk = trunk_axes(model, q, card.base_frame)
    return Robot(
        name=name,
        title=card.title,
        licence=card.licence,
        model=model,
        collision=collision,
        full_collision=without_fixed_pairs(every_shape),
        effectors=effectors,
        base_frame=card.base_frame,
        R_root_trunk=R_root_trunk,
        R_base_trunk=R_base_trunk,
        q_reference=q,
        group={joint: next(g for g, p in card.groups.items() if re.fullmatch(p, joint)) for joint in moving},
        urdf=files.urdf,
        package_dirs=(files.package_dir,),
        locked={joint: float(q_full[_configuration_index(full, joint)]) for joint in locked},
        sha256=robot_sha256(card, files, collision),
    )


def invalid_description(name: str, faults: list[Fault]) -> InvalidInput:
    """The error for a description with physically impossible links or joints."""
    places = "; ".join(f"{fault.where}: {fault.message}" for fault in faults)
    return InvalidInput("robot-description-invalid", f"The description of robot {name!r} is invalid. {places}", faults)


def set_limits(model: pin.Model, card: RobotCard) -> None:
    """Replace the limits and the rotor inertias of ``model`` where the card states its own."""
    for joint in list(model.names)[2:]:
        q, v = _configuration_index(model, joint), int(model.joints[model.getJointId(joint)].idx_v)
        if (position := _value_for_joint(card.limits.position_rad, joint)) is not None:
            model.lowerPositionLimit[q], model.upperPositionLimit[q] = position
        if (velocity := _value_for_joint(card.limits.velocity_rad_s, joint)) is not None:
            # pinocchio has a separate lower limit and rejects one above the upper limit
            model.lowerVelocityLimit[v], model.upperVelocityLimit[v] = -velocity, velocity
        if (torque := _value_for_joint(card.limits.torque_nm, joint)) is not None:
            model.lowerEffortLimit[v], model.upperEffortLimit[v] = -torque, torque
        if (armature := _value_for_joint(card.rotors.armature_kg_m2, joint)) is not None:
            model.armature[v] = armature


def reference_posture(model: pin.Model, card: RobotCard) -> Float[np.ndarray, "nq_full"]:
    """The card's reference posture in the coordinates of the full ``model``."""
    posture = card.reference.posture
    q = np.array(pin.neutral(model) if posture is None else model.referenceConfigurations[posture])
    for joint in list(model.names)[2:]:
        if (angle_rad := _value_for_joint(card.reference.joints_rad, joint)) is not None:
            q[_configuration_index(model, joint)] = angle_rad
    return q


def effector_of(name: str, card: EffectorCard) -> Effector:
    """The effector that a card describes."""
    return Effector(
        name=name,
        frame=card.frame,
        kind=card.kind,
        T_frame_contact=Placement.from_wxyz(card.position_m, card.orientation_wxyz),
        contact_half_size_m=card.contact_half_size_m,
        ankle=card.ankle,
    )


def trunk_axes(model: pin.Model, q: Float[np.ndarray, "nq"], base_frame: str) -> tuple[Rotation, Rotation]:
    """The world axes at the reference posture ``q``, expressed in the root link and in ``base_frame``."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return round_to_axes(data.oMi[1].rotation.T), round_to_axes(data.oMf[model.getFrameId(base_frame)].rotation.T)


def place_on_ground(
    model: pin.Model, q: Float[np.ndarray, "nq"], effectors: Mapping[str, Effector]
) -> Float[np.ndarray, "nq"]:
    """``q`` translated so that the mean of the surface contacts is at the world origin."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    contacts_m = []
    for effector in effectors.values():
        if effector.kind == "surface":
            T_world_frame = data.oMf[model.getFrameId(effector.frame)]
            contacts_m.append(T_world_frame.act(effector.T_frame_contact.position_m))
    q_moved = q.copy()
    q_moved[:3] -= np.mean(contacts_m, axis=0)
    return q_moved


def _value_for_joint(table: Mapping[str, V], joint: str) -> V | None:
    """The value of the first pattern that matches ``joint``, or ``None``."""
    return next((value for pattern, value in table.items() if re.fullmatch(pattern, joint)), None)


def _configuration_index(model: pin.Model, joint: str) -> int:
    return int(model.joints[model.getJointId(joint)].idx_q)


def robot_sha256(card: RobotCard, files: DataFiles, collision: pin.GeometryModel) -> str:
    """SHA-256 of the URDF, the SRDF if there is one, the collision meshes and the card's canonical form.

    Comments, layout, title and licence of the card do not count, nor do the paths of the files.
    """
    digest = hashlib.sha256()
    meshes = sorted({Path(part.meshPath) for part in collision.geometryObjects if part.meshPath not in _PRIMITIVES})
    for path in (files.urdf, files.srdf, *meshes):
        content = b"" if path is None else path.read_bytes()
        digest.update(hashlib.sha256(content).digest())
    digest.update(hashlib.sha256(card.canonical_json()).digest())
    return digest.hexdigest()


_PRIMITIVES = {"", "BOX", "CYLINDER", "SPHERE", "CAPSULE"}
"""``meshPath`` values that pinocchio gives to shapes without a mesh file."""


MAX_LEAN_DEG: Final = 20.0
"""Largest rotation of a link in the reference posture that is rounded to coordinate axes."""
MIN_MEAN_LENGTH: Final = 0.5
"""Minimum length of the mean normal and of the mean x axis of the soles for a defined direction."""
_SIGNED: Final = [
    np.array(signs)[:, None] * np.eye(3)[list(order)]
    for order in permutations(range(3))
    for signs in product((1, -1), repeat=3)
]
_AXES: Final = np.array([R for R in _SIGNED if np.linalg.det(R) > 0.0])


def level_axes(model: pin.Model, q: Float[np.ndarray, "nq"], effectors: Mapping[str, Effector]) -> Rotation:
    """Forward, left and up axes (columns) defined by the soles at ``q``.

    Raises ``ValueError`` for soles whose normals or x axes point away from each other.
    """
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    soles = [effector for effector in effectors.values() if effector.kind == "surface"]
    R = [data.oMf[model.getFrameId(sole.frame)].rotation @ sole.T_frame_contact.rotation for sole in soles]
    x, _, z = np.mean(R, axis=0).T
    up = z / max(np.linalg.norm(z), 1e-9)
    forward = x - (up @ x) * up
    if np.linalg.norm(z) < MIN_MEAN_LENGTH:
        raise ValueError("the z axes of the soles' contact frames point away from each other in the reference posture")
    if np.linalg.norm(forward) < MIN_MEAN_LENGTH:
        raise ValueError("the x axes of the soles' contact frames point away from each other in the reference posture")
    forward /= np.linalg.norm(forward)
    return round_to_axes(np.column_stack([forward, np.cross(up, forward), up]))


def round_to_axes(R: Rotation) -> Rotation:
    """The nearest rotation that maps coordinate axes to coordinate axes, or ``R`` if none is near."""
    cosines = (np.einsum("kij,ij->k", _AXES, R) - 1.0) / 2.0
    nearest = int(np.argmax(cosines))
    return np.asarray(_AXES[nearest] if cosines[nearest] >= np.cos(np.radians(MAX_LEAN_DEG)) else R)


def align_base(q: Float[np.ndarray, "nq"], axes: Rotation) -> Float[np.ndarray, "nq"]:
    """``q`` with its base rotated so that ``axes`` become the world axes; the base position is unchanged."""
    turned = q.copy()
    if not np.array_equal(axes, np.eye(3)):  # avoid rounding in quaternions that are already right
        turned[3:7] = (ScipyRotation.from_matrix(axes.T) * ScipyRotation.from_quat(q[3:7])).as_quat()
    return turned
