"""Collision shapes of a robot in the simulation, for the pairs that the certificate checks.

Two shapes can collide unless the robot's card or its SRDF excludes the pair. Every shape can collide with the terrain,
with two exceptions: the links of the hands with rails, which they grasp, and the shapes that the card leaves out, such
as fingers, which collide with other links only. Meshes are replaced by their convex hulls.

The sole itself is a box on the contact rectangle (``mujoco_model``), so that the hull of a foot collides with the
terrain only more than ``SOLE_GUARD_M`` above the plane of the sole: toe and heel against a riser, not the ground under
the foot. Where a foot is flat beyond the rectangle, as round its corners (``FlatPatch``), it is a part of the sole that
the box leaves out: it touches the ground when the box sinks or tilts by more than the guard.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import coal
import mujoco
import numpy as np
import pinocchio as pin
from jaxtyping import Float
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation as ScipyRotation

from stridelab.conventions import Points, Vector3
from stridelab.robots.robot import Effector, Robot

SOLE_GUARD_M: Final = 0.003
"""Larger than the penetration and tilt of a landing sole."""
THINNEST_M: Final = 5e-4
"""Thinnest part of a foot above the guard that is a shape; MuJoCo refuses the hull of coplanar points."""
PATCH_EDGE_M: Final = 1e-3
"""Distance beyond its outline up to which a contact is one of a flat patch."""
PATCH_TILT_RAD: Final = 0.3
"""Largest angle between the normals of a contact and a sole for a contact of the patch; that of a riser is at 1.6."""
# collision bits of MuJoCo: two geometries collide if a bit of one's type is in the other's affinity
GROUND, BODY, RAIL, HAND = 1, 2, 4, 8


@dataclass(frozen=True, eq=False)
class FlatPatch:
    """Flat patch of a foot in the contact frame of its sole: the points ``p`` with ``A p <= b`` (m).

    It is the hull of the foot's points up to ``SOLE_GUARD_M`` above the sole, such as those of a rounded edge.
    """

    effector: str
    A: Float[np.ndarray, "m 2"]
    b: Float[np.ndarray, "m"]

    def contains_contact(self, point_m: Vector3, normal: Vector3) -> bool:
        """Whether a contact with ``normal``, both in the contact frame of the sole, is one of the patch."""
        return bool(abs(normal[2]) > np.cos(PATCH_TILT_RAD) and np.all(self.A @ point_m[:2] <= self.b + PATCH_EDGE_M))


@dataclass(frozen=True)
class Part:
    """One shape: its geometry's ``name`` in the simulation, the ``link`` that it belongs to, and its ``patch``."""

    name: str
    link: str
    patch: FlatPatch | None = None


def add_shapes(spec: mujoco.MjSpec, robot: Robot, body_of: Mapping[str, str], friction: float) -> tuple[Part, ...]:
    """Add all shapes of ``robot`` and their pairs to ``spec``; ``body_of`` names the body that a joint moves.

    ``friction`` is that of the body against itself; against the terrain it is the surface's.
    """
    holding = {parent_joint(robot, e) for e in robot.effectors.values() if e.kind == "point"}
    soles = {parent_joint(robot, e): name for name, e in robot.effectors.items() if e.kind == "surface"}
    parts: list[Part] = []
    on_terrain = {part.name for part in robot.collision.geometryObjects}
    names = [f"shape {part.name}" for part in robot.full_collision.geometryObjects]
    for name, part in zip(names, robot.full_collision.geometryObjects, strict=True):
        joint, link = str(robot.model.names[part.parentJoint]), str(robot.model.frames[part.parentFrame].name)
        body, sole = spec.body(body_of[joint]), soles.get(joint) if part.name in on_terrain else None
        meets = (GROUND if joint in holding else GROUND | RAIL) if part.name in on_terrain else 0
        quat = ScipyRotation.from_matrix(part.placement.rotation).as_quat(scalar_first=True)
        at = {"pos": part.placement.translation.tolist(), "quat": quat.tolist()}
        _add_geom(body, name, _geom_arguments(spec, part, name) | at, 0 if sole else meets)
        parts.append(Part(name, link))
        if sole is None:
            continue
        T_joint_contact = _joint_contact(robot, robot.effectors[sole])
        local = _points_on_sole(T_joint_contact, part)
        if (raised := _raise_above_sole(local)) is not None:
            points = raised @ T_joint_contact.rotation.T + T_joint_contact.translation
            spec.add_mesh(name=f"{name} above", uservert=points.flatten().tolist())
            mesh = {"type": mujoco.mjtGeom.mjGEOM_MESH, "meshname": f"{name} above"}
            _add_geom(body, f"{name} above", mesh, meets)
            parts.append(Part(f"{name} above", link, _flat_patch(sole, local)))
    for pair in robot.full_collision.collisionPairs:
        spec.add_pair(
            geomname1=names[pair.first], geomname2=names[pair.second], condim=3, friction=[friction, friction, 0, 0, 0]
        )
    return tuple(parts)


def parent_joint(robot: Robot, effector: Effector) -> str:
    """The joint that moves an effector."""
    frame = robot.model.frames[robot.model.getFrameId(effector.frame)]
    return str(robot.model.names[frame.parentJoint])


def _add_geom(body: mujoco.MjsBody, name: str, shape: Mapping[str, Any], meets: int) -> None:
    """Add a massless shape with zero friction: MuJoCo uses the larger of both, which is that of the surface."""
    body.add_geom(name=name, mass=0.0, friction=[0.0, 0.0, 0.0], contype=0, conaffinity=meets, **shape)


def _joint_contact(robot: Robot, sole: Effector) -> pin.SE3:
    """Contact frame of a sole in the frame of the joint that moves it."""
    frame: pin.SE3 = robot.model.frames[robot.model.getFrameId(sole.frame)].placement
    return frame * pin.SE3(sole.T_frame_contact.rotation, sole.T_frame_contact.position_m)


def _points_on_sole(T_joint_contact: pin.SE3, part: pin.GeometryObject) -> Points:
    """Points of a foot's shape in the contact frame of its sole."""
    points = np.array([part.placement.act(p) for p in _hull_points(part)])
    return np.asarray((points - T_joint_contact.translation) @ T_joint_contact.rotation)


def _raise_above_sole(local: Points) -> Points | None:
    """Points in the contact frame, raised to at least ``SOLE_GUARD_M`` above the sole.

    None for a plate that is hardly thicker than that: nothing of it meets a riser but the sole's own box.
    """
    raised = local.copy()
    raised[:, 2] = np.maximum(raised[:, 2], SOLE_GUARD_M)
    return None if raised[:, 2].max() < SOLE_GUARD_M + THINNEST_M else raised


def _flat_patch(effector: str, local: Points) -> FlatPatch | None:
    """The flat patch of the shape: what the guard makes level. None if that are fewer than three points."""
    try:
        hull = ConvexHull(local[np.abs(local[:, 2]) <= SOLE_GUARD_M][:, :2])
    except (QhullError, ValueError):
        return None
    return FlatPatch(effector, hull.equations[:, :2], -hull.equations[:, 2])


def _hull_points(part: pin.GeometryObject) -> Points:
    """Points whose convex hull contains the shape: its vertices, or the corners of its bounding box."""
    geometry = part.geometry
    if isinstance(geometry, coal.BVHModelBase):
        return np.asarray(geometry.vertices(), dtype=float)
    if isinstance(geometry, coal.ConvexBase):
        return np.asarray(geometry.points(), dtype=float)
    geometry.computeLocalAABB()
    box = geometry.aabb_local
    return np.array(list(_box_corners(np.array(box.min_), np.array(box.max_))))


def _box_corners(low: np.ndarray, high: np.ndarray) -> Iterator[tuple[float, float, float]]:
    for x in (low[0], high[0]):
        for y in (low[1], high[1]):
            for z in (low[2], high[2]):
                yield float(x), float(y), float(z)


def _geom_arguments(spec: mujoco.MjSpec, part: pin.GeometryObject, name: str) -> dict[str, Any]:
    """Type and size of a collision shape; MuJoCo takes the convex hull of a mesh's points."""
    geometry = part.geometry
    if isinstance(geometry, coal.Box):
        return {"type": mujoco.mjtGeom.mjGEOM_BOX, "size": geometry.halfSide.tolist()}
    if isinstance(geometry, coal.Cylinder):
        return {"type": mujoco.mjtGeom.mjGEOM_CYLINDER, "size": [geometry.radius, geometry.halfLength, 0.0]}
    if isinstance(geometry, coal.Sphere):
        return {"type": mujoco.mjtGeom.mjGEOM_SPHERE, "size": [geometry.radius, 0.0, 0.0]}
    points = geometry.vertices() if isinstance(geometry, coal.BVHModelBase) else geometry.points()
    spec.add_mesh(name=name, uservert=np.asarray(points, dtype=float).flatten().tolist())
    return {"type": mujoco.mjtGeom.mjGEOM_MESH, "meshname": name}
