"""From an uploaded description to a proposed card: ``rebuild_description``, ``propose_card``.

The description is rebuilt (``description``), its meshes are converted (``meshes``); the limbs, soles, the rest posture
and the collision pairs are estimated. What the description does not state and is estimated is listed in ``assumed``,
with the field of the card. The card is proposed only if the robot can be assembled with it.
"""

import json
import re
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pinocchio as pin

from stridelab.errors import Fault, InvalidInput
from stridelab.robots.assembly import assemble_robot
from stridelab.robots.card import CollisionCard, DataCard, ReferenceCard, RobotCard, RotorsCard
from stridelab.robots.data_files import DataFiles
from stridelab.robots.inertias import MOMENT_TOLERANCE, inertia_faults, read_link
from stridelab.robots.proposal.archive import unpack_robot
from stridelab.robots.proposal.collision_table import never_colliding
from stridelab.robots.proposal.description import SLIDES, invalid, is_mark, plain_description, read_xml
from stridelab.robots.proposal.effectors import carrying_link, effector_cards, foot_soles
from stridelab.robots.proposal.joint_ranges import anatomical_ranges, narrowed_ranges
from stridelab.robots.proposal.limbs import Limbs, find_limbs, not_humanoid
from stridelab.robots.proposal.limits import TORQUE_SHARE, joint_limits, remark_on_torques
from stridelab.robots.proposal.mass_in_shapes import remark_masses_outside_shapes, replace_oversized_inertias
from stridelab.robots.proposal.meshes import MeshConverter, colour_shapes, turn_y_up_shapes
from stridelab.robots.proposal.motor_inertias import move_motor_inertias
from stridelab.robots.proposal.posture import rest_posture
from stridelab.robots.proposal.soles import Sole
from stridelab.robots.robot import Robot
from stridelab.robots.self_collision import SelfCollision
from stridelab.robots.urdf import collision_geometry, full_model, parse_xml

URDF: Final = "robot.urdf"
MASS_KG: Final = (1.0, 500.0)
LEG_M: Final = (0.15, 2.0)
ROTOR_SHARE: Final = 4e-4
"""Estimated rotor inertia over mass times squared leg length: 0.01 kg m2 for G1."""
OUTWARDS: Final = (0.25, 0.45, 0.65)
"""Places of the hands to the side that are tried until the arms are clear of the body."""
ARM_CLEARANCE_M: Final = 0.02
"""Least distance of the arms from the body at rest: certificates ask for 5 mm, and walks start from this posture."""
TORSO_CLEARANCE_M: Final = 0.005, 0.01
"""Distance of what a joint of the torso moves from the rest, at rest, below which the joint is turned, and above which
it then is: certificates ask for 5 mm."""
TORSO_TURNS_RAD: Final = (0.05, -0.05, 0.1, -0.1, 0.15, -0.15, 0.2, -0.2)


@dataclass(frozen=True)
class Proposal:
    """A proposed card; ``assumed`` maps fields of the card, and parts of the description, to what was assumed."""

    card: RobotCard
    assumed: Mapping[str, str]
    robot: Robot


def rebuild_description(
    upload: Path, filename: str, name: str, robots_folder: Path, description: str = ""
) -> dict[str, str]:
    """Write the checked description and its meshes to ``robots_folder / name``; returns what was assumed.

    ``description`` is that of ``unpack_robot``.

    Raises ``UnreadableFile`` for an archive, description or mesh that cannot be read, ``InvalidInput``
    (``robot-description-invalid``).
    """
    folder = robots_folder / name
    folder.mkdir(parents=True)
    with tempfile.TemporaryDirectory(dir=robots_folder) as scratch:
        unpacked = unpack_robot(upload, filename, Path(scratch), description)
        changed: dict[str, str] = {}
        root = read_xml(unpacked.description, str(unpacked.inside))
        if root.tag == "mujoco":
            from stridelab.robots.proposal.mjcf import urdf_of_mjcf  # MuJoCo is not needed for a URDF

            root, unpacked, changed = urdf_of_mjcf(root, unpacked, Path(scratch))
        meshes = MeshConverter(unpacked, folder, name)
        plain = plain_description(root, filename, meshes.convert)
    if meshes.missing:
        raise invalid(unpacked.missing_mesh_faults(meshes.missing))
    turn_y_up_shapes(plain.root, folder, meshes.y_up, plain.assumed)
    colour_shapes(plain.root, meshes.colours, plain.assumed)
    move_motor_inertias(plain.root, plain.assumed)
    replace_oversized_inertias(plain.root, folder, plain.assumed)
    remark_masses_outside_shapes(plain.root, folder, plain.assumed)
    ET.ElementTree(plain.root).write(folder / URDF, encoding="utf-8", xml_declaration=True)
    return changed | plain.assumed | meshes.assumed


def propose_card(name: str, title: str, robots_folder: Path, assumed: Mapping[str, str]) -> Proposal:
    """Propose a card for the rebuilt description of ``robots_folder / name``; ``assumed`` is extended.

    Raises ``InvalidInput`` (``robot-description-invalid``, ``robot-not-humanoid``) with the reason.
    """
    files = DataFiles(robots_folder / name / URDF, None, robots_folder)
    return _propose_card(name, title, parse_xml(files.urdf), files, dict(assumed))


def _propose_card(name: str, title: str, root: ET.Element, files: DataFiles, assumed: dict[str, str]) -> Proposal:
    sizes_m: dict[str, float] = {}
    accepted = [re.escape(link) for link in _large_moments(root)]
    if faults := list(inertia_faults(root, sizes_m, accepted)):
        raise invalid(faults)
    model = full_model(files.urdf)
    mass_kg = float(pin.computeTotalMass(model))
    if not MASS_KG[0] <= mass_kg <= MASS_KG[1]:
        message = f"its mass is {mass_kg:.3g} kg; masses must be in kg and sum to {MASS_KG[0]:g} to {MASS_KG[1]:g}"
        raise invalid([Fault("mass", message)])
    shapes = collision_geometry(model, files.urdf, (files.package_dir,))
    q_zero = pin.neutral(model)
    limbs = _limbs_of(model, q_zero, assumed)
    without_range = {name for name in map(str, model.names) if f"joint {name}: range" in assumed}
    ranges = anatomical_ranges(model, limbs, q_zero, without_range)
    _set_ranges(model, ranges)
    soles, limbs = foot_soles(model, shapes, limbs, q_zero)
    if not limbs.is_named:
        assumed["left and right"] = "from the order of the joints; their names do not state it"
    for outwards in OUTWARDS:
        q, leg_m = rest_posture(model, limbs, soles, outwards)
        if not LEG_M[0] <= leg_m <= LEG_M[1]:
            message = f"its legs are {leg_m:.3g} m long; lengths must be in metres ({LEG_M[0]:g} to {LEG_M[1]:g})"
            raise invalid([Fault("legs", message)])
        card = _card(name, title, root, model, shapes, limbs, soles, q, leg_m, mass_kg, assumed)
        robot = assemble_robot(name, card, files)
        touching = _arm_collisions(robot, model, limbs)
        if not touching:
            break
    else:
        assumed["collision.never"] = "arms are within 2 cm of the body at rest: " + ", ".join(sorted(touching)[:5])
    if torso_rad := _torso_angles(robot, model, limbs):
        q, leg_m = rest_posture(model, limbs, soles, outwards, torso_rad)
        card = _card(name, title, root, model, shapes, limbs, soles, q, leg_m, mass_kg, assumed)
        robot = assemble_robot(name, card, files)
    if estimated := {str(model.names[j]): ends for j, ends in ranges.items() if j in limbs.moving}:
        card = _narrow_ranges(card, robot, estimated, assumed)
        robot = assemble_robot(name, card, files)
    never = never_colliding(robot)
    table = {re.escape(link): tuple(map(re.escape, others)) for link, others in never.items()}
    marks = _foot_marks(root, model, limbs)
    assumed |= {f"link {link}: collision": "not with the ground, on which the sole stands" for link in marks}
    left_out = tuple(rf"{re.escape(link)}_\d+" for link in marks)
    card = replace(card, collision=CollisionCard(never=table, left_out=left_out))
    assumed.setdefault("collision.never", "from sampled configurations")
    remark_on_torques(model, limbs, soles, q, leg_m, card.limits.torque_nm, assumed)
    return Proposal(card, assumed, assemble_robot(name, card, files))


def _limbs_of(model: pin.Model, q_zero: np.ndarray, assumed: Mapping[str, str]) -> Limbs:
    """``find_limbs``; a refusal names the joints that slide, since they are fixed in the rebuilt description."""
    try:
        return find_limbs(model, q_zero)
    except InvalidInput as error:
        sliding = [key.removeprefix("joint ").removesuffix(": type") for key, how in assumed.items() if how == SLIDES]
        if not sliding:
            raise
        message = f"{error.faults[0].message}; joints that slide are fixed, as {', '.join(map(repr, sliding[:4]))}"
        raise not_humanoid(message, error.faults[0].where) from error


def _card(
    name: str,
    title: str,
    root: ET.Element,
    model: pin.Model,
    shapes: pin.GeometryModel,
    limbs: Limbs,
    soles: Sequence[Sole],
    q: np.ndarray,
    leg_m: float,
    mass_kg: float,
    assumed: dict[str, str],
) -> RobotCard:
    groups = {joint: "leg" for leg in limbs.legs for joint in leg}
    groups |= dict.fromkeys(limbs.torso, "torso") | {joint: "arm" for arm in limbs.arms for joint in arm}
    moving = sorted(groups)
    effectors = effector_cards(model, shapes, limbs, soles, q)
    limits = joint_limits(model, groups, mass_kg, leg_m, assumed)
    rotors = _rotors(root, model, moving, mass_kg, leg_m, assumed)
    assumed["reference.joints_rad"] = "by optimisation: level soles, bent knees, CoM above the soles"
    for key, effector in effectors.items():
        half_m = effector.contact_half_size_m
        across = "; it is wider than long: check the axes of its mesh" if half_m and half_m[0] < half_m[1] else ""
        assumed[f"effectors.{key}"] = f"from the collision shapes{across}"
    locked = [joint for joint in range(2, model.njoints) if joint not in groups]
    if locked:
        assumed["locked_joints"] = ", ".join(model.names[joint] for joint in locked[:30])
    accepted = tuple(re.escape(link) for link in _large_moments(root))
    if accepted:
        assumed["accepted_inertias"] = "as the description states them, although they are not physical"
    angle = {joint: float(q[model.joints[joint].idx_q]) for joint in moving}
    by_group = {group: [re.escape(model.names[j]) for j in moving if groups[j] == group] for group in TORQUE_SHARE}
    return RobotCard(
        title=title,
        licence="As in the uploaded description.",
        base_frame=carrying_link(model, limbs.legs[0][0]),
        data=DataCard(urdf=f"{name}/{URDF}"),
        reference=ReferenceCard(joints_rad={re.escape(model.names[j]): round(a, 5) for j, a in angle.items()}),
        groups={group: "|".join(names) for group, names in by_group.items() if names},  # type: ignore[misc]
        effectors=effectors,
        locked_joints=tuple(re.escape(model.names[joint]) for joint in locked),
        accepted_inertias=accepted,
        limits=limits,
        rotors=rotors,
    )


def _set_ranges(model: pin.Model, ranges: Mapping[int, tuple[float, float]]) -> None:
    for joint, (low, high) in ranges.items():
        index = model.joints[joint].idx_q
        model.lowerPositionLimit[index], model.upperPositionLimit[index] = low, high


def _narrow_ranges(
    card: RobotCard, robot: Robot, estimated: Mapping[str, tuple[float, float]], assumed: dict[str, str]
) -> RobotCard:
    """The card with the ranges of the ``estimated`` joints, which are listed in ``assumed``."""
    position = dict(card.limits.position_rad)
    for joint, (low, high) in narrowed_ranges(robot, estimated).items():
        position[re.escape(joint)] = (low, high)
        assumed.pop(f"joint {joint}: range", None)
        assumed[f"limits.position_rad.{joint}"] = f"{low:.2f} to {high:.2f} rad: as of a person, until links meet"
    return replace(card, limits=replace(card.limits, position_rad=position))


def _foot_marks(root: ET.Element, model: pin.Model, limbs: Limbs) -> list[str]:
    """Links of the feet that only mark places, such as the corners of a sole, by solids that collide."""
    feet = {leg[-1] for leg in limbs.legs}
    links = [link for link in root.findall("link") if link.find("collision") is not None and is_mark(link)]
    names = [link.attrib["name"] for link in links]
    return [name for name in names if model.frames[model.getFrameId(name)].parentJoint in feet]


def _rotors(
    root: ET.Element,
    model: pin.Model,
    moving: Sequence[int],
    mass_kg: float,
    leg_m: float,
    assumed: dict[str, str],
) -> RotorsCard:
    """Rotor inertias that the description states, else an estimate for all joints."""
    stated = {
        joint.attrib["name"]: float(dynamics.attrib["armature"])
        for joint in root.findall("joint")
        if (dynamics := joint.find("dynamics")) is not None
    }
    estimate = float(f"{ROTOR_SHARE * mass_kg * leg_m**2:.2g}")
    names = [str(model.names[joint]) for joint in moving]
    if absent := [name for name in names if name not in stated]:
        which = "every joint" if len(absent) == len(names) else ", ".join(absent[:30])
        assumed["rotors.armature_kg_m2"] = f"{estimate:g} kg m2 for {which}, from mass and length of the legs"
    return RotorsCard({re.escape(name): stated.get(name, estimate) for name in names})


def _large_moments(root: ET.Element) -> list[str]:
    """Links whose largest principal moment exceeds the sum of the others by up to a factor of 5."""
    names = []
    for element in root.findall("link"):
        try:
            I = read_link(element).moments_kg_m2
        except ValueError:
            continue  # reported by inertia_faults
        if I[0] > 0.0 and (I[0] + I[1]) * (1.0 + MOMENT_TOLERANCE) < I[2] <= 5.0 * (I[0] + I[1]):
            names.append(element.attrib["name"])
    return names


def _arm_collisions(robot: Robot, full: pin.Model, limbs: Limbs) -> set[str]:
    """Pairs of an arm (from its third joint on) and the rest that are within ``ARM_CLEARANCE_M`` at rest."""
    model = robot.model
    side = {joint: index for index, arm in enumerate(limbs.arms) for joint in map(str, (full.names[j] for j in arm))}
    outer = {str(full.names[joint]) for arm in limbs.arms for joint in arm[2:]}
    touching = set()
    for a, b in SelfCollision(robot, ARM_CLEARANCE_M).colliding_links(robot.q_reference):
        one, other = (str(model.names[model.frames[model.getFrameId(link)].parentJoint]) for link in (a, b))
        if side.get(one, one) != side.get(other, other) and {one, other} & outer:
            touching.add(f"{a} and {b}")
    return touching


def _torso_angles(robot: Robot, full: pin.Model, limbs: Limbs) -> dict[int, float]:
    """The joint of the torso that must be turned at rest so that the torso is clear of pelvis and legs, and its angle.

    Empty if it is clear without, or if no turn of one joint clears it. Links that overlap at rest are not considered.
    """
    for joint in limbs.torso:
        name = str(full.names[joint])
        index = robot.model.joints[robot.model.getJointId(name)].idx_q
        pairs = _torso_pairs(robot, name)
        if not pairs or min(_distances_m(robot, pairs, robot.q_reference)) >= TORSO_CLEARANCE_M[0]:
            continue
        for turn in TORSO_TURNS_RAD:
            q = robot.q_reference.copy()
            q[index] += turn
            in_range = robot.model.lowerPositionLimit[index] < q[index] < robot.model.upperPositionLimit[index]
            if in_range and min(_distances_m(robot, pairs, q)) >= TORSO_CLEARANCE_M[1]:
                return {joint: float(q[index])}
    return {}


def _torso_pairs(robot: Robot, joint: str) -> list[int]:
    """Pairs of shapes of the first body that a joint of the torso moves and of the legs, which are apart at rest."""
    model, geometry = robot.model, robot.collision
    moved = model.getJointId(joint)
    legs = {model.getJointId(name) for name in robot.joint_names if robot.group[name] == "leg"}
    pairs = []
    for k, pair in enumerate(geometry.collisionPairs):
        one, other = (geometry.geometryObjects[index].parentJoint for index in (pair.first, pair.second))
        if (one == moved and other in legs) or (other == moved and one in legs):
            pairs.append(k)
    at_rest = _distances_m(robot, pairs, robot.q_reference)
    return [k for k, distance_m in zip(pairs, at_rest, strict=True) if distance_m > 0.0]


def _distances_m(robot: Robot, pairs: Sequence[int], q: np.ndarray) -> list[float]:
    """Distances of pairs of shapes."""
    data, results = robot.model.createData(), robot.collision.createData()
    pin.updateGeometryPlacements(robot.model, data, robot.collision, results, q)
    return [float(pin.computeDistance(robot.collision, results, k).min_distance) for k in pairs]


def card_fields(card: RobotCard) -> dict[str, Any]:
    """The card as JSON, without the paths of the files."""
    fields: dict[str, Any] = json.loads(card.canonical_json())
    return {"title": card.title, "licence": card.licence} | {k: v for k, v in fields.items() if k != "data"}


def card_toml(card: RobotCard) -> str:
    """The card as the file ``models/robots/<name>.toml``."""
    fields = card_fields(card) | {"data": {"urdf": card.data.urdf}}
    lines: list[str] = []

    def write_table(path: tuple[str, ...], table: Mapping[str, Any]) -> None:
        if path:
            lines.append(f"\n[{'.'.join(json.dumps(part, ensure_ascii=False) for part in path)}]")
        for key, value in table.items():
            if not isinstance(value, dict):
                lines.append(f"{json.dumps(key, ensure_ascii=False)} = {json.dumps(value, ensure_ascii=False)}")
        for key, value in table.items():
            if isinstance(value, dict):
                write_table((*path, key), value)

    write_table((), fields)
    return "\n".join(lines) + "\n"
