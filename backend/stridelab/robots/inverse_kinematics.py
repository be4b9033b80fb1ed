"""Position-level inverse kinematics: a configuration that stands on given contacts with its CoM at a given place.

With the errors ``e(q)`` of the contacts (six for a surface, three for a point) and of the CoM stacked, ``J`` their
Jacobian and ``p`` the way back to the posture that one starts from, every step solves

    min_dq  |J dq - e|^2 + w |dq - p|^2 + d |dq|^2     subject to   q_min + margin <= q + dq <= q_max - margin,
                                                                    |dq| <= 0.2

twice over: first with a posture weight ``w`` that falls from step to step, so that the redundancy of the body goes
to the posture, then with ``w = 0`` to land on the contacts. The joint limits are never crossed on the way.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import daqp
import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.conventions import Vector3
from stridelab.dynamics.placement import Placement
from stridelab.errors import InvalidInput
from stridelab.robots.contact_frames import se3, with_contact_frames
from stridelab.robots.robot import Robot

TOLERANCE: float = 1e-7
"""Largest error (m, rad) of a converged configuration."""
_MARGIN_RAD = 0.02
_STEP = 0.2
_POSTURE_STEPS, _STEPS = 40, 80
_DAMPING = 1e-9


@dataclass(frozen=True, eq=False)
class IkResult:
    """What was found: the largest errors left in position and orientation, the target with the first as ``worst``.

    ``q`` ``(nq,)`` keeps the joint limits whether or not it ``converged``.
    """

    q: Float[np.ndarray, "nq"]
    error_m: float
    converged: bool
    error_rad: float
    worst: str


def stand(
    robot: Robot,
    placements: Mapping[str, Placement],
    com_m: Vector3,
    q_start: Float[np.ndarray, "nq"] | None = None,
) -> IkResult:
    """Configuration with every effector of ``placements`` at its T_world_contact and the CoM at ``com_m``.

    A surface is placed in all six coordinates, a point in three. The posture is that of ``q_start``, by default the
    reference posture carried to the CoM and turned to the mean heading of the surfaces. An unreachable target is no
    error: the result says how far it stayed away. Raises ``InvalidInput`` "effector-unknown".
    """
    unknown = sorted(set(placements) - set(robot.effectors))
    if unknown:
        raise InvalidInput("effector-unknown", f"{robot.title} has no effector {', '.join(unknown)}")
    problem = _Problem(robot, placements, com_m)
    posture = _reference_at(robot, placements, com_m) if q_start is None else q_start
    q = posture.copy()
    q[7:] = np.clip(q[7:], problem.lower, problem.upper)
    for step in range(_STEPS):
        e, J = problem.errors(q)
        weight = 1e-2 * 0.75**step if step < _POSTURE_STEPS else 0.0
        if weight == 0.0 and np.abs(e).max() < 1e-10:
            break
        q = pin.integrate(problem.model, q, problem.step(q, e, J, weight, posture))
    return problem.result(q)


def _reference_at(robot: Robot, placements: Mapping[str, Placement], com_m: Vector3) -> Float[np.ndarray, "nq"]:
    """The reference posture above the CoM, turned to the mean heading of the surface contacts."""
    ahead = [p.rotation[:2, 0] for name, p in placements.items() if robot.effectors[name].kind == "surface"]
    x, y = np.sum(ahead, axis=0) if ahead else (1.0, 0.0)
    yaw = float(np.arctan2(y, x))
    q = robot.q_reference.copy()
    turn = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, yaw), np.zeros(3))
    q[:7] = pin.SE3ToXYZQUAT(turn * pin.XYZQUATToSE3(q[:7]))
    data = robot.model.createData()
    q[:3] += com_m - pin.centerOfMass(robot.model, data, q)
    return np.asarray(q)


class _Problem:
    """Errors, Jacobian and one bounded step."""

    def __init__(self, robot: Robot, placements: Mapping[str, Placement], com_m: Vector3) -> None:
        self.model, self._frames = with_contact_frames(robot)
        self._data = self.model.createData()
        self._targets = {name: (se3(p), robot.effectors[name].kind) for name, p in placements.items()}
        self._com_m = com_m
        middle = 0.5 * (self.model.lowerPositionLimit + self.model.upperPositionLimit)[7:]
        self.lower = np.minimum(self.model.lowerPositionLimit[7:] + _MARGIN_RAD, middle)
        self.upper = np.maximum(self.model.upperPositionLimit[7:] - _MARGIN_RAD, middle)

    def errors(self, q: Float[np.ndarray, "nq"]) -> tuple[Float[np.ndarray, "m"], Float[np.ndarray, "m nv"]]:
        """Stacked errors, world aligned (linear before angular, the CoM last), and their Jacobian."""
        model, data = self.model, self._data
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        J_com = pin.jacobianCenterOfMass(model, data, q)
        e: list[np.ndarray] = []
        J: list[np.ndarray] = []
        for name, (target, kind) in self._targets.items():
            here = data.oMf[self._frames[name]]
            J_frame = pin.getFrameJacobian(model, data, self._frames[name], pin.LOCAL_WORLD_ALIGNED)
            e.append(target.translation - here.translation)
            J.append(J_frame[:3])
            if kind == "surface":
                e.append(pin.log3(target.rotation @ here.rotation.T))
                J.append(J_frame[3:])
        return np.concatenate([*e, self._com_m - data.com[0]]), np.vstack([*J, J_com])

    def step(
        self,
        q: Float[np.ndarray, "nq"],
        e: Float[np.ndarray, "m"],
        J: Float[np.ndarray, "m nv"],
        weight: float,
        posture: Float[np.ndarray, "nq"],
    ) -> Float[np.ndarray, "nv"]:
        """The bounded least-squares step; the base's position is the contacts' affair, never the posture's."""
        nv = self.model.nv
        p = pin.difference(self.model, q, posture)
        w = np.full(nv, weight)
        w[:3] = 0.0
        H = J.T @ J + np.diag(w + _DAMPING)
        upper, lower = np.full(nv, _STEP), np.full(nv, -_STEP)
        upper[6:] = np.minimum(upper[6:], self.upper - q[7:])
        lower[6:] = np.maximum(lower[6:], self.lower - q[7:])
        dq, _, flag, _ = daqp.solve(H, -J.T @ e - w * p, np.zeros((0, nv)), upper, lower)
        if flag < 1:  # a convex programme with 0 inside its bounds fails only by rounding
            return np.zeros(nv)
        return np.asarray(dq)

    def result(self, q: Float[np.ndarray, "nq"]) -> IkResult:
        """Errors at ``q`` by target."""
        e, _ = self.errors(q)
        away: dict[str, float] = {}
        turned = 0.0
        row = 0
        for name, (_, kind) in self._targets.items():
            away[name] = float(np.linalg.norm(e[row : row + 3]))
            row += 3
            if kind == "surface":
                turned = max(turned, float(np.linalg.norm(e[row : row + 3])))
                row += 3
        away["centre of mass"] = float(np.linalg.norm(e[row:]))
        worst = max(away, key=lambda name: away[name])
        error_m = away[worst]
        return IkResult(q, error_m, error_m < TOLERANCE and turned < TOLERANCE, turned, worst)
