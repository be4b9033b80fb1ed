"""Whole-body inverse kinematics at position, velocity and acceleration level, consistent with each other.

Arms and torso are prescribed; the floating base and the legs (18 coordinates) satisfy 18 equations at every sample:

    x(q) = x_d                     both soles (6 each), the CoM (3), the base's rotation (3)     Newton, to 1e-11
    J(q) v = x_d'                  exactly
    J(q) a + J'(q, v) v = x_d''    exactly

so v and a are the exact derivatives of q(t), without finite differences or filters. A walking robot keeps its base
upright. In flight the angular momentum determines the rotation of the base: the last three equations are then
A_G(q) v = L and A_G a + A_G' v = L' (``solve_with_momentum``).
"""

from collections.abc import Callable, Mapping
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
from stridelab.simulation.human.body_proportions import SIDES
from stridelab.simulation.robot.anatomy import RobotAnatomy

LEGS_AND_BASE: Final = 18
"""Coordinates of the velocity that are solved for: free flyer, left leg, right leg."""
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
    """Angles ``(n, k)`` of the prescribed joints (``WholeBody.upper``) over time, rates and accelerations."""

    q: Float[np.ndarray, "n k"]
    v: Float[np.ndarray, "n k"]
    a: Float[np.ndarray, "n k"]


@dataclass(frozen=True, eq=False)
class Task:
    """Task at every sample: level soles, CoM and upper body as given.

    ``places_m`` holds left sole, right sole and CoM; ``rate`` and ``second`` the right-hand sides of the 18 equations.
    """

    places_m: Float[np.ndarray, "n 3 3"]
    rate: Float[np.ndarray, "n 18"]
    second: Float[np.ndarray, "n 18"]
    upper: JointPath

    @staticmethod
    def from_paths(feet: Mapping[Side, PointPath], com: PointPath, upper: JointPath) -> "Task":
        """Create from the paths of the soles' middles, of the CoM and of the joints of torso and arms."""
        paths = (feet["left"], feet["right"], com)
        none = np.zeros_like(com.position_m)
        rate, second = (
            np.column_stack([block for path in paths for block in (getattr(path, level), none)])
            for level in ("velocity_m_s", "acceleration_m_s2")
        )
        return Task(np.stack([path.position_m for path in paths], axis=1), rate, second, upper)


@dataclass(frozen=True, eq=False)
class RobotMotion:
    """Configurations ``(n, nq)`` with their velocities and accelerations ``(n, nv)`` in pinocchio's order."""

    time_s: Series
    q: Float[np.ndarray, "n nq"]
    v: Float[np.ndarray, "n nv"]
    a: Float[np.ndarray, "n nv"]


class WholeBody:
    """The 18 equations of a robot with two legs of six joints; ``upper`` are its other joints, by index of ``v``.

    Raises ``InvalidInput`` (``robot-not-recordable``) for another robot.
    """

    def __init__(self, robot: Robot) -> None:
        self.model, frames = with_contact_frames(robot)
        legs = RobotAnatomy.of_robot(robot).leg
        lower = [*range(6), *(self.model.joints[j].idx_v for side in SIDES for j in legs[side])]
        self.upper = np.setdiff1d(np.arange(self.model.nv), lower)
        self._lower = slice(0, LEGS_AND_BASE) if lower == list(range(LEGS_AND_BASE)) else np.array(lower)
        self._others = slice(LEGS_AND_BASE, None) if isinstance(self._lower, slice) else self.upper
        self._R_upright = robot.R_root_trunk.T
        self.data = self.model.createData()
        self._soles = (frames["left_foot"], frames["right_foot"])

    def solve(self, time_s: Series, task: Task, start: Float[np.ndarray, "nq"]) -> RobotMotion:
        """Solve for the motion of ``task`` with an upright base; ``start`` is the initial guess of the first sample.

        Raises ``NotEstimable`` (``robot-out-of-reach``) at the first instant at which the legs do not reach.
        """
        motion, guess, upright = self._empty_motion(time_s), start, np.zeros(3)
        for k in range(len(time_s)):
            q, J = self._solve_position(guess, task, k, upright, float(time_s[k]))
            v = self._solve_rates(J, task.rate[k], task.upper.v[k])
            a = self._solve_rates(J, task.second[k] - self._drift(q, v), task.upper.a[k])
            motion.q[k], motion.v[k], motion.a[k] = q, v, a
            if k + 1 < len(time_s):
                dt = time_s[k + 1] - time_s[k]
                guess = pin.integrate(self.model, q, dt * v + 0.5 * dt * dt * a)
        return motion

    def solve_with_momentum(
        self,
        time_s: Series,
        task: Task,
        start: Float[np.ndarray, "nq"],
        momentum_rate: Callable[[int, Vector3, Vector3], Vector3],
    ) -> RobotMotion:
        """As ``solve`` with a free base: L' = ``momentum_rate(k, theta, L)``, theta the rotation vector of the base.

        The task has twice the rate of ``time_s``, for the classical Runge-Kutta step of (theta, L); ``k`` is the index
        of its samples. The momentum of the result equals the integrated one exactly.
        """
        motion, guess = self._empty_motion(time_s), start
        dt, state = float(time_s[1] - time_s[0]), np.zeros(6)

        def state_derivative(state: np.ndarray, k: int, guess_q: np.ndarray) -> tuple[np.ndarray, ...]:
            theta, L = state[:3], state[3:]
            q, J = self._solve_position(guess_q, task, k, theta, float(time_s[k // 2]))
            J[-3:] = pin.computeCentroidalMap(self.model, self.data, q)[3:]
            task_rate = task.rate[k].copy()
            task_rate[-3:] = L
            v = self._solve_rates(J, task_rate, task.upper.v[k])
            turning = pin.Jlog3(pin.exp3(theta)) @ v[3:6]
            return np.concatenate([turning, momentum_rate(k, theta, L)]), q, v, J

        zero_acceleration = np.zeros(self.model.nv)
        for i in range(len(time_s)):
            k = 2 * i
            k1, q, v, J = state_derivative(state, k, guess)
            drift = self._drift(q, v)
            drift[-3:] = pin.computeCentroidalMomentumTimeVariation(
                self.model, self.data, q, v, zero_acceleration
            ).angular
            second = task.second[k].copy()
            second[-3:] = k1[3:]
            a = self._solve_rates(J, second - drift, task.upper.a[k])
            motion.q[i], motion.v[i], motion.a[i] = q, v, a
            if i + 1 < len(time_s):
                guess = pin.integrate(self.model, q, dt * v + 0.5 * dt * dt * a)
                middle = pin.integrate(self.model, q, 0.5 * dt * v + 0.125 * dt * dt * a)
                k2, *_ = state_derivative(state + 0.5 * dt * k1, k + 1, middle)
                k3, *_ = state_derivative(state + 0.5 * dt * k2, k + 1, middle)
                k4, *_ = state_derivative(state + dt * k3, k + 2, guess)
                state = state + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        return motion

    def _empty_motion(self, time_s: Series) -> RobotMotion:
        n, nv = len(time_s), self.model.nv
        return RobotMotion(time_s, np.empty((n, self.model.nq)), np.empty((n, nv)), np.empty((n, nv)))

    def _solve_position(
        self, guess: np.ndarray, task: Task, k: int, theta: np.ndarray, time_s: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Solve for ``q`` by Newton's method with the base rotation ``theta``; also return the Jacobian."""
        model, data, q, R_d = self.model, self.data, guess.copy(), pin.exp3(theta) @ self._R_upright
        q[self.upper + 1] = task.upper.q[k]
        left_m, right_m, com_m = task.places_m[k]
        step = np.zeros(model.nv)
        for _ in range(_ITERATIONS):
            J = self._jacobian(q)
            left, right = (data.oMf[sole] for sole in self._soles)
            e = np.concatenate(
                [
                    *(left_m - left.translation, -pin.log3(left.rotation)),
                    *(right_m - right.translation, -pin.log3(right.rotation)),
                    *(com_m - data.com[0], pin.log3(R_d @ data.oMi[1].rotation.T)),
                ]
            )
            if np.abs(e).max() < _TOLERANCE:
                return q, J
            step[self._lower] = np.linalg.solve(J[:, self._lower], e)
            q = pin.integrate(model, q, min(1.0, _STEP_RAD / float(np.abs(step).max())) * step)
        raise NotEstimable("robot-out-of-reach", f"The robot's legs do not reach the footprints {time_s:.2f} s in.")

    def _jacobian(self, q: np.ndarray) -> np.ndarray:
        """Rows: left sole, right sole (world aligned), CoM, rotation of the base (world)."""
        model, data = self.model, self.data
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        J_com = pin.jacobianCenterOfMass(model, data, q)
        J_base = np.zeros((3, model.nv))
        J_base[:, 3:6] = data.oMi[1].rotation
        soles = [pin.getFrameJacobian(model, data, f, pin.LOCAL_WORLD_ALIGNED) for f in self._soles]
        return np.vstack([*soles, J_com, J_base])

    def _drift(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """``J'(q, v) v``; zero for the rotation of an upright base."""
        model, data, zero_acceleration = self.model, self.data, np.zeros(self.model.nv)
        pin.centerOfMass(model, data, q, v, zero_acceleration)
        pin.forwardKinematics(model, data, q, v, zero_acceleration)
        rows = [pin.getFrameClassicalAcceleration(model, data, f, pin.LOCAL_WORLD_ALIGNED) for f in self._soles]
        return np.concatenate([*(row.vector for row in rows), data.acom[0], np.zeros(3)])

    def _solve_rates(self, J: np.ndarray, rate: np.ndarray, upper: np.ndarray) -> np.ndarray:
        """Rates of all coordinates: the upper body as given, base and legs from the equations."""
        rates = np.empty(self.model.nv)
        rates[self._lower] = np.linalg.solve(J[:, self._lower], rate - J[:, self._others] @ upper)
        rates[self._others] = upper
        return rates
