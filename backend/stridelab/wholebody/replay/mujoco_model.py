"""A robot on a terrain as a MuJoCo model.

Joints and inertias come from the robot's URDF, loaded without shapes. Contact geometry is added here: a box under
every sole, a sphere at every hand, the collision shapes of the whole body (``collision_shapes``), and the terrain.
Contacts are unilateral with friction only; nothing is attached or grasped. The friction of a contact is that of the
surface.
"""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np
import pinocchio as pin
from jaxtyping import Float, Int

from stridelab.contacts.effector_geometry import HAND_RADIUS_M
from stridelab.contacts.terrain import Box, Terrain
from stridelab.conventions import GRAVITY_M_S2
from stridelab.dynamics.spatial import Placement
from stridelab.errors import Fault, InvalidInput
from stridelab.robots.robot import Effector, Robot
from stridelab.wholebody.replay.collision_shapes import (
    BODY,
    GROUND,
    HAND,
    RAIL,
    FlatPatch,
    add_shapes,
    parent_joint,
)
from stridelab.wholebody.replay.disturbances import UNDISTURBED, Disturbances

TIMESTEP_S: Final = 0.001
LOCKED_ARMATURE_KG_M2: Final = 0.1
"""Rotor inertia of the joints that the reduced model omits; without it, light links are unstable."""
SOLE_THICKNESS_M: Final = 0.02
TORSION_M, ROLLING_M = 0.01, 0.001
"""MuJoCo's torsional and rolling friction, in metres."""


@dataclass(frozen=True, eq=False)
class SimulationModel:
    """The compiled model with the indices of the robot's coordinates.

    ``moving`` are the actuated joints of the robot's reduced model in its own order, ``locked`` the others;
    ``*_qpos``, ``*_dof`` and ``*_actuator`` index MuJoCo's positions, velocities and controls. ``geom`` and ``body``
    are the contact geometry and body per effector, ``T_body_contact`` is the contact frame in that body. ``trunk`` is
    the heaviest body above the legs. By geometry index, ``link`` is the link of a collision shape, ``surface`` the
    surface of a terrain geometry, ``effector`` the effector of a sole's box or a hand's sphere, ``patch`` the flat
    patch of a foot's shape.
    """

    model: mujoco.MjModel
    moving_qpos: Int[np.ndarray, "na"]
    moving_dof: Int[np.ndarray, "na"]
    moving_actuator: Int[np.ndarray, "na"]
    locked_qpos: Int[np.ndarray, "nl"]
    locked_dof: Int[np.ndarray, "nl"]
    locked_actuator: Int[np.ndarray, "nl"]
    locked_rad: Float[np.ndarray, "nl"]
    torque_limit_nm: Float[np.ndarray, "nu"]
    geom: Mapping[str, int]
    body: Mapping[str, int]
    T_body_contact: Mapping[str, Placement]
    trunk: int
    link: Mapping[int, str]
    surface: Mapping[int, str]
    effector: Mapping[int, str]
    patch: Mapping[int, FlatPatch]

    def body_of(self, link: str | None) -> int:
        """Index of the body of a link, by default of the trunk. Raises ``InvalidInput`` (``link-not-found``)."""
        if link is None:
            return self.trunk
        names = [self.model.body(k).name for k in range(1, self.model.nbody)]
        if link not in names:
            message = f"The robot has no link {link!r}; its links are {', '.join(names)}."
            raise InvalidInput("link-not-found", message, [Fault("link", "unknown")])
        return 1 + names.index(link)


def build_simulation(
    robot: Robot, terrain: Terrain, friction: float, effectors: tuple[str, ...], disturbed: Disturbances = UNDISTURBED
) -> SimulationModel:
    """Model of ``robot`` on ``terrain``, with contacts at ``effectors``; ``friction`` for surfaces without their own.

    Of ``disturbed`` only the soles' size and the trunk's mass apply here. Raises ``InvalidInput``
    (``robot-not-simulable``) with MuJoCo's reason.
    """
    spec = mujoco.MjSpec.from_string(_without_shapes(robot))
    spec.option.timestep = TIMESTEP_S
    spec.option.gravity = [0.0, 0.0, -GRAVITY_M_S2]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10.0
    base = spec.worldbody.first_body()
    base.add_freejoint(name="root")
    body_of = {joint.name: joint.parent.name for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_HINGE}
    body_of[str(robot.model.names[1])] = base.name
    inertia = dict(zip(robot.joint_names, robot.model.armature[6:], strict=True))
    low_high = np.column_stack([robot.model.lowerPositionLimit[7:], robot.model.upperPositionLimit[7:]])
    limits = dict(zip(robot.joint_names, low_high.tolist(), strict=True))
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_HINGE:
            # the same inertia as in the whole-body problem, so that its torques are consistent
            joint.armature = inertia.get(joint.name, LOCKED_ARMATURE_KG_M2)
            joint.range = limits.get(joint.name, joint.range)
            joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE  # the model may set it; torques are clipped instead
            spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    _add_terrain(spec, terrain, friction)
    parts = add_shapes(spec, robot, body_of, friction)
    placed = {name: _body_contact(robot, robot.effectors[name]) for name in effectors}
    for name, (joint, T_body_contact) in placed.items():
        _add_effector(spec.body(body_of[joint]), robot.effectors[name], T_body_contact, disturbed.sole_half_size_m)
    try:
        model = spec.compile()
    except ValueError as error:
        message = f"MuJoCo cannot simulate the robot {robot.name}: {' '.join(str(error).split())[:300]}"
        raise InvalidInput("robot-not-simulable", message, [Fault(robot.name, "cannot be simulated")]) from error
    trunk = _trunk_body(robot, model, body_of)
    _add_mass(model, trunk, disturbed.trunk_mass_kg)

    names = robot.joint_names
    moving, locked = [model.joint(name) for name in names], [model.joint(name) for name in robot.locked]
    return SimulationModel(
        model=model,
        moving_qpos=np.array([joint.qposadr[0] for joint in moving], dtype=int),
        moving_dof=np.array([joint.dofadr[0] for joint in moving], dtype=int),
        moving_actuator=np.array([model.actuator(name).id for name in names], dtype=int),
        locked_qpos=np.array([joint.qposadr[0] for joint in locked], dtype=int),
        locked_dof=np.array([joint.dofadr[0] for joint in locked], dtype=int),
        locked_actuator=np.array([model.actuator(name).id for name in robot.locked], dtype=int),
        locked_rad=np.array(list(robot.locked.values()), dtype=float),
        torque_limit_nm=_torque_limits(robot, [model.actuator(k).name for k in range(model.nu)]),
        geom={name: model.geom(name).id for name in effectors},
        body={name: model.body(body_of[joint]).id for name, (joint, _) in placed.items()},
        T_body_contact={name: T for name, (_, T) in placed.items()},
        trunk=trunk,
        link={model.geom(part.name).id: part.link for part in parts},
        effector={model.geom(name).id: name for name in effectors},
        surface={model.geom(f"terrain {surface.name}").id: surface.name for surface in terrain.surfaces},
        patch={
            model.geom(part.name).id: part.patch
            for part in parts
            if part.patch is not None and part.patch.effector in placed
        },
    )


def _trunk_body(robot: Robot, model: mujoco.MjModel, body_of: Mapping[str, str]) -> int:
    """The heaviest of the bodies moved by the joints of the torso; without such joints the base."""
    torso = [joint for joint in robot.joint_names if robot.group[joint] == "torso"]
    bodies = [int(model.body(body_of[joint]).id) for joint in torso] or [1]
    return max(bodies, key=lambda body: float(model.body_mass[body]))


def _add_mass(model: mujoco.MjModel, body: int, mass_kg: float) -> None:
    """Add a point mass at a body's centre of mass."""
    if mass_kg:
        model.body_mass[body] += mass_kg
        mujoco.mj_setConst(model, mujoco.MjData(model))


def _without_shapes(robot: Robot) -> str:
    """The robot's URDF with links, inertias and joints only, so that no mesh files are loaded."""
    root = ET.parse(robot.urdf).getroot()  # noqa: S314 (an installed data file, not a user's)
    for link in root.findall("link"):
        for tag in ("visual", "collision"):
            for shape in link.findall(tag):
                link.remove(shape)
    for tag in ("gazebo", "transmission", "material"):
        for extra in root.findall(tag):
            root.remove(extra)
    compiler = ET.SubElement(ET.SubElement(root, "mujoco"), "compiler")
    compiler.attrib |= {"balanceinertia": "true", "fusestatic": "false", "discardvisual": "false"}
    return ET.tostring(root, encoding="unicode")


def _torque_limits(robot: Robot, actuators: list[str]) -> Float[np.ndarray, "nu"]:
    """Limits of the robot's model; for the joints that it omits those of the URDF, infinite without a limit."""
    stated = dict.fromkeys(actuators, np.inf)
    for joint in ET.parse(robot.urdf).getroot().findall("joint"):  # noqa: S314
        limit = joint.find("limit")
        if limit is not None and "effort" in limit.attrib:
            stated[joint.attrib["name"]] = float(limit.attrib["effort"])
    stated |= dict(zip(robot.joint_names, robot.model.effortLimit[6:].tolist(), strict=True))
    return np.array([stated[name] for name in actuators])


def _add_terrain(spec: mujoco.MjSpec, terrain: Terrain, friction: float) -> None:
    for surface in terrain.surfaces:
        mu = friction if surface.friction is None else surface.friction
        if isinstance(surface, Box):
            spec.worldbody.add_geom(
                name=f"terrain {surface.name}",
                type=mujoco.mjtGeom.mjGEOM_BOX,
                size=(surface.size_m / 2).tolist(),
                pos=surface.placement.position_m.tolist(),
                quat=surface.placement.wxyz.tolist(),
                friction=[mu, TORSION_M, ROLLING_M],
                contype=GROUND,
                conaffinity=BODY | HAND,
            )
        else:
            spec.worldbody.add_geom(
                name=f"terrain {surface.name}",
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                size=[surface.radius_m, 0.0, 0.0],
                fromto=[*surface.from_m, *surface.to_m],
                friction=[mu, TORSION_M, ROLLING_M],
                contype=RAIL,
                conaffinity=HAND,
            )


def _add_effector(
    body: mujoco.MjsBody, effector: Effector, T_body_contact: Placement, sole_half_size_m: tuple[float, float] | None
) -> None:
    """Add the contact geometry behind the contact frame's origin: a box for a sole, a sphere for a hand."""
    if effector.contact_half_size_m is not None:
        half = [*(sole_half_size_m or effector.contact_half_size_m), SOLE_THICKNESS_M / 2]
        kind, meets = mujoco.mjtGeom.mjGEOM_BOX, (BODY, GROUND)
    else:
        half = [HAND_RADIUS_M, 0.0, 0.0]
        kind, meets = mujoco.mjtGeom.mjGEOM_SPHERE, (HAND, RAIL | GROUND)
    behind = SOLE_THICKNESS_M / 2 if effector.kind == "surface" else HAND_RADIUS_M
    body.add_geom(
        name=effector.name,
        type=kind,
        size=half,
        pos=T_body_contact.act(np.array([[0.0, 0.0, behind]]))[0].tolist(),
        quat=T_body_contact.wxyz.tolist(),
        mass=0.0,
        friction=[0.0, 0.0, 0.0],
        contype=meets[0],
        conaffinity=meets[1],
    )


def _body_contact(robot: Robot, effector: Effector) -> tuple[str, Placement]:
    """The joint that moves an effector, and the contact frame in the frame of that joint."""
    placement: pin.SE3 = robot.model.frames[robot.model.getFrameId(effector.frame)].placement
    T_joint_frame = Placement(np.array(placement.translation), np.array(placement.rotation))
    return parent_joint(robot, effector), T_joint_frame @ effector.T_frame_contact
