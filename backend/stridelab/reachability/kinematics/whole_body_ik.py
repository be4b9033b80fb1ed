"""Inverse kinematics of the whole body for many problems at once: contacts, and the CoM along given directions.

The coordinates ``x`` are the root's position, yaw, pitch and roll of the trunk (turned in this order; its axes are
those of ``Robot.R_root_trunk``) and the angles of the joints, all within limits of their own for every problem. With
``e`` the stacked errors and ``J`` their Jacobian, a step is the least one that annuls ``e - J dx``, seen from a pull
``k (x_0 - x)`` towards a posture that dies away:

    dx = d_0 + W J^T (J W J^T + d I)^-1 (e - J d_0),      d_0 = W k (x_0 - x) + (I - W) dx_limit

Coordinates that it would carry out of their limits go as far as they may (``dx_limit``, ``W = 0``), and the step is
computed anew for the others.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import pinocchio as pin
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation as ScipyRotation

from stridelab.conventions import Mask, Points, Rotation, Rotations, Vector3
from stridelab.errors import Fault, NotEstimable
from stridelab.reachability.kinematics.rotations import rotation_vectors, times, turned
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.robot import Robot

Coordinates = Float[np.ndarray, "n v"]
Directions = Float[np.ndarray, "n r 3"]

BASE: Final = 6
YAW, PITCH, ROLL = 3, 4, 5
TOLERANCE: Final = 1e-6
"""Largest error (m, rad) of a problem that is solved."""
DAMPING: Final = 1e-7
STEP: Final = 0.4
"""Largest change of a coordinate (m, rad) in one step."""
STEPS: Final = 50
PATIENCE: Final = 25
FAR: Final = 0.03
"""A problem that is so far off (m, rad) after ``PATIENCE`` steps is given up."""
PULL: Final = 0.1
PULL_DECAY: Final = 0.8
PASSES: Final = 3
"""How often a step is computed, at most with so many sets of coordinates at their limits but one."""


class Target(NamedTuple):
    """Where one effector is to be in every problem: ``p_m`` and, for a surface, ``R``."""

    p_m: Points
    R: Rotations | None = None


@dataclass(frozen=True, eq=False)
class Link:
    """What a coordinate moves: its parent's number, fixed placement, axis, and the mass it carries itself."""

    parent: int
    p: Vector3
    R: Rotation
    axis: Vector3
    turns: bool
    mass_kg: float
    lever_m: Vector3


@dataclass(frozen=True, eq=False)
class End:
    """A contact frame: the coordinate that moves it last, all those that move it, and its place in the last."""

    link: int
    moved_by: Int[np.ndarray, "m"]
    p: Vector3
    R: Rotation


class State(NamedTuple):
    """Origins and rotations of all links, and the axes of their coordinates, in the world."""

    p: Float[np.ndarray, "v n 3"]
    R: Float[np.ndarray, "v n 3 3"]
    axes: Float[np.ndarray, "v n 3"]


@dataclass(frozen=True, eq=False)
class BodyTree:
    """The tree of a robot. ``below`` says which links hang on which: ``(v, v)``, row on column, itself too.

    ``lower`` and ``upper`` are the limits of the coordinates, infinite for the base.
    """

    links: tuple[Link, ...]
    ends: Mapping[str, End]
    below: Float[np.ndarray, "v v"]
    lower: Float[np.ndarray, "v"]
    upper: Float[np.ndarray, "v"]
    R_root_trunk: Rotation

    @staticmethod
    def of(robot: Robot) -> "BodyTree":
        """The tree of ``robot``. Raises ``NotEstimable`` (``measure-unavailable``) for joints that do not turn."""
        model, frames = with_contact_frames(robot)
        none, flat = np.zeros(3), np.eye(3)
        base, R_trunk_root = model.inertias[1], robot.R_root_trunk.T
        links = [Link(k - 1, none, flat, flat[k], False, 0.0, none) for k in range(3)]
        links += [Link(2 + k, none, flat, flat[2 - k], True, 0.0, none) for k in range(2)]
        links.append(Link(4, none, flat, flat[0], True, float(base.mass), R_trunk_root @ base.lever))
        number = {1: ROLL} | {j: BASE + j - 2 for j in range(2, model.njoints)}
        # what hangs on the root is seen from the trunk's axes
        seen = {1: R_trunk_root}
        links += [_link(model, j, number[model.parents[j]], seen) for j in range(2, model.njoints)]
        below = np.eye(len(links))
        for k, link in enumerate(links):
            if link.parent >= 0:
                below[k] += below[link.parent]
        ends = {}
        for name, index in frames.items():
            frame = model.frames[index]
            k = number[frame.parentJoint]
            T, R_seen = frame.placement, seen.get(frame.parentJoint, flat)
            ends[name] = End(k, np.flatnonzero(below[k]), R_seen @ T.translation, R_seen @ T.rotation)
        free = np.full(BASE, np.inf)
        lower, upper = model.lowerPositionLimit[7:], model.upperPositionLimit[7:]
        R = robot.R_root_trunk
        return BodyTree(tuple(links), ends, below, np.r_[-free, lower], np.r_[free, upper], R)

    def forward(self, x: Coordinates) -> State:
        """Where everything is."""
        n, v = len(x), len(self.links)
        p, axes, R = np.empty((v, n, 3)), np.empty((v, n, 3)), np.empty((v, n, 3, 3))
        p_world, R_world = np.zeros((n, 3)), np.broadcast_to(np.eye(3), (n, 3, 3))
        for k, link in enumerate(self.links):
            p_parent, R_parent = (p_world, R_world) if link.parent < 0 else (p[link.parent], R[link.parent])
            R_fixed = times(R_parent, link.R)
            p[k] = p_parent + R_parent @ link.p
            axes[k] = R_fixed @ link.axis
            if link.turns:
                R[k] = turned(R_fixed, link.axis, x[:, k])
            else:
                R[k] = R_fixed
                p[k] += axes[k] * x[:, k, None]
        return State(p, R, axes)

    def com(self, at: State) -> tuple[Points, Float[np.ndarray, "n 3 v"]]:
        """The CoM and its Jacobian: a coordinate moves what hangs on it."""
        masses = np.array([link.mass_kg for link in self.links])
        levers = np.array([link.lever_m for link in self.links])
        moments = masses[:, None, None] * (at.p + np.einsum("vnab,vb->vna", at.R, levers))
        hanging_kg = self.below.T @ masses
        hanging = np.tensordot(self.below.T, moments, axes=1)
        arms = hanging - hanging_kg[:, None, None] * at.p
        turns = np.array([link.turns for link in self.links])[:, None, None]
        columns = np.where(turns, np.cross(at.axes, arms), hanging_kg[:, None, None] * at.axes) / masses.sum()
        return moments.sum(axis=0) / masses.sum(), columns.transpose(1, 2, 0)

    def place(self, name: str, at: State) -> tuple[Points, Rotations]:
        """Position and rotation of an effector's contact frame."""
        end = self.ends[name]
        return at.p[end.link] + at.R[end.link] @ end.p, times(at.R[end.link], end.R)

    def solve(
        self,
        targets: Mapping[str, Target],
        directions: Directions,
        com_m: Float[np.ndarray, "n r"],
        start: Coordinates,
        limits: tuple[Coordinates, Coordinates],
        posture: Coordinates,
    ) -> tuple[Coordinates, Mask]:
        """Coordinates with every effector at its target and ``directions @ c = com_m``, and where they were found."""
        x = np.clip(start, *limits)
        solved = np.zeros(len(x), dtype=bool)
        left = np.arange(len(x))
        for step in range(STEPS):
            e, J = self._errors(targets, directions, com_m, x[left], left)
            worst = np.abs(e).max(axis=1)
            solved[left] = worst < TOLERANCE
            going = (worst >= TOLERANCE) & ((worst < FAR) | (step < PATIENCE))
            left, e, J = left[going], e[going], J[going]
            if not len(left):
                break
            low, high = limits[0][left], limits[1][left]
            x[left] = _stepped(x[left], e, J, low, high, PULL * PULL_DECAY**step * (posture[left] - x[left]))
        return x, solved

    def q(self, x: Coordinates) -> Float[np.ndarray, "n nq"]:
        """The configurations as the robot's model has them."""
        R_root = ScipyRotation.from_euler("ZYX", x[:, YAW : ROLL + 1]) * ScipyRotation.from_matrix(self.R_root_trunk.T)
        return np.hstack([x[:, :3], R_root.as_quat(), x[:, BASE:]])

    def x(self, q: Float[np.ndarray, "n nq"]) -> Coordinates:
        """The coordinates of configurations."""
        R_trunk = ScipyRotation.from_quat(q[:, 3:7]) * ScipyRotation.from_matrix(self.R_root_trunk)
        return np.hstack([q[:, :3], R_trunk.as_euler("ZYX"), q[:, 7:]])

    def _errors(
        self,
        targets: Mapping[str, Target],
        directions: Directions,
        com_m: Float[np.ndarray, "n r"],
        x: Float[np.ndarray, "m v"],
        of: Int[np.ndarray, "m"],
    ) -> tuple[Float[np.ndarray, "m e"], Float[np.ndarray, "m e v"]]:
        """Stacked errors of the problems ``of`` and their Jacobian."""
        at = self.forward(x)
        c, J_com = self.com(at)
        errors = [com_m[of] - (directions[of] @ c[..., None])[..., 0]]
        rows = [directions[of] @ J_com]
        turns = np.array([link.turns for link in self.links])
        for name, target in targets.items():
            p, R = self.place(name, at)
            moved = self.ends[name].moved_by
            axes = at.axes[moved]
            J = np.zeros((len(x), 6, len(self.links)))
            turning = turns[moved][:, None, None]
            J[:, :3, moved] = np.where(turning, np.cross(axes, p - at.p[moved]), axes).transpose(1, 2, 0)
            errors.append(target.p_m[of] - p)
            if target.R is None:
                rows.append(J[:, :3])
                continue
            J[:, 3:, moved] = np.where(turning, axes, 0.0).transpose(1, 2, 0)
            errors.append(rotation_vectors(target.R[of] @ R.swapaxes(1, 2)))
            rows.append(J)
        return np.hstack(errors), np.concatenate(rows, axis=1)


def _stepped(
    x: Coordinates,
    e: Float[np.ndarray, "n e"],
    J: Float[np.ndarray, "n e v"],
    low: Coordinates,
    high: Coordinates,
    pull: Coordinates,
) -> Coordinates:
    """``x + dx``, within the limits."""
    least, most = np.maximum(low - x, -STEP), np.minimum(high - x, STEP)
    d_0, free = pull, np.ones(x.shape, dtype=bool)
    for _ in range(PASSES):
        JW = J * free[:, None, :]
        H = JW @ JW.swapaxes(1, 2) + DAMPING * np.eye(J.shape[1])
        missing = e - (J @ d_0[..., None])[..., 0]
        dx = d_0 + (JW.swapaxes(1, 2) @ np.linalg.solve(H, missing[..., None]))[..., 0]
        out = free & ((dx < least) | (dx > most))
        d_0 = np.where(out, np.clip(dx, least, most), d_0)
        free &= ~out
    return np.asarray(np.clip(x + np.clip(dx, least, most), low, high))


def _link(model: pin.Model, j: int, parent: int, seen: Mapping[int, Rotation]) -> Link:
    joint = model.joints[j]
    motion = joint.createData()
    joint.calc(motion, pin.neutral(model))
    S = np.array(motion.S).reshape(6, -1)
    if joint.nq != 1 or np.abs(S[:3]).max() > 0.0:
        name = model.names[j]
        raise NotEstimable(
            "measure-unavailable",
            f"Stances are searched for bodies of revolute joints; joint {name} is another one.",
            [Fault("measure", f"joint {name} does not simply turn")],
        )
    at, inertia = model.jointPlacements[j], model.inertias[j]
    R_seen = seen.get(model.parents[j], np.eye(3))
    return Link(
        parent,
        R_seen @ at.translation,
        R_seen @ at.rotation,
        np.array(S[3:, 0]),
        True,
        float(inertia.mass),
        np.array(inertia.lever),
    )
