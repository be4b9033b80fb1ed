"""Arms that keep off the rest of the body: a task for every pair of shapes that come close.

With the distance d of a pair, its nearest points ``p_1, p_2`` and ``n = (p_1 - p_2) / d``,

    n' (J_1 - J_2) a = k_p max(0, d_s - d) + k_d max(0, -d') ,      d' = n' (J_1 - J_2) v

brakes what approaches and parts what is nearer than ``d_s``. The weight rises from 0 at ``d_a`` to its full value at
``d_s``, so that nothing jumps. A pair that is near in the reference posture already, an upper arm and the chest, has
both distances shrunk: ``d_a`` to half of what it has there, ``d_s`` in proportion. The drift ``n' (dJ_1 - dJ_2) v`` is
left out, which the spring makes up for; so are the columns of all joints but those of the arms, or the task would bend
the trunk instead. All pairs with an arm are looked at every ``every`` samples, those that were near then at every one.
"""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.conventions import Vector3
from stridelab.robots.robot import Robot
from stridelab.wholebody.hierarchy import Rows
from stridelab.wholebody.rigid_body import RigidBody

Angles = Float[np.ndarray, "n"]


@dataclass(frozen=True)
class Avoid:
    """``apart_m`` is d_s, ``acts_m`` d_a; a pair is watched from ``near_m`` on, the ``most`` nearest of them.

    ``shrunk`` is the share of its distance in the reference posture within which a near pair acts.
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
    """The pairs of one robot that an arm is part of, over one run."""

    def __init__(self, robot: Robot, avoid: Avoid) -> None:
        self._avoid, self._calls = avoid, 0
        self._geometry = pin.GeometryModel(robot.collision)
        group = [robot.group[joint] for joint in robot.joint_names]
        self._arms = np.array([0.0] * 6 + [float(where == "arm") for where in group])
        pairs = [pin.CollisionPair(pair.first, pair.second) for pair in robot.collision.collisionPairs]
        joints = [part.parentJoint for part in robot.collision.geometryObjects]
        arm = [robot.group.get(str(robot.model.names[joint])) == "arm" for joint in joints]
        self._geometry.removeAllCollisionPairs()
        for pair in pairs:
            if arm[pair.first] or arm[pair.second]:
                self._geometry.addCollisionPair(pair)
        self._joints = [(joints[p.first], joints[p.second]) for p in self._geometry.collisionPairs]
        self._results = self._geometry.createData()
        self._near: list[int] = []
        pin.computeDistances(robot.model, robot.model.createData(), self._geometry, self._results, robot.q_reference)
        usual = np.array([result.min_distance for result in self._results.distanceResults])
        self._scale = np.clip(avoid.shrunk * usual / avoid.acts_m, 0.02, 1.0)

    def rows(self, body: RigidBody) -> tuple[Rows, Angles]:
        """One row per pair that acts, and their weights."""
        self._look(body)
        found: list[tuple[Float[np.ndarray, "nv"], float, float]] = []
        for k in self._near:
            result = self._results.distanceResults[k]
            d = float(result.min_distance)
            if d < self._scale[k] * self._avoid.acts_m:
                p_1, p_2 = np.array(result.getNearestPoint1()), np.array(result.getNearestPoint2())
                found.append(self._row(body, k, d, p_1, p_2))
        J = np.array([row for row, _, _ in found]).reshape(len(found), body.model.nv)
        return Rows(J, np.array([b for _, b, _ in found])), np.array([w for _, _, w in found])

    def _row(
        self, body: RigidBody, k: int, d: float, p_1: Vector3, p_2: Vector3
    ) -> tuple[Float[np.ndarray, "nv"], float, float]:
        by = self._avoid
        apart = p_1 - p_2
        length = float(np.linalg.norm(apart))
        n = np.sign(d) * apart / length if length > 1e-9 else np.array([0.0, 0.0, 1.0])
        first, second = self._joints[k]
        J = n @ (body.point_jacobian(first, p_1) - body.point_jacobian(second, p_2))
        rate = float(J @ body.v)
        apart_m, acts_m = self._scale[k] * by.apart_m, self._scale[k] * by.acts_m
        nearness = min(1.0, (acts_m - d) / (acts_m - apart_m))
        return J * self._arms, by.kp * max(0.0, apart_m - d) + by.kd * max(0.0, -rate), by.weight * nearness**2

    def _look(self, body: RigidBody) -> None:
        """Distances of all pairs, or of the near ones."""
        pin.updateGeometryPlacements(body.model, body.data, self._geometry, self._results)
        if self._calls % self._avoid.every == 0:
            pin.computeDistances(self._geometry, self._results)
            d = np.array([result.min_distance for result in self._results.distanceResults]) / self._scale
            self._near = [int(k) for k in np.argsort(d, kind="stable")[: self._avoid.most] if d[k] < self._avoid.near_m]
        else:
            for k in self._near:
                pin.computeDistance(self._geometry, self._results, k)
        self._calls += 1
