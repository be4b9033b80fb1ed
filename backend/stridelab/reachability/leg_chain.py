"""Forward kinematics of one leg for many configurations at once.

    T_base_contact(q) = prod_j A_j exp([a_j] q_j)  .  E

with ``A_j`` the fixed placement of joint ``j`` in its parent, ``a_j`` its axis and ``E`` the contact frame in the
last joint.
"""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.conventions import Points, Rotation, Series, Vector3
from stridelab.errors import Fault, NotEstimable

Rotations = Float[np.ndarray, "n 3 3"]


@dataclass(frozen=True, eq=False)
class Joint:
    """A revolute joint: its number in ``q``, its limits, its fixed placement, and its axis as a cross matrix."""

    index: int
    lower_rad: float
    upper_rad: float
    p: Vector3
    R: Rotation
    axis_cross: Rotation


@dataclass(frozen=True, eq=False)
class LegChain:
    """The joints between the base and one contact frame."""

    joints: tuple[Joint, ...]
    p_end: Vector3
    R_end: Rotation

    @staticmethod
    def of(model: pin.Model, frame: int) -> "LegChain":
        """The chain down to the operational frame ``frame`` of ``model``, whose first joint is the floating base.

        Raises ``NotEstimable`` (``measure-unavailable``) for joints that do not simply turn.
        """
        end = model.frames[frame]
        neutral = pin.neutral(model)
        joints = tuple(_joint(model, j, neutral) for j in list(model.supports[end.parentJoint])[2:])
        return LegChain(joints, np.array(end.placement.translation), np.array(end.placement.rotation))

    @property
    def columns(self) -> tuple[int, ...]:
        """Where the chain's angles stand in ``q``."""
        return tuple(joint.index for joint in self.joints)

    def draw(self, n: int, rng: np.random.Generator) -> Float[np.ndarray, "n j"]:
        """Angles uniform within the limits."""
        lower, upper = zip(*((joint.lower_rad, joint.upper_rad) for joint in self.joints), strict=True)
        return rng.uniform(lower, upper, (n, len(self.joints)))

    def placed(self, angles_rad: Float[np.ndarray, "n j"]) -> tuple[Points, Rotations]:
        """Position and rotation of the contact frame in the base's joint frame."""
        n = len(angles_rad)
        R = np.broadcast_to(np.eye(3), (n, 3, 3))
        p = np.zeros((n, 3))
        for joint, angle in zip(self.joints, angles_rad.T, strict=True):
            p = p + R @ joint.p
            R = R @ (joint.R @ _turned(joint.axis_cross, angle))
        return p + R @ self.p_end, np.asarray(R @ self.R_end)


def _turned(axis_cross: Rotation, angle_rad: Series) -> Rotations:
    """Rodrigues' formula."""
    s, c = np.sin(angle_rad)[:, None, None], np.cos(angle_rad)[:, None, None]
    return np.asarray(np.eye(3) + s * axis_cross + (1.0 - c) * (axis_cross @ axis_cross))


def _joint(model: pin.Model, j: int, neutral: Float[np.ndarray, "nq"]) -> Joint:
    joint = model.joints[j]
    motion = joint.createData()
    joint.calc(motion, neutral)
    S = np.array(motion.S).reshape(6, -1)
    if joint.nq != 1 or np.abs(S[:3]).max() > 0.0:
        name = model.names[j]
        raise NotEstimable(
            "measure-unavailable",
            f"Stances are drawn for legs of revolute joints; joint {name} is another one.",
            [Fault("measure", f"joint {name} does not simply turn")],
        )
    at = model.jointPlacements[j]
    return Joint(
        joint.idx_q,
        float(model.lowerPositionLimit[joint.idx_q]),
        float(model.upperPositionLimit[joint.idx_q]),
        np.array(at.translation),
        np.array(at.rotation),
        np.array(pin.skew(S[3:, 0])),
    )
