"""From a robot's card and description to the ``Robot`` of the robot wing."""

import hashlib
import re
from collections.abc import Iterator, Mapping, Sequence

import coal
import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.dynamics.placement import Placement
from stridelab.errors import Fault
from stridelab.robots import card as cards
from stridelab.robots.card import EffectorCard, RobotCard
from stridelab.robots.data_files import DataFiles
from stridelab.robots.description import collision_geometry, full_model, read_srdf
from stridelab.robots.robot import Effector, Group, Robot


def assemble(name: str, card: RobotCard, card_bytes: bytes, files: DataFiles) -> Robot:
    """Build the robot: joints locked, collision pruned to convex hulls, reference posture put on the ground.

    Raises ``InvalidInput`` (``robot-card-invalid``) where the card names what the description lacks, ``Unavailable``
    (``robot-data-unreadable``).
    """
    full = full_model(files.urdf)
    read_srdf(full, files.srdf)
    geometry = collision_geometry(full, files.urdf, (files.package_dir,))
    faults = list(_mismatches(card, full, [str(part.name) for part in geometry.geometryObjects]))
    if faults:
        raise cards.invalid(name, faults)

    pruned = convex_hulls(geometry, card.collision.left_out)
    pruned.addAllCollisionPairs()
    pin.removeCollisionPairs(full, pruned, str(files.srdf), False)

    q_full = np.array(full.referenceConfigurations[card.reference.posture])
    for joint, angle_rad in card.reference.joints_rad.items():
        q_full[_index(full, joint)] = angle_rad
    locked = [joint for joint in full.names[2:] if _matches(card.locked_joints, joint)]
    model, collision = pin.buildReducedModel(full, pruned, [full.getJointId(joint) for joint in locked], q_full)

    effectors = {key: effector_of(key, effector) for key, effector in card.effectors.items()}
    moving = list(model.names)[2:]
    q = np.concatenate([q_full[:7], [q_full[_index(full, joint)] for joint in moving]])
    return Robot(
        name=name,
        title=card.title,
        licence=card.licence,
        model=model,
        collision=collision,
        effectors=effectors,
        base_frame=card.base_frame,
        q_reference=on_the_ground(model, q, effectors),
        group={joint: _groups(card, joint)[0] for joint in moving},
        urdf=files.urdf,
        package_dirs=(files.package_dir,),
        locked={joint: float(q_full[_index(full, joint)]) for joint in locked},
        sha256=hashlib.sha256(files.urdf.read_bytes() + files.srdf.read_bytes() + card_bytes).hexdigest(),
    )


def convex_hulls(geometry: pin.GeometryModel, left_out: tuple[str, ...]) -> pin.GeometryModel:
    """The geometries that no pattern names, every mesh replaced by its convex hull; without collision pairs."""
    hulls = pin.GeometryModel()
    for original in geometry.geometryObjects:
        if _matches(left_out, original.name):
            continue
        part = original.copy()
        if isinstance(part.geometry, coal.BVHModelBase):
            # buildConvexRepresentation would take the triangles as if they were convex already
            part.geometry.buildConvexHull(True, "Qt")
            part.geometry = part.geometry.convex
        hulls.addGeometryObject(part)
    return hulls


def effector_of(name: str, card: EffectorCard) -> Effector:
    """The effector that a card describes."""
    return Effector(
        name=name,
        frame=card.frame,
        kind=card.kind,
        T_frame_contact=Placement.of(card.position_m, card.orientation_wxyz),
        contact_half_size_m=card.contact_half_size_m,
        ankle=card.ankle,
    )


def on_the_ground(
    model: pin.Model, q: Float[np.ndarray, "nq"], effectors: Mapping[str, Effector]
) -> Float[np.ndarray, "nq"]:
    """``q`` moved so that the mean of the surface contacts is the world's origin."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    contacts_m = []
    for effector in effectors.values():
        if effector.kind == "surface":
            T_world_frame = data.oMf[model.getFrameId(effector.frame)]
            contacts_m.append(T_world_frame.act(effector.T_frame_contact.position_m))
    moved = q.copy()
    moved[:3] -= np.mean(contacts_m, axis=0)
    return moved


def _mismatches(card: RobotCard, model: pin.Model, parts: Sequence[str]) -> Iterator[Fault]:
    """Names in the card that the description does not know, and joints that it does not sort."""
    joints, frames = list(model.names)[2:], {frame.name for frame in model.frames}
    if card.base_frame not in frames:
        yield Fault("base_frame", f"there is no frame {card.base_frame!r}")
    if card.reference.posture not in {item.key() for item in model.referenceConfigurations}:
        yield Fault("reference.posture", f"there is no posture {card.reference.posture!r}")
    for joint in card.reference.joints_rad:
        if joint not in joints:
            yield Fault(f"reference.joints_rad.{joint}", "there is no such joint")
    for name, effector in card.effectors.items():
        if effector.frame not in frames:
            yield Fault(f"effectors.{name}.frame", f"there is no frame {effector.frame!r}")
        for joint in effector.ankle or ():
            if joint not in joints or _matches(card.locked_joints, joint):
                yield Fault(f"effectors.{name}.ankle", f"there is no moving joint {joint!r}")
    for i, pattern in enumerate(card.locked_joints):
        if not any(re.fullmatch(pattern, joint) for joint in joints):
            yield Fault(f"locked_joints[{i}]", f"no joint matches {pattern!r}")
    for i, pattern in enumerate(card.collision.left_out):
        if not any(re.fullmatch(pattern, part) for part in parts):
            yield Fault(f"collision.left_out[{i}]", f"no collision geometry matches {pattern!r}")
    for joint in joints:
        if _matches(card.locked_joints, joint):
            continue
        if len(_groups(card, joint)) != 1:
            yield Fault("groups", f"joint {joint!r} lies in {len(_groups(card, joint))} groups instead of one")
        if model.joints[model.getJointId(joint)].nq != 1:  # a joint that turns for ever
            yield Fault("locked_joints", f"joint {joint!r} has no limits, and must be locked")


def _groups(card: RobotCard, joint: str) -> list[Group]:
    return [group for group, pattern in card.groups.items() if re.fullmatch(pattern, joint)]


def _matches(patterns: tuple[str, ...], name: str) -> bool:
    return any(re.fullmatch(pattern, name) for pattern in patterns)


def _index(model: pin.Model, joint: str) -> int:
    return int(model.joints[model.getJointId(joint)].idx_q)
