"""A body that keeps off itself and off the steps: a task for every pair of shapes that come close.

With the distance d of a pair, its nearest points ``p_1, p_2`` and ``n = (p_1 - p_2) / d``,

    n' (J_1 - J_2) a = k_p max(0, d_s - d) + k_d max(0, -d') ,      d' = n' (J_1 - J_2) v

brakes what approaches and parts what is nearer than ``d_s``. The weight rises from 0 at ``d_a`` to its full value at
``d_s``, so that nothing jumps. The drift ``n' (dJ_1 - dJ_2) v`` is left out, which the spring makes up for. Three kinds
of pairs are watched (``near_pairs``); they differ in who gives way:

    arm      an arm and anything else       the arm alone, or the task would bend the trunk instead
    body     legs, pelvis and torso         all joints: what soles and CoM leave free, above all the base's turn
    terrain  thighs and shanks, and boxes   all joints

A pair that is near in the reference posture already, an upper arm and the chest, has both distances shrunk: ``d_a`` to
half of what it has there, ``d_s`` in proportion.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stridelab.contacts.terrain import Terrain
from stridelab.conventions import Points
from stridelab.robots.robot import Robot
from stridelab.wholebody.control.collision_pairs import Near, NearPairs
from stridelab.wholebody.control.hierarchical_qp import Rows
from stridelab.wholebody.control.rigid_body import RigidBody

Angles = Float[np.ndarray, "n"]
_TINY_M = 1e-9


@dataclass(frozen=True)
class Avoid:
    """``apart_m`` is d_s, ``acts_m`` d_a; a pair is watched from ``near_m`` on, the ``most`` nearest of each kind.

    ``shrunk`` is the share of its distance in the reference posture within which a near pair acts. All pairs are looked
    at every ``every`` samples, those that were near then at every one.
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


class Avoidance:
    """The pairs of one robot on one terrain, over one run."""

    def __init__(self, robot: Robot, terrain: Terrain, avoid: Avoid) -> None:
        self._avoid, self._calls = avoid, 0
        self._pairs = NearPairs(robot, terrain, avoid.acts_m, avoid.shrunk)
        arms = np.array([0.0] * 6 + [float(robot.group[joint] == "arm") for joint in robot.joint_names])
        self._yields = np.where((self._pairs.kind == "arm")[:, None], arms, 1.0)

    def rows(self, body: RigidBody) -> tuple[Rows, Angles]:
        """One row per pair that acts, and their weights."""
        by, pairs = self._avoid, self._pairs
        pairs.place(body)
        if self._calls % by.every == 0:
            pairs.search(by.near_m)
        self._calls += 1
        near = pairs.near(by.acts_m, by.most)
        d, scale = near.distance_m, pairs.scale[near.pair]
        n = _directions(near)
        # n' J_p of a point that moves with the joints: n at p as a wrench, on the columns that carry p
        (x, y, z), (n_x, n_y, n_z) = near.p_1_m.T, n.T
        wrench = np.column_stack([n, y * n_z - z * n_y, z * n_x - x * n_z, x * n_y - y * n_x])
        J = wrench @ body.J * pairs.sign[near.pair]
        apart_m, acts_m = scale * by.apart_m, scale * by.acts_m
        nearness = np.minimum(1.0, (acts_m - d) / (acts_m - apart_m))
        b = by.kp * np.maximum(0.0, apart_m - d) + by.kd * np.maximum(0.0, -(J @ body.v))
        return Rows(J * self._yields[near.pair], b), by.weight * nearness**2


def _directions(near: Near) -> Points:
    """From the second shape to the first, also where they penetrate."""
    apart = near.p_1_m - near.p_2_m
    length = np.sqrt((apart * apart).sum(axis=1, keepdims=True))
    signed = np.sign(near.distance_m)[:, None] * apart / np.maximum(length, _TINY_M)
    return np.asarray(np.where(length > _TINY_M, signed, np.array([0.0, 0.0, 1.0])))
