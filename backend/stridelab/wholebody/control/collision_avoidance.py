"""Avoidance of self-collisions and of collisions with steps: one task per pair of shapes that are close.

With the distance d of a pair, its nearest points ``p_1, p_2`` and ``n = (p_1 - p_2) / d``, the task

    n' (J_1 - J_2) a = k_p max(0, d_s - d) + k_d max(0, -d') ,      d' = n' (J_1 - J_2) v

brakes approaching pairs and separates pairs nearer than ``d_s``. The weight rises from 0 at ``d_a`` to its full value
at ``d_s``, so that accelerations are continuous, and further until the pair touches. A row with short levers (a hip
against the pelvis: 5 cm) would lose against tasks on angles, whose rows have norm 1: its weight is larger. The
drift ``n' (dJ_1 - dJ_2) v`` is neglected and compensated by the
spring. Four kinds of pairs are monitored (``collision_pairs``); they differ in the joints that the task moves:

    arm      an arm and anything else       the arm only; otherwise the task would bend the trunk
    body     legs, pelvis and torso         all joints, within the freedom left by soles and CoM, mainly the base's yaw
    terrain  legs, and boxes and rails      all joints
    hand     a swinging hand, and surfaces  none: its target moves

Foot and shank of a swinging leg follow the curve of their sole, which the tasks above do not change: what pushes them
away moves the target of the sole instead (``push_m_s2``, ``swing_detour``). The same holds for a swinging hand with
its wrist: fingers around a rail are not freed by a retreat along the normal of their contact, but by one along ``n``
(``hand_push_m_s2``).

For a pair that is near in the reference posture, such as upper arm and chest, both distances are reduced: ``d_a`` to
half of its distance there, ``d_s`` in proportion, and ``k_p`` and ``k_d`` are raised.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stridelab.contacts.terrain import Terrain
from stridelab.conventions import Points, Vector3
from stridelab.robots.robot import Robot
from stridelab.wholebody.control.collision_pairs import CollisionPairs, PairDistances, wrist_joints
from stridelab.wholebody.control.hierarchical_qp import Rows
from stridelab.wholebody.control.rigid_body import RigidBody

Angles = Float[np.ndarray, "n"]
_TINY_M = 1e-9
HAND_PUSH_M_S2 = 10.0
"""Largest push on the target of a hand."""
LOWER_LEG_JOINTS = 3
"""Knee and two ankle joints, which carry shank and foot."""


@dataclass(frozen=True)
class AvoidanceSettings:
    """Parameters: ``apart_m`` is d_s, ``acts_m`` d_a; pairs within ``near_m`` are monitored, ``most`` per kind act.

    ``shrunk`` limits d_a to this share of a pair's distance in the reference posture; k_p rises in proportion, k_d with
    its root, by at most ``firmest``, so that the same acceleration separates the pair where it touches. All pairs are
    searched every ``every`` samples; the monitored ones are evaluated at every sample.
    """

    apart_m: float = 0.03
    acts_m: float = 0.06
    near_m: float = 0.12
    kp: float = 200.0
    kd: float = 25.0
    weight: float = 4.0
    every: int = 20
    most: int = 8
    shrunk: float = 0.5
    firmest: float = 8.0
    lever_m: float = 0.3
    short_lever: float = 3.0
    urgent: float = 3.0


class CollisionAvoidance:
    """Avoidance tasks of one robot on one terrain, during one run at a time."""

    def __init__(self, robot: Robot, terrain: Terrain, avoid: AvoidanceSettings) -> None:
        self._avoid, self._calls = avoid, 0
        self._pairs = CollisionPairs(robot, terrain, avoid.acts_m, avoid.shrunk)
        arms = np.array([0.0] * 6 + [float(robot.group[joint] == "arm") for joint in robot.joint_names])
        self._moving_joints = np.where((self._pairs.kind == "arm")[:, None], arms, 1.0)
        self._lower_legs = {
            name: self._pairs.sides_of(lower_leg_joints(robot, name)) * (self._pairs.kind != "arm")
            for name, effector in robot.effectors.items()
            if effector.kind == "surface"
        }
        self._wrists = {name: wrist_joints(robot, name) for name, one in robot.effectors.items() if one.kind == "point"}
        self._hand_pairs = {
            name: self._pairs.sides_of(joints) * (self._pairs.kind == "hand") for name, joints in self._wrists.items()
        }
        self._moves_target = self._pairs.kind == "hand"
        self._watched_hands: frozenset[int] = frozenset()
        self._no_rows = Rows(np.zeros((0, robot.model.nv)), np.zeros(0)), np.zeros(0)

    def begin_run(self) -> None:
        """Forget the run before, whose shapes and pairs are reused."""
        self._pairs.forget_motion()
        self._watched_hands, self._calls = frozenset(), 0

    def watch_hands(self, swinging: Iterable[str]) -> None:
        """Monitor the hands among the ``swinging`` effectors, and no other hands, from the next ``update`` on."""
        joints = frozenset(joint for name in swinging for joint in self._wrists.get(name, ()))
        if joints != self._watched_hands:
            self._pairs.watch_hands(joints)
            self._watched_hands, self._calls = joints, 0  # searches all pairs at the next update

    def update(self, body: RigidBody) -> None:
        """Find the active pairs at the state of ``body``, their distances and the rates of these."""
        settings, pairs = self._avoid, self._pairs
        pairs.update_placements(body)
        if self._calls % settings.every == 0:
            pairs.update_watched(settings.near_m)
        self._calls += 1
        near = self._near = pairs.nearest_pairs(settings.acts_m, settings.most)
        if not near.pair.size:  # at most samples
            return
        d, scale = near.distance_m, pairs.scale[near.pair]
        n = self._normals = _contact_normals(near)
        # n' J_p of a point p: the wrench of n at p times the columns of the joints that move p
        (x, y, z), (n_x, n_y, n_z) = near.p_1_m.T, n.T
        wrench = np.empty((len(n), 6))
        wrench[:, :3] = n
        wrench[:, 3], wrench[:, 4], wrench[:, 5] = y * n_z - z * n_y, z * n_x - x * n_z, x * n_y - y * n_x
        self._J = wrench @ body.J * pairs.sign[near.pair]
        apart_m, acts_m = scale * settings.apart_m, scale * settings.acts_m
        self._inside = np.minimum(np.maximum(1.0 - d / apart_m, 0.0), 1.0)
        self._nearness = np.minimum(1.0, (acts_m - d) / (acts_m - apart_m))
        approach_m_s = np.maximum(0.0, -(self._J @ body.v))
        firm = np.minimum(1.0 / scale, settings.firmest)
        self._b = settings.kp * firm * np.maximum(0.0, apart_m - d) + settings.kd * np.sqrt(firm) * approach_m_s

    def task_rows(self) -> tuple[Rows, Angles]:
        """Task rows of the active pairs, and their weights; valid after ``update``."""
        if not self._near.pair.size:
            return self._no_rows
        tasks = ~self._moves_target[self._near.pair]
        settings, A = self._avoid, (self._J * self._moving_joints[self._near.pair])[tasks]
        lever_m = np.maximum(np.linalg.norm(A, axis=1), _TINY_M)
        levers = np.clip(settings.lever_m / lever_m, 1.0, settings.short_lever)
        weights = settings.weight * self._nearness[tasks] ** 2 * levers
        return Rows(A, self._b[tasks]), weights * (1.0 + settings.urgent * self._inside[tasks])

    def push_m_s2(self, effector: str) -> Vector3:
        """Acceleration that keeps foot and shank of a swinging sole off everything but arms, never downwards."""
        if not self._near.pair.size:
            return np.zeros(3)
        side = self._lower_legs[effector][self._near.pair]
        push = (side * self._nearness**2 * self._b) @ self._normals
        push[2] = max(0.0, push[2])
        return np.asarray(push)

    def hand_push_m_s2(self, effector: str) -> Vector3:
        """Acceleration that moves a swinging hand and its wrist away from surfaces nearer than ``d_s``.

        It has the stiffness of the tasks and no damping: a hand approaches the surface that it will hold.
        """
        if not self._near.pair.size:
            return np.zeros(3)
        settings, near, scale = self._avoid, self._near, self._pairs.scale[self._near.pair]
        firm = settings.kp * np.minimum(1.0 / scale, settings.firmest)
        gap_m = np.maximum(0.0, scale * settings.apart_m - near.distance_m)
        push = (self._hand_pairs[effector][near.pair] * firm * gap_m) @ self._normals
        size = float(np.linalg.norm(push))
        return np.asarray(push * min(1.0, HAND_PUSH_M_S2 / max(size, _TINY_M)))


def lower_leg_joints(robot: Robot, effector: str) -> tuple[int, ...]:
    """The last joints before a sole, from the knee on: those of shank and foot."""
    joint = robot.model.frames[robot.model.getFrameId(robot.effectors[effector].frame)].parentJoint
    return tuple(robot.model.supports[joint])[-LOWER_LEG_JOINTS:]


def _contact_normals(near: PairDistances) -> Points:
    """Unit vectors from the second shape to the first, also for penetrating shapes."""
    difference = near.p_1_m - near.p_2_m
    length = np.sqrt((difference * difference).sum(axis=1, keepdims=True))
    signed = np.sign(near.distance_m)[:, None] * difference / np.maximum(length, _TINY_M)
    return np.asarray(np.where(length > _TINY_M, signed, np.array([0.0, 0.0, 1.0])))
