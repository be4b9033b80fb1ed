"""Position-level inverse kinematics: a configuration on given contacts with a given centre of mass (CoM).

``e(q)`` stacks the errors of the contacts (six rows for a surface, three for a point) and of the CoM; ``J`` is its
Jacobian, ``p`` the difference to the starting posture and ``h(q)`` the orientation error of the point contacts, with
Jacobian ``H``. Every step solves the quadratic program

    min_dq  |J dq - e|^2 + s (|dq - p|_W^2 + w_h |H dq - h|^2) + d |dq|^2
    subject to   q_min + margin <= q + dq <= q_max - margin ,   |dq| <= 0.2

The posture weight ``s`` first decreases from step to step, so that the redundancy is resolved by the posture task, and
is then 0 until the contact errors converge. ``W`` weighs the orientation of the base most, then the torso, the arms and
the legs, with the weights of the whole-body stage, so that a motion that starts here starts at rest. No iterate
violates the joint limits.

If the CoM may lie anywhere in a region ``A c <= b``, ``e`` contains only the rows of the violated half-spaces, and
``s w_c |J_c dq - (c_0 - c)|^2`` pulls the CoM towards a preferred position ``c_0``.
"""

import math
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import daqp
import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.conventions import Angles, Vector3
from stridelab.dynamics.spatial import Placement
from stridelab.errors import InvalidInput
from stridelab.robots.contact_frames import to_se3, with_contact_frames
from stridelab.robots.robot import Robot
from stridelab.robots.self_collision import PairSeparation

TOLERANCE: float = 1e-7
"""Largest error (m, rad) of a converged configuration."""
_MIN_MARGIN_RAD = 0.02
_MAX_STEP = 0.2
_AT_LIMIT_RAD = 1e-3
_DAMPING = 1e-9
_BASE_WEIGHT = 4.0
_GROUP_WEIGHTS = {"leg": 4.5e-4, "torso": 0.125, "arm": 0.03125, "head": 0.03125}
_HAND_WEIGHT = 0.045
_COM_WEIGHT = 1.0
"""``w_c``, the weight of the preferred CoM: below that of the base orientation, above that of any joint."""


class _Schedule(NamedTuple):
    """Schedule of the iterations: the posture weight falls by ``decay`` for ``posture_steps`` steps, and is then 0.

    After a step of at most ``settled_rad`` it falls by ``settled_decay`` instead: the posture has arrived.
    ``end_error`` is the error that ends the iterations, ``tolerance`` the one that counts as converged (m, rad).
    ``undone_share`` is the share that is taken of a step that undoes the one before: near a straight knee, where the
    error is not linear, full steps go forth and back. Iterations with a posture weight of 0 end after ``stalled_steps``
    that lower the error by less than a tenth, None: never.
    """

    decay: float
    posture_steps: int
    steps: int
    end_error: float
    tolerance: float
    settled_rad: float = 0.0
    settled_decay: float = 1.0
    undone_share: float = 1.0
    stalled_steps: int | None = None


_THOROUGH = _Schedule(0.85, 100, 150, 1e-10, TOLERANCE)
_QUICK = _Schedule(0.75, 45, 75, 1e-7, 1e-5, 0.02, 0.3)
_STANCE = _QUICK._replace(undone_share=0.5, stalled_steps=6)
_NEAR = _Schedule(0.5, 10, 40, 1e-7, 1e-5)
_UNDONE_COSINE = -0.5
_STALLED_SHARE = 0.9


@dataclass(frozen=True, eq=False)
class ComRegion:
    """Admissible region of the CoM: ``A c <= b`` with unit rows, ``A`` ``(m, 3)`` and ``b`` ``(m,)`` in metres."""

    A: Float[np.ndarray, "m 3"]
    b: Float[np.ndarray, "m"]

    @staticmethod
    def over_polygon(region_m: Float[np.ndarray, "k 2"]) -> "ComRegion":
        """The vertical prism over a convex, counter-clockwise polygon; unbounded for fewer than three corners."""
        edge = np.roll(region_m, -1, axis=0) - region_m
        length = np.linalg.norm(edge, axis=1)
        some = length > 0.0
        if len(region_m) < 3 or not some.any():
            return ComRegion(np.zeros((0, 3)), np.zeros(0))
        normal = np.column_stack([edge[some, 1], -edge[some, 0]]) / length[some, None]
        A = np.column_stack([normal, np.zeros(len(normal))])
        return ComRegion(A, (normal * region_m[some]).sum(axis=1))


@dataclass(frozen=True, eq=False)
class IkResult:
    """Solution of the inverse kinematics: the largest remaining errors; ``worst`` has the largest position error.

    ``q`` ``(nq,)`` satisfies the joint limits whether or not it ``converged``. ``position_errors_m`` is the position
    error of every target, the CoM as ``centre of mass``; ``at_limit`` names the joints at an end of their range less
    the margin.
    """

    q: Float[np.ndarray, "nq"]
    error_m: float
    converged: bool
    error_rad: float
    worst: str
    position_errors_m: Mapping[str, float]
    at_limit: tuple[str, ...]


def stand(
    robot: Robot,
    placements: Mapping[str, Placement],
    com_m: Vector3,
    q_start: Float[np.ndarray, "nq"] | None = None,
    margins_rad: Angles | None = None,
    *,
    is_quick: bool = False,
) -> IkResult:
    """Configuration with every effector of ``placements`` at its T_world_contact and the CoM at ``com_m``.

    A surface is placed in all six coordinates, a point in three. The posture is that of ``q_start``, by default the
    reference posture moved to the CoM and turned to the mean heading of the surfaces. ``margins_rad`` ``(na,)`` is the
    margin of every joint to either end of its range, at least 0.02 rad. An unreachable target is not an exception: the
    result contains the remaining errors. With ``is_quick`` the search takes a third of the time, and errors below
    0.01 mm have converged. Raises ``InvalidInput`` (``effector-unknown``).
    """
    unknown = sorted(set(placements) - set(robot.effectors))
    if unknown:
        raise InvalidInput("effector-unknown", f"{robot.title} has no effector {', '.join(unknown)}")
    problem = _Problem(robot, placements, com_m, 0.0 if margins_rad is None else margins_rad)
    posture = reference_posture_at(robot, placements, com_m) if q_start is None else q_start
    return problem.solve(posture, _QUICK if is_quick else _THOROUGH)


def stand_in_com_region(
    robot: Robot,
    placements: Mapping[str, Placement],
    com_region: ComRegion,
    com_m: Vector3,
    q_start: Float[np.ndarray, "nq"] | None = None,
    margins_rad: Angles | None = None,
    separation: PairSeparation | None = None,
    *,
    is_near: bool = False,
) -> IkResult:
    """``stand`` with the CoM anywhere in ``com_region``, near ``com_m`` if possible, and half the number of steps.

    With ``is_near`` the search takes a quarter of the steps: ``q_start`` is near the solution.

    The pairs of ``separation`` are pushed out of collision while the posture weight is positive, not afterwards. The
    result ``converged`` if every error is below 0.01 mm, even if pairs still overlap. Raises ``InvalidInput``
    (``effector-unknown``).
    """
    unknown = sorted(set(placements) - set(robot.effectors))
    if unknown:
        raise InvalidInput("effector-unknown", f"{robot.title} has no effector {', '.join(unknown)}")
    problem = _Problem(robot, placements, com_m, 0.0 if margins_rad is None else margins_rad, com_region, separation)
    posture = reference_posture_at(robot, placements, com_m) if q_start is None else q_start
    return problem.solve(posture, _NEAR if is_near else _STANCE)


def reference_posture_at(robot: Robot, placements: Mapping[str, Placement], com_m: Vector3) -> Float[np.ndarray, "nq"]:
    """The reference posture above the CoM, turned to the mean heading of the surface contacts."""
    ahead = [p.rotation[:2, 0] for name, p in placements.items() if robot.effectors[name].kind == "surface"]
    x, y = np.sum(ahead, axis=0) if ahead else (1.0, 0.0)
    yaw = float(np.arctan2(y, x))
    q = robot.q_reference.copy()
    turn = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, yaw), np.zeros(3))
    q[:7] = pin.SE3ToXYZQUAT(turn * pin.XYZQUATToSE3(q[:7]))
    data = _shared_data(robot, threading.get_ident())[0]
    q[:3] += com_m - pin.centerOfMass(robot.model, data, q)
    return np.asarray(q)


@lru_cache(maxsize=16)
def _shared_data(robot: Robot, _thread: int) -> tuple[pin.Data, pin.Data]:
    """Data of the robot's model and of the one with contact frames; making them takes as long as two steps."""
    return robot.model.createData(), with_contact_frames(robot)[0].createData()


class _Problem:
    """Errors, their Jacobian and the step of one inverse kinematics problem."""

    def __init__(
        self,
        robot: Robot,
        placements: Mapping[str, Placement],
        com_m: Vector3,
        margins_rad: Angles | float,
        com_region: ComRegion | None = None,
        separation: PairSeparation | None = None,
    ) -> None:
        self.model, self._frames = with_contact_frames(robot)
        self._data = _shared_data(robot, threading.get_ident())[1]
        self._targets = {name: (to_se3(p), robot.effectors[name].kind) for name, p in placements.items()}
        self._has_points = any(kind == "point" for _, kind in self._targets.values())
        self._most, self._no_rows = np.full(self.model.nv, _MAX_STEP), np.zeros((0, self.model.nv))
        self._com_m, self._room, self._apart, self._joints = com_m, com_region, separation, robot.joint_names
        groups = [_GROUP_WEIGHTS[robot.group[joint]] for joint in robot.joint_names]
        self._weights = np.array([0.0, 0.0, 0.0, _BASE_WEIGHT, _BASE_WEIGHT, _BASE_WEIGHT, *groups])
        middle = 0.5 * (self.model.lowerPositionLimit + self.model.upperPositionLimit)[7:]
        margins = np.maximum(margins_rad, _MIN_MARGIN_RAD)
        self.lower = np.minimum(self.model.lowerPositionLimit[7:] + margins, middle)
        self.upper = np.maximum(self.model.upperPositionLimit[7:] - margins, middle)

    def stacked_errors(self, q: Float[np.ndarray, "nq"]) -> tuple[Float[np.ndarray, "m"], Float[np.ndarray, "m nv"]]:
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
        if self._room is None:
            return np.concatenate([*e, self._com_m - data.com[0]]), np.concatenate([*J, J_com])
        violated = self._room.A @ data.com[0] > self._room.b
        A, b = self._room.A[violated], self._room.b[violated]
        return np.concatenate([*e, b - A @ data.com[0]]), np.concatenate([*J, A @ J_com])

    def solve(self, posture: Float[np.ndarray, "nq"], schedule: _Schedule) -> IkResult:
        """Iterate from ``posture``, which is also the target of the posture task."""
        q = posture.copy()
        q[7:] = np.clip(q[7:], self.lower, self.upper)
        softness, least = 1.0, schedule.decay**schedule.posture_steps
        before = np.zeros(self.model.nv)
        lowest, stalled = np.inf, 0
        for step in range(schedule.steps):
            if step >= schedule.posture_steps or softness <= least:
                softness = 0.0
            e, J = self.stacked_errors(q)
            if softness == 0.0:
                error = float(np.abs(e).max())
                stalled = 0 if error < _STALLED_SHARE * lowest else stalled + 1
                lowest = min(lowest, error)
                if error < schedule.end_error or stalled == schedule.stalled_steps:
                    break
            dq = self.bounded_step(q, e, J, softness, posture)
            if softness > 0.0 and _is_undone(before, dq):
                dq = schedule.undone_share * dq
            before = dq
            q = pin.integrate(self.model, q, dq)
            softness *= schedule.settled_decay if np.abs(dq).max() <= schedule.settled_rad else schedule.decay
        return self.result_at(q, schedule.tolerance)

    def bounded_step(
        self,
        q: Float[np.ndarray, "nq"],
        e: Float[np.ndarray, "m"],
        J: Float[np.ndarray, "m nv"],
        posture_weight: float,
        posture: Float[np.ndarray, "nq"],
    ) -> np.ndarray:
        """The bounded least-squares step ``(nv,)`` for the errors and their Jacobian at ``q``."""
        nv = self.model.nv
        w = posture_weight * self._weights
        s_h = posture_weight * _HAND_WEIGHT
        P = J.T @ J
        P.reshape(-1)[:: nv + 1] += w + _DAMPING
        c = -J.T @ e - w * pin.difference(self.model, q, posture)
        if s_h > 0.0 and self._has_points:
            h, H_hand = self._point_orientation_errors()
            P += s_h * H_hand.T @ H_hand
            c -= s_h * H_hand.T @ h
        if self._apart is not None and posture_weight > 0.0:
            e_apart, J_apart = self._apart.task_rows(self.model, self._data)
            P += J_apart.T @ J_apart
            c -= J_apart.T @ e_apart
        if self._room is not None and posture_weight > 0.0:
            J_com, s_c = self._data.Jcom, posture_weight * _COM_WEIGHT
            P += s_c * J_com.T @ J_com
            c -= s_c * J_com.T @ (self._com_m - self._data.com[0])
        upper, lower = self._most.copy(), -self._most
        np.minimum(upper[6:], self.upper - q[7:], out=upper[6:])
        np.maximum(lower[6:], self.lower - q[7:], out=lower[6:])
        dq, _, flag, _ = daqp.solve(P, c, self._no_rows, upper, lower)
        if flag < 1:  # 0 is feasible, so this convex quadratic program fails only by rounding
            return np.zeros(nv)
        return np.asarray(dq)

    def _point_orientation_errors(self) -> tuple[Float[np.ndarray, "m"], Float[np.ndarray, "m nv"]]:
        """Orientation errors of the point contacts and their Jacobian at the ``q`` of the last ``stacked_errors``."""
        h: list[np.ndarray] = []
        H: list[np.ndarray] = []
        for name, (target, kind) in self._targets.items():
            if kind == "point":
                here = self._data.oMf[self._frames[name]]
                h.append(pin.log3(target.rotation @ here.rotation.T))
                J = pin.getFrameJacobian(self.model, self._data, self._frames[name], pin.LOCAL_WORLD_ALIGNED)
                H.append(J[3:])
        return np.concatenate(h), np.concatenate(H)

    def result_at(self, q: Float[np.ndarray, "nq"], tolerance: float) -> IkResult:
        """The result at ``q`` with the errors of every target."""
        e, _ = self.stacked_errors(q)
        errors_m: dict[str, float] = {}
        error_rad = 0.0
        row = 0
        for name, (_, kind) in self._targets.items():
            errors_m[name] = float(np.linalg.norm(e[row : row + 3]))
            row += 3
            if kind == "surface":
                error_rad = max(error_rad, float(np.linalg.norm(e[row : row + 3])))
                row += 3
        errors_m["centre of mass"] = float(np.linalg.norm(e[row:]))
        worst = max(errors_m, key=lambda name: errors_m[name])
        error_m = errors_m[worst]
        is_at_limit = (q[7:] <= self.lower + _AT_LIMIT_RAD) | (q[7:] >= self.upper - _AT_LIMIT_RAD)
        at_limit = tuple(joint for joint, end in zip(self._joints, is_at_limit, strict=True) if end)
        converged = error_m < tolerance and error_rad < tolerance
        return IkResult(q, error_m, converged, error_rad, worst, errors_m, at_limit)


def _is_undone(before: Float[np.ndarray, "nv"], step: Float[np.ndarray, "nv"]) -> bool:
    """Whether ``step`` goes back on the step before it."""
    return float(before @ step) < _UNDONE_COSINE * math.sqrt(float(before @ before) * float(step @ step))
