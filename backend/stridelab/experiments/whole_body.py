"""Whole-body inverse kinematics at position, velocity and acceleration level, all three of the same motion.

Arms and torso are prescribed; the floating base and the legs (18 coordinates) obey 18 equations, every sample anew:

    x(q) = x_d                     both soles (6 each), the CoM (3), the base's rotation (3)     Newton, to 1e-11
    J(q) v = x_d'                  exactly
    J(q) a + J'(q, v) v = x_d''    exactly

so v and a are the derivatives of the very q(t) that the equations define; nothing is differenced or filtered. A walking
robot holds its base upright. In the air nothing can: a runner's base turns as its angular momentum demands, the last
three equations being A_G(q) v = L and A_G a + A_G' v = L' (``solve_with_momentum``).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, Literal

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
Level = Literal["velocity_m_s", "acceleration_m_s2"]


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
        n, upright = len(time_s), np.zeros(3)
        found = self._empty(time_s)
        guess = start.copy()
        for k in range(n):
            found.q[k] = self._position(guess, feet, com, upper, k, upright, float(time_s[k]))
            J = self._jacobian(found.q[k])
            found.v[k] = _resolve(J, self._stacked(feet, com, "velocity_m_s", k), upper.v[k])
            second = self._stacked(feet, com, "acceleration_m_s2", k) - self._drift(found.q[k], found.v[k])
            found.a[k] = _resolve(J, second, upper.a[k])
            if k + 1 < n:
                guess = pin.integrate(self.model, found.q[k], (time_s[k + 1] - time_s[k]) * found.v[k])
        return found

    def solve_with_momentum(
        self,
        time_s: Series,
        feet: Mapping[Side, PointPath],
        com: PointPath,
        upper: JointPath,
        start: np.ndarray,
        momentum_rate: Callable[[int, Vector3, Vector3], Vector3],
    ) -> RobotMotion:
        """As ``solve``, but the base turns freely: L' = ``momentum_rate(k, theta, L)``, theta its rotation vector.

        The paths are given twice as densely as ``time_s``, for the classical Runge-Kutta step of (theta, L); ``k``
        counts their samples. The momentum of the result is exactly what was integrated.
        """
        found, guess = self._empty(time_s), start.copy()
        dt, state = float(time_s[1] - time_s[0]), np.zeros(6)

        def rate(state: np.ndarray, k: int, at: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            theta, L = state[:3], state[3:]
            q = self._position(at, feet, com, upper, k, theta, float(time_s[k // 2]))
            J = self._jacobian(q)
            J[-3:] = pin.computeCentroidalMap(self.model, self.data, q)[3:]
            stacked = self._stacked(feet, com, "velocity_m_s", k)
            stacked[-3:] = L
            v = _resolve(J, stacked, upper.v[k])
            turning = pin.Jlog3(pin.exp3(theta)) @ v[3:6]
            return np.concatenate([turning, momentum_rate(k, theta, L)]), q, v

        for i in range(len(time_s)):
            k = 2 * i
            k1, q, v = rate(state, k, guess)
            found.q[i], found.v[i], found.a[i] = q, v, self._second(q, v, feet, com, upper, k, k1[3:])
            if i + 1 < len(time_s):
                guess = pin.integrate(self.model, q, dt * v)
                middle = pin.integrate(self.model, q, 0.5 * dt * v)
                k2, _, _ = rate(state + 0.5 * dt * k1, k + 1, middle)
                k3, _, _ = rate(state + 0.5 * dt * k2, k + 1, middle)
                k4, _, _ = rate(state + dt * k3, k + 2, guess)
                state = state + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        return found

    def _second(
        self,
        q: np.ndarray,
        v: np.ndarray,
        feet: Mapping[Side, PointPath],
        com: PointPath,
        upper: JointPath,
        k: int,
        momentum_rate: np.ndarray,
    ) -> np.ndarray:
        """Accelerations with a given rate of the angular momentum."""
        drift = self._drift(q, v)
        still = np.zeros(self.model.nv)
        drift[-3:] = pin.computeCentroidalMomentumTimeVariation(self.model, self.data, q, v, still).angular
        J = self._jacobian(q)
        J[-3:] = pin.computeCentroidalMap(self.model, self.data, q)[3:]
        second = self._stacked(feet, com, "acceleration_m_s2", k)
        second[-3:] = momentum_rate
        return _resolve(J, second - drift, upper.a[k])

    def _empty(self, time_s: Series) -> RobotMotion:
        n, nv = len(time_s), self.model.nv
        return RobotMotion(time_s, np.empty((n, self.model.nq)), np.empty((n, nv)), np.empty((n, nv)))

    def _position(
        self,
        guess: np.ndarray,
        feet: Mapping[Side, PointPath],
        com: PointPath,
        upper: JointPath,
        k: int,
        theta: Vector3,
        time_s: float,
    ) -> np.ndarray:
        """Newton's method from ``guess`` at sample ``k`` of the paths, the base turned by the vector ``theta``."""
        model, data, q, R_d = self.model, self.data, guess.copy(), pin.exp3(theta)
        q[7 + LEGS_AND_BASE - 6 :] = upper.q[k]
        step = np.zeros(model.nv)
        for _ in range(_ITERATIONS):
            J = self._jacobian(q)
            errors = [
                np.concatenate(
                    [feet[side].position_m[k] - data.oMf[sole].translation, -pin.log3(data.oMf[sole].rotation)]
                )
                for side, sole in self._soles.items()
            ]
            e = np.concatenate([*errors, com.position_m[k] - data.com[0], pin.log3(R_d @ data.oMi[1].rotation.T)])
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
        """``J'(q, v) v``; zero for the rotation of a base that is held upright."""
        model, data, still = self.model, self.data, np.zeros(self.model.nv)
        pin.centerOfMass(model, data, q, v, still)
        pin.forwardKinematics(model, data, q, v, still)
        rows = [
            pin.getFrameClassicalAcceleration(model, data, f, pin.LOCAL_WORLD_ALIGNED).vector
            for f in self._soles.values()
        ]
        return np.concatenate([*rows, data.acom[0], np.zeros(3)])

    @staticmethod
    def _stacked(feet: Mapping[Side, PointPath], com: PointPath, level: Level, k: int) -> np.ndarray:
        """Right-hand side of a level at sample ``k``: translations as given, nothing turns."""
        none = np.zeros(3)
        left, right, middle = (getattr(path, level)[k] for path in (feet["left"], feet["right"], com))
        return np.concatenate([left, none, right, none, middle, none])


def _resolve(J: np.ndarray, rate: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """All rates of the coordinates: those of the upper body as given, base and legs from the equations."""
    lower = np.linalg.solve(J[:, :LEGS_AND_BASE], rate - J[:, LEGS_AND_BASE:] @ upper)
    return np.concatenate([lower, upper])
