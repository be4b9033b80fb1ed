"""How far a shape moves when a joint does, in whatever posture.

A point of shape k is never farther from the axis of joint j, which carries it, than

    l_jk = |c_k| + r_k + sum of the links between them ,

``(c_k, r_k)`` the sphere around the shape in its joint's frame. The distance of a pair of shapes therefore changes by
at most ``sum_j l_jk |dq_j|`` over the joints that move one of them against the other: those that carry one and not the
other. Of the base, which moves shapes against the world alone, a rotation counts like that of a joint, and a
translation by itself.

Which shapes of a body come near each other or the terrain, and how near.

Now and then a sphere around every shape tells which pairs may be near, ``|c_1 - c_2| - r_1 - r_2``; these are watched.
A distance is computed only when it may have become little: since it last was, it can have shrunk by no more than what
the joints between its shapes have turned, times their levers (``levers``).
"""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import coal
import numpy as np
import pinocchio as pin
from jaxtyping import Float, Int

from stridelab.contacts.terrain import Box, Terrain
from stridelab.conventions import Points, Vector3
from stridelab.robots.contact_frames import se3
from stridelab.robots.robot import Robot
from stridelab.wholebody.control.rigid_body import RigidBody

Sphere = tuple[Vector3, float]


class Levers(NamedTuple):
    """Per pair and coordinate of the velocity: the sign with which it moves the first against the second, the lever."""

    sign: Float[np.ndarray, "n nv"]
    reach_m: Float[np.ndarray, "n nv"]

    @staticmethod
    def of(
        model: pin.Model, joints: Int[np.ndarray, "n 2"], shapes: Int[np.ndarray, "n 2"], spheres: Sequence[Sphere]
    ) -> "Levers":
        """Of pairs by the joints (0 is the world) and the numbers of their shapes."""
        carries, between_m = _chains(model)
        size_m = np.array([np.linalg.norm(centre) + radius for centre, radius in spheres])
        reach_m = between_m[joints] + size_m[shapes][..., None]
        alone = carries[joints[:, 0]] - carries[joints[:, 1]]
        lever = np.where(alone > 0.0, reach_m[:, 0], reach_m[:, 1])
        columns = np.concatenate([np.full(model.joints[i].nv, i) for i in range(1, model.njoints)]).astype(int)
        sign, reach = alone[:, columns], np.abs(alone[:, columns]) * lever[:, columns]
        straight = np.array([column < 3 or _slides(model, joint) for column, joint in enumerate(columns.tolist())])
        reach[:, straight] = np.abs(sign[:, straight])
        return Levers(sign, reach)


def _chains(model: pin.Model) -> tuple[Float[np.ndarray, "k k"], Float[np.ndarray, "k k"]]:
    """``[i, j]``: 1 where joint j carries the body of joint i, and the length of the links from j to i."""
    n = model.njoints
    carries, between_m = np.zeros((n, n)), np.zeros((n, n))
    for i in range(1, n):
        parent = model.parents[i]
        link_m = float(np.linalg.norm(model.jointPlacements[i].translation)) + _travel_m(model, i)
        carries[i] = carries[parent]
        between_m[i] = np.where(carries[parent] > 0.0, between_m[parent] + link_m, 0.0)
        carries[i, i] = 1.0
    return carries, between_m


def _slides(model: pin.Model, joint: int) -> bool:
    return str(model.joints[joint].shortname()).startswith("JointModelP")


def _travel_m(model: pin.Model, joint: int) -> float:
    """How much a sliding joint can lengthen its link."""
    if not _slides(model, joint):
        return 0.0
    at = model.joints[joint].idx_q
    return float(max(abs(model.lowerPositionLimit[at]), abs(model.upperPositionLimit[at])))


Kind = Literal["arm", "body", "terrain"]
KINDS: tuple[Kind, ...] = ("arm", "body", "terrain")
_SCALE_MIN = 0.02


class Near(NamedTuple):
    """The pairs that are near: their numbers, distances, nearest points."""

    pair: Int[np.ndarray, "m"]
    distance_m: Float[np.ndarray, "m"]
    p_1_m: Points
    p_2_m: Points


class NearPairs:
    """The pairs of one robot on one terrain. ``place`` before ``search``, and both before ``near``.

    ``kind`` of every pair, ``scale``: what its distances scale by, ``sign`` and
    ``reach_m``: which coordinates move it, and how far at most (``levers``).
    """

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
        self._kinds, self.kind = tuple(kinds), np.array(kinds)
        self._of = np.array(pairs).reshape(-1, 2)
        self._spheres = [_sphere(part) for part in parts]
        self._radius_m = np.array([radius for _, radius in self._spheres])
        joints = np.array([part.parentJoint for part in parts])[self._of]
        self.sign, self.reach_m = Levers.of(robot.model, joints, self._of, self._spheres)
        self._results = self._geometry.createData()
        self._distances = list(self._results.distanceResults)  # of the pairs, as they are now: looked up once
        self.scale = self._scales(robot, acts_m, shrunk)
        self._watched = np.zeros(0, dtype=int)
        # distance and what the joints had turned by then: a bound on the distance from below, whatever follows
        self._floor_m = np.full(len(pairs), -np.inf)
        self._turned = np.zeros(robot.model.nv)
        self._q: Float[np.ndarray, "nq"] | None = None

    def place(self, body: RigidBody) -> None:
        """Put all shapes where the body is."""
        if self._q is not None:
            self._turned += np.abs(pin.difference(body.model, self._q, body.q))
        self._q = body.q
        pin.updateGeometryPlacements(body.model, body.data, self._geometry, self._results)

    def search(self, near_m: float) -> None:
        """Watch the pairs that may be nearer than ``near_m`` times their scale."""
        centre = np.array([at.act(c) for at, (c, _) in zip(self._results.oMg, self._spheres, strict=True)])
        first, second = self._of.T
        apart = np.linalg.norm(centre[first] - centre[second], axis=1) - self._radius_m[first] - self._radius_m[second]
        spent = self.reach_m @ self._turned
        self._floor_m = np.maximum(self._floor_m, apart + spent)
        self._watched = np.flatnonzero(self._floor_m - spent < near_m * self.scale)
        self._levers = self.reach_m[self._watched]

    @property
    def watched(self) -> int:
        """How many pairs are."""
        return len(self._watched)

    def near(self, acts_m: float, most: int) -> Near:
        """The pairs that are watched, as they are now, nearer than ``acts_m`` times their scale.

        Of each kind the ``most`` nearest.
        """
        floor_m = self._floor_m[self._watched] - self._levers @ self._turned
        found: dict[int, float] = {}
        for k in self._watched[floor_m < acts_m * self.scale[self._watched]].tolist():
            d = self._distance(k)
            self._floor_m[k] = d + self.reach_m[k] @ self._turned
            if d < acts_m * self.scale[k]:
                found[k] = d
        nearest = sorted(found, key=lambda k: found[k] / self.scale[k])
        chosen = [k for kind in KINDS for k in [k for k in nearest if self._kinds[k] == kind][:most]]
        results = self._distances
        points = np.array([(results[k].getNearestPoint1(), results[k].getNearestPoint2()) for k in chosen])
        p_1_m, p_2_m = points.reshape(-1, 2, 3).swapaxes(0, 1)
        return Near(np.array(chosen, dtype=int), np.array([found[k] for k in chosen]), p_1_m, p_2_m)

    def _distance(self, k: int) -> float:
        pin.computeDistance(self._geometry, self._results, k)
        return float(self._distances[k].min_distance)

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


def _sphere(part: pin.GeometryObject) -> Sphere:
    """Around a shape, in its own frame."""
    part.geometry.computeLocalAABB()
    return np.array(part.geometry.aabb_center), float(part.geometry.aabb_radius)
