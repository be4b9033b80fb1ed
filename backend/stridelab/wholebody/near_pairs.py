"""Which shapes of a body come near each other or the terrain, and how near.

Of every pair a sphere around each shape tells at once how near they can be at most, ``|c_1 - c_2| - r_1 - r_2``; only
where that is little is their distance computed.
"""

from collections.abc import Iterable
from typing import Literal, NamedTuple

import coal
import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.contacts.terrain import Box, Terrain
from stridelab.conventions import Vector3
from stridelab.robots.contact_frames import se3
from stridelab.robots.robot import Robot
from stridelab.wholebody.rigid_body import RigidBody

Kind = Literal["arm", "body", "terrain"]
KINDS: tuple[Kind, ...] = ("arm", "body", "terrain")
_SCALE_MIN = 0.02


class Near(NamedTuple):
    """A pair that is near: its joints (0 is the world), distance, nearest points, and what its distances scale by."""

    kind: Kind
    first: int
    second: int
    distance_m: float
    p_1_m: Vector3
    p_2_m: Vector3
    scale: float


class NearPairs:
    """The pairs of one robot on one terrain. ``place`` before ``search``, and both before ``near``."""

    def __init__(self, robot: Robot, terrain: Terrain, acts_m: float, shrunk: float) -> None:
        self._geometry = pin.GeometryModel(robot.collision)
        pairs = [(pair.first, pair.second) for pair in robot.collision.collisionPairs]
        kinds = [_kind(robot, pair) for pair in robot.collision.collisionPairs]
        shapes = len(robot.collision.geometryObjects)
        shanks = [k for k in range(shapes) if _above_ankle(robot, k)]
        for box in terrain.boxes:
            number = self._geometry.addGeometryObject(_placed(box))
            kinds += ["terrain"] * len(shanks)
            pairs += [(k, number) for k in shanks]
        self._geometry.removeAllCollisionPairs()
        for first, second in pairs:
            self._geometry.addCollisionPair(pin.CollisionPair(first, second))
        parts = self._geometry.geometryObjects
        self._kinds = tuple(kinds)
        self._of = np.array(pairs).reshape(-1, 2)
        self._joints = [(parts[first].parentJoint, parts[second].parentJoint) for first, second in pairs]
        self._spheres = [_sphere(part) for part in parts]
        self._radius_m = np.array([radius for _, radius in self._spheres])
        self._results = self._geometry.createData()
        self._near: list[int] = []
        self._scale = self._scales(robot, acts_m, shrunk)

    def place(self, body: RigidBody) -> None:
        """Put all shapes where the body is."""
        pin.updateGeometryPlacements(body.model, body.data, self._geometry, self._results)

    def search(self, near_m: float, most: int) -> None:
        """Find the pairs nearer than ``near_m`` times their scale, the ``most`` nearest of each kind."""
        centre = np.array([at.act(c) for at, (c, _) in zip(self._results.oMg, self._spheres, strict=True)])
        first, second = self._of.T
        apart = np.linalg.norm(centre[first] - centre[second], axis=1) - self._radius_m[first] - self._radius_m[second]
        distance: dict[int, float] = {}
        for k in np.flatnonzero(apart < near_m * self._scale).tolist():
            distance[k] = self._distance(k) / self._scale[k]
        self._near = []
        for kind in KINDS:
            of_kind = [k for k, d in distance.items() if d < near_m and self._kinds[k] == kind]
            self._near += sorted(of_kind, key=lambda k: distance[k])[:most]

    def near(self, acts_m: float) -> Iterable[Near]:
        """The pairs found, as they are now, nearer than ``acts_m`` times their scale."""
        for k in self._near:
            d = self._distance(k)
            if d < self._scale[k] * acts_m:
                result = self._results.distanceResults[k]
                p_1, p_2 = np.array(result.getNearestPoint1()), np.array(result.getNearestPoint2())
                yield Near(self._kinds[k], *self._joints[k], d, p_1, p_2, float(self._scale[k]))

    def _distance(self, k: int) -> float:
        pin.computeDistance(self._geometry, self._results, k)
        return float(self._results.distanceResults[k].min_distance)

    def _scales(self, robot: Robot, acts_m: float, shrunk: float) -> Float[np.ndarray, "n"]:
        """Of the body's own pairs by their distances in the reference posture; 1 of those with the terrain."""
        pin.updateGeometryPlacements(
            robot.model, robot.model.createData(), self._geometry, self._results, robot.q_reference
        )
        usual = [acts_m / shrunk if kind == "terrain" else self._distance(k) for k, kind in enumerate(self._kinds)]
        return np.clip(shrunk * np.array(usual) / acts_m, _SCALE_MIN, 1.0)


def _group(robot: Robot, shape: int) -> str:
    part = robot.collision.geometryObjects[shape]
    return robot.group.get(str(robot.model.names[part.parentJoint]), "")


def _kind(robot: Robot, pair: pin.CollisionPair) -> Kind:
    return "arm" if "arm" in (_group(robot, pair.first), _group(robot, pair.second)) else "body"


def _above_ankle(robot: Robot, shape: int) -> bool:
    """Whether a shape is part of a leg, but not of what the ankle moves, which is near its ground at all times."""
    joint = str(robot.model.names[robot.collision.geometryObjects[shape].parentJoint])
    ankles = {name for effector in robot.effectors.values() for name in effector.ankle or ()}
    return robot.group.get(joint) == "leg" and joint not in ankles


def _placed(box: Box) -> pin.GeometryObject:
    shape = coal.Box(*(float(edge) for edge in box.size_m))
    return pin.GeometryObject(f"terrain {box.name}", 0, 0, se3(box.placement), shape)


def _sphere(part: pin.GeometryObject) -> tuple[Vector3, float]:
    """Centre and radius of a sphere around a shape, in its own frame."""
    part.geometry.computeLocalAABB()
    return np.array(part.geometry.aabb_center), float(part.geometry.aabb_radius)
