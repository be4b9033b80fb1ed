"""Position-level inverse kinematics: a configuration that stands on given contacts with its CoM at a given place.

With the errors ``e(q)`` of the contacts (six for a surface, three for a point) and of the CoM stacked, ``J`` their
Jacobian, ``p`` the way back to the posture that one starts from and ``h(q)`` how far the points' frames are turned
from their contacts', every step solves

    min_dq  |J dq - e|^2 + s (|dq - p|_W^2 + w_h |H dq - h|^2) + d |dq|^2
    subject to   q_min + margin <= q + dq <= q_max - margin ,   |dq| <= 0.2

twice over: first with a softness ``s`` that falls from step to step, so that the redundancy of the body goes to the
posture, then with ``s = 0`` to land on the contacts. ``W`` holds the base upright first, then the torso, the arms and
the legs, in the proportions in which the whole-body stage weighs them: a motion that starts here starts at rest. The
joint limits are never crossed on the way.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import daqp
import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.conventions import Angles, Vector3
from stridelab.dynamics.placement import Placement
from stridelab.errors import InvalidInput
from stridelab.robots.contact_frames import se3, with_contact_frames
from stridelab.robots.robot import Robot

TOLERANCE: float = 1e-7
"""Largest error (m, rad) of a converged configuration."""
_MARGIN_RAD = 0.02
_STEP = 0.2
_POSTURE_STEPS, _STEPS = 100, 150
_DAMPING = 1e-9
_UPRIGHT = 4.0
_GROUP = {"leg": 4.5e-4, "torso": 0.125, "arm": 0.03125, "head": 0.03125}
_HAND = 0.045


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
    margins_rad: Angles | None = None,
) -> IkResult:
    """Configuration with every effector of ``placements`` at its T_world_contact and the CoM at ``com_m``.

    A surface is placed in all six coordinates, a point in three. The posture is that of ``q_start``, by default the
    reference posture carried to the CoM and turned to the mean heading of the surfaces. ``margins_rad`` ``(na,)`` is
    what every joint keeps from either end of its range, 0.02 rad at least. An unreachable target is no error: the
    result says how far it stayed away. Raises ``InvalidInput`` (``effector-unknown``).
    """
    unknown = sorted(set(placements) - set(robot.effectors))
    if unknown:
        raise InvalidInput("effector-unknown", f"{robot.title} has no effector {', '.join(unknown)}")
    problem = _Problem(robot, placements, com_m, 0.0 if margins_rad is None else margins_rad)
    posture = _reference_at(robot, placements, com_m) if q_start is None else q_start
    q = posture.copy()
    q[7:] = np.clip(q[7:], problem.lower, problem.upper)
    for step in range(_STEPS):
        softness = 0.85**step if step < _POSTURE_STEPS else 0.0
        e, _ = problem.errors(q)
        if softness == 0.0 and np.abs(e).max() < 1e-10:
            break
        q = pin.integrate(problem.model, q, problem.step(q, softness, posture))
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

    def __init__(
        self, robot: Robot, placements: Mapping[str, Placement], com_m: Vector3, margins_rad: Angles | float
    ) -> None:
        self.model, self._frames = with_contact_frames(robot)
        self._data = self.model.createData()
        self._targets = {name: (se3(p), robot.effectors[name].kind) for name, p in placements.items()}
        self._com_m = com_m
        groups = [_GROUP[robot.group[joint]] for joint in robot.joint_names]
        self._weights = np.array([0.0, 0.0, 0.0, _UPRIGHT, _UPRIGHT, _UPRIGHT, *groups])
        middle = 0.5 * (self.model.lowerPositionLimit + self.model.upperPositionLimit)[7:]
        margins = np.maximum(margins_rad, _MARGIN_RAD)
        self.lower = np.minimum(self.model.lowerPositionLimit[7:] + margins, middle)
        self.upper = np.maximum(self.model.upperPositionLimit[7:] - margins, middle)

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

    def step(self, q: Float[np.ndarray, "nq"], softness: float, posture: Float[np.ndarray, "nq"]) -> np.ndarray:
        """The bounded least-squares step ``(nv,)``."""
        nv = self.model.nv
        e, J = self.errors(q)
        h, H_hand = self._turned(q)
        w = softness * self._weights
        s_h = softness * _HAND
        P = J.T @ J + s_h * H_hand.T @ H_hand + np.diag(w + _DAMPING)
        c = -J.T @ e - s_h * H_hand.T @ h - w * pin.difference(self.model, q, posture)
        upper, lower = np.full(nv, _STEP), np.full(nv, -_STEP)
        upper[6:] = np.minimum(upper[6:], self.upper - q[7:])
        lower[6:] = np.maximum(lower[6:], self.lower - q[7:])
        dq, _, flag, _ = daqp.solve(P, c, np.zeros((0, nv)), upper, lower)
        if flag < 1:  # a convex programme with 0 inside its bounds fails only by rounding
            return np.zeros(nv)
        return np.asarray(dq)

    def _turned(self, q: Float[np.ndarray, "nq"]) -> tuple[Float[np.ndarray, "m"], Float[np.ndarray, "m nv"]]:
        """How far the frames of points are turned from their contacts', after ``errors`` at the same ``q``."""
        h: list[np.ndarray] = [np.zeros(0)]
        H: list[np.ndarray] = [np.zeros((0, self.model.nv))]
        for name, (target, kind) in self._targets.items():
            if kind == "point":
                here = self._data.oMf[self._frames[name]]
                h.append(pin.log3(target.rotation @ here.rotation.T))
                J = pin.getFrameJacobian(self.model, self._data, self._frames[name], pin.LOCAL_WORLD_ALIGNED)
                H.append(J[3:])
        return np.concatenate(h), np.vstack(H)

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
