"""Whole-body inverse kinematics at position, velocity and acceleration level, all three of the same motion.

Arms and torso are prescribed; the floating base and the legs (18 coordinates) obey 18 equations, every sample anew:

    x(q) = x_d                     both soles (6 each), the CoM (3), the base upright (3)        Newton, to 1e-11
    J(q) v = x_d'                  exactly
    J(q) a + J'(q, v) v = x_d''    exactly

so v and a are the derivatives of the very q(t) that the equations define; nothing is differenced or filtered. In
running the base is not held upright: its place is taken by the angular momentum about the CoM (``running``).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.conventions import Points, Series, Vector3
from stridelab.errors import NotEstimable
from stridelab.recordings.recording import Side
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.robot import Robot

LEGS_AND_BASE: Final = 18
"""The first coordinates of the velocity: free flyer, left leg, right leg."""
_TOLERANCE: Final = 1e-11
_ITERATIONS: Final = 40
_STEP_RAD: Final = 0.3


@dataclass(frozen=True, eq=False)
class PointPath:
    """A point over time with its exact velocity and acceleration."""

    position_m: Points
    velocity_m_s: Points
    acceleration_m_s2: Points


@dataclass(frozen=True, eq=False)
class JointPath:
    """Angles ``(n, k)`` of the prescribed joints over time, rates and accelerations."""

    q: Float[np.ndarray, "n k"]
    v: Float[np.ndarray, "n k"]
    a: Float[np.ndarray, "n k"]


@dataclass(frozen=True, eq=False)
class RobotMotion:
    """Configurations ``(n, nq)`` with their velocities and accelerations ``(n, nv)`` in pinocchio's order."""

    time_s: Series
    q: Float[np.ndarray, "n nq"]
    v: Float[np.ndarray, "n nv"]
    a: Float[np.ndarray, "n nv"]


class WholeBody:
    """The 18 equations of a robot whose legs come first in its coordinates (left, right)."""

    def __init__(self, robot: Robot) -> None:
        self.model, frames = with_contact_frames(robot)
        self.data = self.model.createData()
        self._soles: dict[Side, int] = {"left": frames["left_foot"], "right": frames["right_foot"]}

    def solve(
        self, time_s: Series, feet: Mapping[Side, PointPath], com: PointPath, upper: JointPath, start: np.ndarray
    ) -> RobotMotion:
        """Motion with level soles at ``feet``, the CoM at ``com``, the base upright and the other joints as given.

        ``start`` ``(nq,)`` is where the first search begins. Raises ``NotEstimable`` ("robot-out-of-reach") at the
        first instant at which the legs do not reach.
        """
        model, n = self.model, len(time_s)
        q, v, a = np.empty((n, model.nq)), np.zeros((n, model.nv)), np.zeros((n, model.nv))
        guess = start.copy()
        for k in range(n):
            guess[7 + LEGS_AND_BASE - 6 :] = upper.q[k]
            x_d = {side: path.position_m[k] for side, path in feet.items()}
            q[k] = self._position(guess, x_d, com.position_m[k], float(time_s[k]))
            v[k, LEGS_AND_BASE:], a[k, LEGS_AND_BASE:] = upper.v[k], upper.a[k]
            J = self._jacobian(q[k])
            J_legs, J_upper = J[:, :LEGS_AND_BASE], J[:, LEGS_AND_BASE:]
            rate = self._stacked({side: path.velocity_m_s[k] for side, path in feet.items()}, com.velocity_m_s[k])
            v[k, :LEGS_AND_BASE] = np.linalg.solve(J_legs, rate - J_upper @ upper.v[k])
            second = self._stacked(
                {side: path.acceleration_m_s2[k] for side, path in feet.items()}, com.acceleration_m_s2[k]
            )
            drift = self._drift(q[k], v[k])
            a[k, :LEGS_AND_BASE] = np.linalg.solve(J_legs, second - drift - J_upper @ upper.a[k])
            if k + 1 < n:
                guess = pin.integrate(model, q[k], (time_s[k + 1] - time_s[k]) * v[k])
        return RobotMotion(time_s, q, v, a)

    def _position(self, guess: np.ndarray, feet: Mapping[Side, Vector3], com: Vector3, time_s: float) -> np.ndarray:
        model, data, q = self.model, self.data, guess
        step = np.zeros(model.nv)
        for _ in range(_ITERATIONS):
            J = self._jacobian(q)
            errors = [
                np.concatenate([feet[side] - data.oMf[sole].translation, -pin.log3(data.oMf[sole].rotation)])
                for side, sole in self._soles.items()
            ]
            e = np.concatenate([*errors, com - data.com[0], -pin.log3(data.oMi[1].rotation)])
            if np.abs(e).max() < _TOLERANCE:
                return q
            step[:LEGS_AND_BASE] = np.linalg.solve(J[:, :LEGS_AND_BASE], e)
            q = pin.integrate(model, q, min(1.0, _STEP_RAD / float(np.abs(step).max())) * step)
        raise NotEstimable("robot-out-of-reach", f"The robot's legs do not reach the footprints {time_s:.2f} s in.")

    def _jacobian(self, q: np.ndarray) -> np.ndarray:
        """Rows: left sole, right sole (world aligned), CoM, rotation of the base (world)."""
        model, data = self.model, self.data
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        J_com = pin.jacobianCenterOfMass(model, data, q)
        soles = [pin.getFrameJacobian(model, data, f, pin.LOCAL_WORLD_ALIGNED) for f in self._soles.values()]
        J_base = np.zeros((3, model.nv))
        J_base[:, 3:6] = data.oMi[1].rotation
        return np.vstack([*soles, J_com, J_base])

    def _drift(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """``J'(q, v) v``; the base's own rate is constant in its own frame, so its row is zero."""
        model, data, still = self.model, self.data, np.zeros(self.model.nv)
        pin.centerOfMass(model, data, q, v, still)
        pin.forwardKinematics(model, data, q, v, still)
        rows = [
            pin.getFrameClassicalAcceleration(model, data, f, pin.LOCAL_WORLD_ALIGNED).vector
            for f in self._soles.values()
        ]
        return np.concatenate([*rows, data.acom[0], np.zeros(3)])

    @staticmethod
    def _stacked(feet: Mapping[Side, Vector3], com: Vector3) -> np.ndarray:
        """Right-hand side of a level: translations as given, no rotation."""
        none = np.zeros(3)
        return np.concatenate([feet["left"], none, feet["right"], none, com, none])
