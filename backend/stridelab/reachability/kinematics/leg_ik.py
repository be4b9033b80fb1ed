"""Batched forward and inverse kinematics of one leg.

    T_base_contact(q) = prod_j A_j exp([a_j] q_j)  .  E

with ``A_j`` the fixed placement of joint ``j`` in its parent, ``a_j`` its axis and ``E`` the contact frame in the
last joint. The inverse takes damped Gauss-Newton steps (Nakamura and Hanafusa 1986) within the joint limits:

    q <- clip(q + (J^T J + d I)^-1 J^T e),     e = (p* - p, log(R* R^T))
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.conventions import Mask, Points, Rotation, Rotations, Series, Vector3
from stridelab.errors import Fault, NotEstimable
from stridelab.reachability.kinematics.rotations import multiply_rotations, rotate_about_axis, rotation_vectors

Angles = Float[np.ndarray, "n j"]

TOLERANCE: Final = 1e-6
"""Largest error (m, rad) of a converged leg."""
DAMPING: Final = 1e-6
STEP_RAD: Final = 0.6
MAX_STEPS: Final = 25
ABANDON_AFTER: Final = 12
"""Number of steps after which a leg with an error above ``ABANDON_ERROR`` is abandoned."""
ABANDON_ERROR: Final = 0.3


@dataclass(frozen=True, eq=False)
class Joint:
    """A revolute joint: index in ``q``, limits, fixed placement and axis."""

    index: int
    lower_rad: float
    upper_rad: float
    p: Vector3
    R: Rotation
    axis: Vector3


@dataclass(frozen=True, eq=False)
class LegChain:
    """The joints between the base and one contact frame."""

    joints: tuple[Joint, ...]
    p_end: Vector3
    R_end: Rotation

    @staticmethod
    def from_frame(model: pin.Model, frame: int) -> "LegChain":
        """The chain down to the operational frame ``frame`` of ``model``, whose first joint is the floating base.

        Raises ``NotEstimable`` (``measure-unavailable``) for joints that are not revolute.
        """
        end = model.frames[frame]
        neutral = pin.neutral(model)
        joints = tuple(_read_joint(model, j, neutral) for j in list(model.supports[end.parentJoint])[2:])
        return LegChain(joints, np.array(end.placement.translation), np.array(end.placement.rotation))

    @property
    def indices_in_q(self) -> tuple[int, ...]:
        """Indices of the chain's angles in ``q``."""
        return tuple(joint.index for joint in self.joints)

    @property
    def lower_rad(self) -> Float[np.ndarray, "j"]:
        """Lower limits."""
        return np.array([joint.lower_rad for joint in self.joints])

    @property
    def upper_rad(self) -> Float[np.ndarray, "j"]:
        """Upper limits."""
        return np.array([joint.upper_rad for joint in self.joints])

    def draw_angles(self, n: int, rng: np.random.Generator) -> Angles:
        """Angles uniform within the limits."""
        return rng.uniform(self.lower_rad, self.upper_rad, (n, len(self.joints)))

    def contact_frame_pose(self, angles_rad: Angles) -> tuple[Points, Rotations]:
        """Position and rotation of the contact frame in the base's joint frame."""
        p, R, _, _ = self._forward_kinematics(angles_rad)
        return p, R

    def span_m(self, angles_rad: Angles, first: int, last: int) -> Series:
        """Distance between the origins of two joints of the chain (index from the base, negative from the end)."""
        _, _, origins, _ = self._forward_kinematics(angles_rad)
        return np.asarray(np.linalg.norm(origins[last] - origins[first], axis=1))

    def solve_angles(self, p_m: Points, R: Rotations | None, start_rad: Angles) -> tuple[Angles, Mask]:
        """Solve for angles that place the contact frame at ``(p_m, R)`` in the base; return them and which converged.

        Without ``R`` only the origin is placed, as for a hand on a rail.
        """
        angles, reached = start_rad.copy(), np.zeros(len(p_m), dtype=bool)
        active = np.arange(len(p_m))
        for step in range(MAX_STEPS):
            p, R_here, origins, axes = self._forward_kinematics(angles[active])
            e = p_m[active] - p
            if R is not None:
                e = np.hstack([e, rotation_vectors(R[active] @ R_here.swapaxes(1, 2))])
            error = np.abs(e).max(axis=1)
            reached[active] = error < TOLERANCE
            going = (error >= TOLERANCE) & ((error < ABANDON_ERROR) | (step < ABANDON_AFTER))
            active, e, p = active[going], e[going], p[going]
            if not len(active):
                break
            axes = axes[:, going]
            arms = np.cross(axes, p - origins[:, going])
            J = (arms if R is None else np.concatenate([arms, axes], axis=2)).transpose(1, 2, 0)
            H = J.swapaxes(1, 2) @ J + DAMPING * np.eye(len(self.joints))
            dq = np.linalg.solve(H, J.swapaxes(1, 2) @ e[..., None])[..., 0]
            angles[active] = np.clip(angles[active] + np.clip(dq, -STEP_RAD, STEP_RAD), self.lower_rad, self.upper_rad)
        return angles, reached

    def _forward_kinematics(
        self, angles_rad: Angles
    ) -> tuple[Points, Rotations, Float[np.ndarray, "j n 3"], Float[np.ndarray, "j n 3"]]:
        """The contact frame, and the origins and axes of the joints, in the base's joint frame."""
        n = len(angles_rad)
        R = np.broadcast_to(np.eye(3), (n, 3, 3))
        p = np.zeros((n, 3))
        origins, axes = np.empty((2, len(self.joints), n, 3))
        for k, (joint, angle) in enumerate(zip(self.joints, angles_rad.T, strict=True)):
            p = p + R @ joint.p
            R = multiply_rotations(R, joint.R)
            origins[k], axes[k] = p, R @ joint.axis
            R = rotate_about_axis(R, joint.axis, angle)
        return p + R @ self.p_end, multiply_rotations(R, self.R_end), origins, axes


def _read_joint(model: pin.Model, j: int, neutral: Float[np.ndarray, "nq"]) -> Joint:
    joint = model.joints[j]
    axis = revolute_axis(model, j, neutral)
    at = model.jointPlacements[j]
    return Joint(
        joint.idx_q,
        float(model.lowerPositionLimit[joint.idx_q]),
        float(model.upperPositionLimit[joint.idx_q]),
        np.array(at.translation),
        np.array(at.rotation),
        axis,
    )


def revolute_axis(model: pin.Model, j: int, neutral: Float[np.ndarray, "nq"]) -> Vector3:
    """Axis of joint ``j``. Raises ``NotEstimable`` (``measure-unavailable``) for a joint that is not revolute."""
    joint = model.joints[j]
    motion = joint.createData()
    joint.calc(motion, neutral)
    S = np.array(motion.S).reshape(6, -1)
    if joint.nq != 1 or np.abs(S[:3]).max() > 0.0:
        name = model.names[j]
        raise NotEstimable(
            "measure-unavailable",
            f"Stances require revolute joints; joint {name} is of another type.",
            [Fault("measure", f"joint {name} is not revolute")],
        )
    return np.array(S[3:, 0])
