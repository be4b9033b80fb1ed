"""Pairs of shapes of a body that are close to each other or to the terrain, and their distances.

A bounding sphere around every shape selects the pairs that may be near, ``|c_1 - c_2| - r_1 - r_2``; these are
monitored. A distance is recomputed only when it may have become small: since its last evaluation it can have decreased
by at most the joint motion times the levers of the joints between its shapes.

The levers hold in any posture. The distance of a point of shape k from the axis of a joint j that moves it is at most

    l_jk = |c_k| + r_k + sum of the links between them ,

``(c_k, r_k)`` the sphere around the shape in its joint's frame. The distance of a pair of shapes therefore changes by
at most ``sum_j l_jk |dq_j|`` over the joints that move one shape and not the other. The base moves shapes only against
the world; its rotation counts like that of a joint, its translation with lever 1.
"""

from collections.abc import Collection, Sequence
from typing import Literal, NamedTuple

import numpy as np
import pinocchio as pin
from jaxtyping import Float, Int

from stridelab.contacts.terrain import Terrain
from stridelab.conventions import Points, Vector3
from stridelab.robots.robot import Robot
from stridelab.wholebody.control.rigid_body import RigidBody
from stridelab.wholebody.effector_contact import terrain_shape

Sphere = tuple[Vector3, float]


class PairLevers(NamedTuple):
    """Per pair and velocity coordinate: the sign of the relative motion of the first shape, and the lever (m)."""

    sign: Float[np.ndarray, "n nv"]
    reach_m: Float[np.ndarray, "n nv"]

    @staticmethod
    def of_pairs(
        model: pin.Model, joints: Int[np.ndarray, "n 2"], shapes: Int[np.ndarray, "n 2"], spheres: Sequence[Sphere]
    ) -> "PairLevers":
        """Levers of pairs, given by the joints (0 is the world) and the indices of their shapes."""
        moves, between_m = _kinematic_chains(model)
        size_m = np.array([np.linalg.norm(centre) + radius for centre, radius in spheres])
        reach_m = between_m[joints] + size_m[shapes][..., None]
        relative = moves[joints[:, 0]] - moves[joints[:, 1]]
        lever = np.where(relative > 0.0, reach_m[:, 0], reach_m[:, 1])
        columns = np.concatenate([np.full(model.joints[i].nv, i) for i in range(1, model.njoints)]).astype(int)
        sign, reach = relative[:, columns], np.abs(relative[:, columns]) * lever[:, columns]
        translational = np.array(
            [column < 3 or _is_prismatic(model, joint) for column, joint in enumerate(columns.tolist())]
        )
        reach[:, translational] = np.abs(sign[:, translational])
        return PairLevers(sign, reach)


def _kinematic_chains(model: pin.Model) -> tuple[Float[np.ndarray, "k k"], Float[np.ndarray, "k k"]]:
    """``[i, j]``: 1 if joint j moves the body of joint i, and the length (m) of the links from j to i."""
    n = model.njoints
    moves, between_m = np.zeros((n, n)), np.zeros((n, n))
    for i in range(1, n):
        parent = model.parents[i]
        link_m = float(np.linalg.norm(model.jointPlacements[i].translation)) + _travel_m(model, i)
        moves[i] = moves[parent]
        between_m[i] = np.where(moves[parent] > 0.0, between_m[parent] + link_m, 0.0)
        moves[i, i] = 1.0
    return moves, between_m


def _is_prismatic(model: pin.Model, joint: int) -> bool:
    return str(model.joints[joint].shortname()).startswith("JointModelP")


def _travel_m(model: pin.Model, joint: int) -> float:
    """Largest length (m) that a prismatic joint adds to its link."""
    if not _is_prismatic(model, joint):
        return 0.0
    at = model.joints[joint].idx_q
    return float(max(abs(model.lowerPositionLimit[at]), abs(model.upperPositionLimit[at])))


Kind = Literal["arm", "body", "terrain", "hand"]
KINDS: tuple[Kind, ...] = ("arm", "body", "terrain", "hand")
_SCALE_MIN = 0.02
_ARM_SCALE = 0.5
"""Distance scale of hand or upper arm and a surface: a hand on it brings the arm near."""
_FOREARM_SCALE_1_M = 2.2
"""Distance scale of the forearm before the wrist and a surface over the arm's length, and at least 1: a long forearm
needs more time to turn about a hand on a rail (TALOS 1.5, HRP-2 1.1, G1 1)."""
_WRIST_JOINTS = 2
"""The last joints of an arm, which carry a hand to the surfaces that it touches."""


class PairDistances(NamedTuple):
    """Near pairs: their indices, distances and nearest points."""

    pair: Int[np.ndarray, "m"]
    distance_m: Float[np.ndarray, "m"]
    p_1_m: Points
    p_2_m: Points


_NO_PAIRS = PairDistances(np.zeros(0, dtype=int), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))


class CollisionPairs:
    """The pairs of one robot on one terrain.

    Call ``update_placements``, then ``update_watched``, then ``nearest_pairs``. Per pair: ``kind``, the ``scale`` of
    its distances, and its levers ``sign`` and ``reach_m``. Pairs of ``kind`` "hand" are monitored only for the joints
    that were last given to ``watch_hands``, initially for none.
    """

    def __init__(self, robot: Robot, terrain: Terrain, acts_m: float, shrunk: float) -> None:
        self._geometry = pin.GeometryModel(robot.full_collision)
        pairs = [(pair.first, pair.second) for pair in robot.full_collision.collisionPairs]
        kinds: list[Kind] = [_pair_kind(robot, pair) for pair in robot.full_collision.collisionPairs]
        shapes, self._body_pairs = len(robot.full_collision.geometryObjects), len(pairs)
        legs = [k for k in range(shapes) if _above_ankle(robot, k)]
        arms = [k for k in range(shapes) if _joint_group(robot, k) == "arm"]
        hands = wrist_joints(robot)
        for surface in terrain.surfaces:
            at, shape = terrain_shape(surface)
            number = self._geometry.addGeometryObject(pin.GeometryObject(f"terrain {surface.name}", 0, 0, at, shape))
            for k in legs:
                kinds.append("terrain")
                pairs.append((k, number))
            for k in arms:
                kinds.append("hand" if robot.full_collision.geometryObjects[k].parentJoint in hands else "arm")
                pairs.append((k, number))
        self._geometry.removeAllCollisionPairs()
        for first, second in pairs:
            self._geometry.addCollisionPair(pin.CollisionPair(first, second))
        parts = self._geometry.geometryObjects
        self._kinds, self.kind = tuple(kinds), np.array(kinds)
        self._shape_pairs = np.array(pairs).reshape(-1, 2)
        self._spheres = [bounding_sphere(part) for part in parts]
        self._radius_m = np.array([radius for _, radius in self._spheres])
        joints = self._joints = np.array([part.parentJoint for part in parts])[self._shape_pairs]
        self.sign, self.reach_m = PairLevers.of_pairs(robot.model, joints, self._shape_pairs, self._spheres)
        self._results = self._geometry.createData()
        self._distances = list(self._results.distanceResults)  # references, updated in place
        self.scale = self._distance_scales(robot, acts_m, shrunk)
        self.forget_motion()

    def forget_motion(self) -> None:
        """Return to the state before the first ``update_placements``, so that another motion can begin."""
        self._ignored = self.kind == "hand"
        self._watched = np.zeros(0, dtype=int)
        # distance plus levers times the joint motion until then: minus those of now it is a lower bound
        self._lower_bound_m = np.full(len(self.kind), -np.inf)
        self._joint_travel = np.zeros(self.reach_m.shape[1])
        self._q: Float[np.ndarray, "nq"] | None = None

    def sides_of(self, joints: Collection[int]) -> Float[np.ndarray, "n"]:
        """1 or -1 for pairs of which only the first or only the second shape belongs to one of ``joints``, else 0."""
        first, second = np.isin(self._joints, list(joints)).T
        return np.asarray(first.astype(float) - second.astype(float))

    def watch_hands(self, joints: Collection[int]) -> None:
        """Monitor the shapes of these joints, those of swinging hands, and no other shapes of hands."""
        self._ignored = (self.kind == "hand") & ~np.isin(self._joints[:, 0], list(joints))

    def update_placements(self, body: RigidBody) -> None:
        """Update the placements of all shapes to the state of ``body``."""
        if self._q is not None:
            self._joint_travel += np.abs(pin.difference(body.model, self._q, body.q))
        self._q = body.q
        pin.updateGeometryPlacements(body.model, body.data, self._geometry, self._results)

    def update_watched(self, near_m: float) -> None:
        """Select the pairs that may be nearer than ``near_m`` times their scale for monitoring."""
        centre = np.array([at.act(c) for at, (c, _) in zip(self._results.oMg, self._spheres, strict=True)])
        first, second = self._shape_pairs.T
        sphere_gap_m = (
            np.linalg.norm(centre[first] - centre[second], axis=1) - self._radius_m[first] - self._radius_m[second]
        )
        motion_m = self.reach_m @ self._joint_travel
        self._lower_bound_m = np.maximum(self._lower_bound_m, sphere_gap_m + motion_m)
        self._watched = np.flatnonzero((self._lower_bound_m - motion_m < near_m * self.scale) & ~self._ignored)
        self._levers = self.reach_m[self._watched]

    @property
    def watched_count(self) -> int:
        """Number of monitored pairs."""
        return len(self._watched)

    def nearest_pairs(self, acts_m: float, most: int) -> PairDistances:
        """Monitored pairs nearer than ``acts_m`` times their scale, at most the ``most`` nearest of each kind."""
        floor_m = self._lower_bound_m[self._watched] - self._levers @ self._joint_travel
        distances: dict[int, float] = {}
        for k in self._watched[floor_m < acts_m * self.scale[self._watched]].tolist():
            d = self._compute_distance(k)
            self._lower_bound_m[k] = d + self.reach_m[k] @ self._joint_travel
            if d < acts_m * self.scale[k]:
                distances[k] = d
        if not distances:
            return _NO_PAIRS
        nearest = sorted(distances, key=lambda k: distances[k] / self.scale[k])
        chosen = [k for kind in KINDS for k in [k for k in nearest if self._kinds[k] == kind][:most]]
        p_1_m, p_2_m = np.empty((2, len(chosen), 3))
        for i, k in enumerate(chosen):
            p_1_m[i], p_2_m[i] = self._distances[k].getNearestPoint1(), self._distances[k].getNearestPoint2()
        return PairDistances(np.array(chosen, dtype=int), np.array([distances[k] for k in chosen]), p_1_m, p_2_m)

    def _compute_distance(self, k: int) -> float:
        pin.computeDistance(self._geometry, self._results, k)
        return float(self._distances[k].min_distance)

    def _distance_scales(self, robot: Robot, acts_m: float, shrunk: float) -> Float[np.ndarray, "n"]:
        """Distance scales of the body's pairs from their distances in the reference posture, and of terrain pairs."""
        pin.updateGeometryPlacements(
            robot.model, robot.model.createData(), self._geometry, self._results, robot.q_reference
        )
        distances_m = [self._compute_distance(k) for k in range(self._body_pairs)]
        terrain = np.where(self.kind[self._body_pairs :] == "terrain", 1.0, _ARM_SCALE)
        forearms = np.isin(self._joints[self._body_pairs :, 0], list(_forearm_joints(robot)))
        terrain[forearms] = max(1.0, _FOREARM_SCALE_1_M * _arm_length_m(robot))
        return np.append(np.clip(shrunk * np.array(distances_m) / acts_m, _SCALE_MIN, 1.0), terrain)


def _joint_group(robot: Robot, shape: int) -> str:
    part = robot.full_collision.geometryObjects[shape]
    return robot.group.get(str(robot.model.names[part.parentJoint]), "")


def _pair_kind(robot: Robot, pair: pin.CollisionPair) -> Kind:
    return "arm" if "arm" in (_joint_group(robot, pair.first), _joint_group(robot, pair.second)) else "body"


def _above_ankle(robot: Robot, shape: int) -> bool:
    """Whether a shape belongs to a leg above the ankle; shapes below it are always near the ground."""
    joint = str(robot.model.names[robot.full_collision.geometryObjects[shape].parentJoint])
    ankles = {name for effector in robot.effectors.values() for name in effector.ankle or ()}
    return robot.group.get(joint) == "leg" and joint not in ankles


def wrist_joints(robot: Robot, hand: str | None = None) -> frozenset[int]:
    """The last joints of the arm of ``hand``, or of the arms of all hands: those that carry shapes near its contact."""
    return frozenset(joint for chain in _arm_chains(robot, hand) for joint in chain[-_WRIST_JOINTS:])


def _forearm_joints(robot: Robot) -> frozenset[int]:
    """The joint before the wrist of every arm, which rolls the forearm."""
    return frozenset(chain[-_WRIST_JOINTS - 1] for chain in _arm_chains(robot) if len(chain) > _WRIST_JOINTS)


def _arm_chains(robot: Robot, hand: str | None = None) -> list[tuple[int, ...]]:
    """The joints from the base to every hand, or to ``hand``."""
    hands = [one for name, one in robot.effectors.items() if one.kind == "point" and hand in (None, name)]
    ends = [robot.model.frames[robot.model.getFrameId(one.frame)].parentJoint for one in hands]
    return [tuple(robot.model.supports[end]) for end in ends]


def _arm_length_m(robot: Robot) -> float:
    """Length of the links from the first to the last joint of the longest arm; zero without hands."""
    model = robot.model
    chains = [[j for j in chain if robot.group.get(str(model.names[j])) == "arm"] for chain in _arm_chains(robot)]
    lengths_m = [sum(float(np.linalg.norm(model.jointPlacements[j].translation)) for j in one[1:]) for one in chains]
    return max(lengths_m, default=0.0)


def bounding_sphere(part: pin.GeometryObject) -> Sphere:
    """Bounding sphere of a shape in its own frame."""
    part.geometry.computeLocalAABB()
    return np.array(part.geometry.aabb_center), float(part.geometry.aabb_radius)
