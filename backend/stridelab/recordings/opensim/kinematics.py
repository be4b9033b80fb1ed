"""Forward kinematics of a body model: positions of its bodies and of their centres of mass from its coordinates."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from stridelab.conventions import Points, Rotations, Series, Vector3
from stridelab.recordings.opensim.body_model import GROUND, BodyModel, JointAxis


@dataclass(frozen=True)
class BodyPose:
    """Rotation and origin of a body in the frame of the ground, per sample."""

    R: Rotations
    p: Points

    def point_at(self, local_m: Vector3) -> Points:
        """Position of a point of the body."""
        return np.asarray(self.p + self.R @ local_m)


def complete_coordinates(model: BodyModel, given: Mapping[str, Series], n: int) -> dict[str, Series]:
    """Values of all coordinates: the given ones, those coupled to them, and the defaults of the others."""
    q = {name: np.full(n, coordinate.default) for name, coordinate in model.coordinates.items()} | dict(given)
    for coupling in model.couplings:
        if coupling.coordinate not in given:
            q[coupling.coordinate] = _value(coupling.axis, q, n)
    return q


def body_poses(model: BodyModel, q: Mapping[str, Series], n: int) -> dict[str, BodyPose]:
    """Pose of every body for ``n`` samples; ``q`` holds the values of all coordinates."""
    poses = {GROUND: BodyPose(np.broadcast_to(np.eye(3), (n, 3, 3)), np.zeros((n, 3)))}
    for joint in model.joints:
        parent = poses[joint.parent]
        R_FM = np.broadcast_to(np.eye(3), (n, 3, 3))
        for axis in joint.rotations:
            R_FM = R_FM @ rotations_about(axis.axis, _value(axis, q, n))
        p_FM = sum((_value(axis, q, n)[:, None] * axis.axis for axis in joint.translations), np.zeros((n, 3)))
        R = parent.R @ joint.in_parent.R @ R_FM @ joint.in_child.R.T
        M_m = parent.point_at(joint.in_parent.p) + np.einsum("nij,nj->ni", parent.R @ joint.in_parent.R, p_FM)
        poses[joint.child] = BodyPose(R, M_m - R @ joint.in_child.p)
    del poses[GROUND]
    return poses


def rotations_about(axis: Vector3, angle_rad: Series) -> Rotations:
    """Rotations about a unit vector: cos a I + sin a [axis]x + (1 - cos a) axis axis^T."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    c, s = np.cos(angle_rad)[:, None, None], np.sin(angle_rad)[:, None, None]
    return np.asarray(c * np.eye(3) + s * cross + (1.0 - c) * np.outer(axis, axis))


def _value(axis: JointAxis, q: Mapping[str, Series], n: int) -> Series:
    return np.broadcast_to(axis.function([q[name] for name in axis.coordinates]), (n,))
