"""Batched inverse kinematics of the whole body: contacts, and the CoM along given directions.

The coordinates ``x`` are the position of the root, yaw, pitch and roll of the trunk (in this order; its axes are those
of ``Robot.R_root_trunk``) and the joint angles; every problem has its own limits. With the stacked errors ``e`` and
their Jacobian ``J``, the step solves ``e = J dx`` and is the one nearest to a decaying pull ``k (x_0 - x)`` towards a
posture:

    dx = d_0 + W J^T (J W J^T + d I)^-1 (e - J d_0),      d_0 = W k (x_0 - x) + (I - W) dx_limit

Coordinates that would violate their limits are set to the limit (``dx_limit``, ``W = 0``), and the step is recomputed
for the others.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import pinocchio as pin
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation as ScipyRotation

from stridelab.conventions import Mask, Points, Rotation, Rotations, Vector3
from stridelab.reachability.kinematics.leg_ik import revolute_axis
from stridelab.reachability.kinematics.rotations import multiply_rotations, rotate_about_axis, rotation_vectors
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.robot import Robot

Coordinates = Float[np.ndarray, "n v"]
Directions = Float[np.ndarray, "n r 3"]

BASE: Final = 6
YAW, PITCH, ROLL = 3, 4, 5
TOLERANCE: Final = 1e-6
"""Largest error (m, rad) of a converged problem."""
DAMPING: Final = 1e-7
MAX_STEP: Final = 0.4
"""Largest change of a coordinate (m, rad) in one step."""
MAX_STEPS: Final = 50
ABANDON_AFTER: Final = 25
ABANDON_ERROR: Final = 0.03
"""Error (m, rad) above which a problem is abandoned after ``ABANDON_AFTER`` steps."""
PULL: Final = 0.1
PULL_DECAY: Final = 0.8
PASSES: Final = 3
"""Number of times that a step is computed, each time with more coordinates at their limits."""


class Target(NamedTuple):
    """Target of one effector in every problem: position ``p_m`` and, for a surface, rotation ``R``."""

    p_m: Points
    R: Rotations | None = None


@dataclass(frozen=True, eq=False)
class Link:
    """The link of one coordinate: index of its parent, fixed placement, axis, mass and centre of mass (lever)."""

    parent: int
    p: Vector3
    R: Rotation
    axis: Vector3
    is_revolute: bool
    mass_kg: float
    lever_m: Vector3


@dataclass(frozen=True, eq=False)
class ContactFrame:
    """A contact frame: its link, the coordinates that move it, and its placement in the link."""

    link: int
    moved_by: Int[np.ndarray, "m"]
    p: Vector3
    R: Rotation


class TreePose(NamedTuple):
    """World positions and rotations of all links, and the axes of their coordinates."""

    p: Float[np.ndarray, "v n 3"]
    R: Float[np.ndarray, "v n 3 3"]
    axes: Float[np.ndarray, "v n 3"]


@dataclass(frozen=True, eq=False)
class BodyTree:
    """Kinematic tree of a robot. ``below`` ``(v, v)`` is 1 where the row's link descends from the column's or is it.

    ``lower`` and ``upper`` are the limits of the coordinates, infinite for the base.
    """

    links: tuple[Link, ...]
    ends: Mapping[str, ContactFrame]
    below: Float[np.ndarray, "v v"]
    lower: Float[np.ndarray, "v"]
    upper: Float[np.ndarray, "v"]
    R_root_trunk: Rotation

    @staticmethod
    def from_robot(robot: Robot) -> "BodyTree":
        """The tree of ``robot``. Raises ``NotEstimable`` (``measure-unavailable``) for joints that are not revolute."""
        model, frames = with_contact_frames(robot)
        none, flat = np.zeros(3), np.eye(3)
        base, R_trunk_root = model.inertias[1], robot.R_root_trunk.T
        links = [Link(k - 1, none, flat, flat[k], False, 0.0, none) for k in range(3)]
        links += [Link(2 + k, none, flat, flat[2 - k], True, 0.0, none) for k in range(2)]
        links.append(Link(4, none, flat, flat[0], True, float(base.mass), R_trunk_root @ base.lever))
        number = {1: ROLL} | {j: BASE + j - 2 for j in range(2, model.njoints)}
        # children of the root are expressed in the trunk's axes
        R_by_joint = {1: R_trunk_root}
        links += [_read_link(model, j, number[model.parents[j]], R_by_joint) for j in range(2, model.njoints)]
        below = np.eye(len(links))
        for k, link in enumerate(links):
            if link.parent >= 0:
                below[k] += below[link.parent]
        ends = {}
        for name, index in frames.items():
            frame = model.frames[index]
            k = number[frame.parentJoint]
            T, R_seen = frame.placement, R_by_joint.get(frame.parentJoint, flat)
            ends[name] = ContactFrame(k, np.flatnonzero(below[k]), R_seen @ T.translation, R_seen @ T.rotation)
        free = np.full(BASE, np.inf)
        lower, upper = model.lowerPositionLimit[7:], model.upperPositionLimit[7:]
        R = robot.R_root_trunk
        return BodyTree(tuple(links), ends, below, np.r_[-free, lower], np.r_[free, upper], R)

    def forward_kinematics(self, x: Coordinates) -> TreePose:
        """Forward kinematics."""
        n, v = len(x), len(self.links)
        p, axes, R = np.empty((v, n, 3)), np.empty((v, n, 3)), np.empty((v, n, 3, 3))
        p_world, R_world = np.zeros((n, 3)), np.broadcast_to(np.eye(3), (n, 3, 3))
        for k, link in enumerate(self.links):
            p_parent, R_parent = (p_world, R_world) if link.parent < 0 else (p[link.parent], R[link.parent])
            R_fixed = multiply_rotations(R_parent, link.R)
            p[k] = p_parent + R_parent @ link.p
            axes[k] = R_fixed @ link.axis
            if link.is_revolute:
                R[k] = rotate_about_axis(R_fixed, link.axis, x[:, k])
            else:
                R[k] = R_fixed
                p[k] += axes[k] * x[:, k, None]
        return TreePose(p, R, axes)

    def com_and_jacobian(self, pose: TreePose) -> tuple[Points, Float[np.ndarray, "n 3 v"]]:
        """The CoM and its Jacobian."""
        masses = np.array([link.mass_kg for link in self.links])
        levers = np.array([link.lever_m for link in self.links])
        moments = masses[:, None, None] * (pose.p + np.einsum("vnab,vb->vna", pose.R, levers))
        mass_below_kg = self.below.T @ masses
        moments_below = np.tensordot(self.below.T, moments, axes=1)
        arms = moments_below - mass_below_kg[:, None, None] * pose.p
        turns = np.array([link.is_revolute for link in self.links])[:, None, None]
        columns = np.where(turns, np.cross(pose.axes, arms), mass_below_kg[:, None, None] * pose.axes) / masses.sum()
        return moments.sum(axis=0) / masses.sum(), columns.transpose(1, 2, 0)

    def contact_frame_pose(self, name: str, pose: TreePose) -> tuple[Points, Rotations]:
        """Position and rotation of an effector's contact frame."""
        end = self.ends[name]
        return pose.p[end.link] + pose.R[end.link] @ end.p, multiply_rotations(pose.R[end.link], end.R)

    def solve(
        self,
        targets: Mapping[str, Target],
        directions: Directions,
        com_m: Float[np.ndarray, "n r"],
        start: Coordinates,
        limits: tuple[Coordinates, Coordinates],
        posture: Coordinates,
    ) -> tuple[Coordinates, Mask]:
        """Solve for every effector at its target and ``directions @ c = com_m``; return ``x`` and which converged."""
        x = np.clip(start, *limits)
        solved = np.zeros(len(x), dtype=bool)
        active = np.arange(len(x))
        for step in range(MAX_STEPS):
            e, J = self._stacked_errors(targets, directions, com_m, x[active], active)
            worst = np.abs(e).max(axis=1)
            solved[active] = worst < TOLERANCE
            going = (worst >= TOLERANCE) & ((worst < ABANDON_ERROR) | (step < ABANDON_AFTER))
            active, e, J = active[going], e[going], J[going]
            if not len(active):
                break
            low, high = limits[0][active], limits[1][active]
            x[active] = _step_within_limits(
                x[active], e, J, low, high, PULL * PULL_DECAY**step * (posture[active] - x[active])
            )
        return x, solved

    def to_configurations(self, x: Coordinates) -> Float[np.ndarray, "n nq"]:
        """Convert coordinates to configurations of the robot's model."""
        R_root = ScipyRotation.from_euler("ZYX", x[:, YAW : ROLL + 1]) * ScipyRotation.from_matrix(self.R_root_trunk.T)
        return np.hstack([x[:, :3], R_root.as_quat(), x[:, BASE:]])

    def to_coordinates(self, q: Float[np.ndarray, "n nq"]) -> Coordinates:
        """Convert configurations to coordinates."""
        R_trunk = ScipyRotation.from_quat(q[:, 3:7]) * ScipyRotation.from_matrix(self.R_root_trunk)
        return np.hstack([q[:, :3], R_trunk.as_euler("ZYX"), q[:, 7:]])

    def _stacked_errors(
        self,
        targets: Mapping[str, Target],
        directions: Directions,
        com_m: Float[np.ndarray, "n r"],
        x: Float[np.ndarray, "m v"],
        indices: Int[np.ndarray, "m"],
    ) -> tuple[Float[np.ndarray, "m e"], Float[np.ndarray, "m e v"]]:
        """Stacked errors of the problems ``indices`` and their Jacobian."""
        at = self.forward_kinematics(x)
        c, J_com = self.com_and_jacobian(at)
        errors = [com_m[indices] - (directions[indices] @ c[..., None])[..., 0]]
        rows = [directions[indices] @ J_com]
        turns = np.array([link.is_revolute for link in self.links])
        for name, target in targets.items():
            p, R = self.contact_frame_pose(name, at)
            columns = self.ends[name].moved_by
            axes = at.axes[columns]
            J = np.zeros((len(x), 6, len(self.links)))
            revolute = turns[columns][:, None, None]
            J[:, :3, columns] = np.where(revolute, np.cross(axes, p - at.p[columns]), axes).transpose(1, 2, 0)
            errors.append(target.p_m[indices] - p)
            if target.R is None:
                rows.append(J[:, :3])
                continue
            J[:, 3:, columns] = np.where(revolute, axes, 0.0).transpose(1, 2, 0)
            errors.append(rotation_vectors(target.R[indices] @ R.swapaxes(1, 2)))
            rows.append(J)
        return np.hstack(errors), np.concatenate(rows, axis=1)


def _step_within_limits(
    x: Coordinates,
    e: Float[np.ndarray, "n e"],
    J: Float[np.ndarray, "n e v"],
    low: Coordinates,
    high: Coordinates,
    pull: Coordinates,
) -> Coordinates:
    """``x + dx`` within the limits."""
    min_step, max_step = np.maximum(low - x, -MAX_STEP), np.minimum(high - x, MAX_STEP)
    d_0, free = pull, np.ones(x.shape, dtype=bool)
    for _ in range(PASSES):
        JW = J * free[:, None, :]
        H = JW @ JW.swapaxes(1, 2) + DAMPING * np.eye(J.shape[1])
        missing = e - (J @ d_0[..., None])[..., 0]
        dx = d_0 + (JW.swapaxes(1, 2) @ np.linalg.solve(H, missing[..., None]))[..., 0]
        out = free & ((dx < min_step) | (dx > max_step))
        d_0 = np.where(out, np.clip(dx, min_step, max_step), d_0)
        free &= ~out
    return np.asarray(np.clip(x + np.clip(dx, min_step, max_step), low, high))


def _read_link(model: pin.Model, j: int, parent: int, R_by_joint: Mapping[int, Rotation]) -> Link:
    at, inertia = model.jointPlacements[j], model.inertias[j]
    R_parent = R_by_joint.get(model.parents[j], np.eye(3))
    return Link(
        parent,
        R_parent @ at.translation,
        R_parent @ at.rotation,
        revolute_axis(model, j, pin.neutral(model)),
        True,
        float(inertia.mass),
        np.array(inertia.lever),
    )
