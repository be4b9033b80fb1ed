"""Rigid placements (elements of SE(3)), and a fast cross product and norm of single vectors.

A placement ``T_world_foot = (R, p)`` maps coordinates in the foot's frame to world coordinates: ``x -> R x + p``.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation as ScipyRotation

from stridelab.conventions import Points, Rotation, Vector3


def cross(a: Vector3, b: Vector3) -> Vector3:
    """Cross product of two vectors; about 20 times faster than ``np.cross``."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def length_of(v: Vector3) -> float:
    """Euclidean norm of a vector, that of ``np.linalg.norm`` in every bit, without its checks."""
    return math.sqrt(float(v.dot(v)))


@dataclass(frozen=True, eq=False)
class Placement:
    """Position (m) and rotation matrix of a frame in another one."""

    position_m: Vector3
    rotation: Rotation

    @staticmethod
    def identity() -> "Placement":
        """Identity: zero translation, no rotation."""
        return Placement(np.zeros(3), np.eye(3))

    @staticmethod
    def from_wxyz(position_m: Sequence[float], wxyz: Sequence[float] = (1.0, 0.0, 0.0, 0.0)) -> "Placement":
        """Placement from a position in metres and a quaternion (w, x, y, z) of any positive norm.

        Raises ``ValueError`` for a zero quaternion.
        """
        w, x, y, z = map(float, wxyz)
        norm = math.sqrt(x * x + y * y + z * z + w * w)
        if norm == 0.0:
            raise ValueError("a quaternion of zero norm has no direction")
        w, x, y, z = w / norm, x / norm, y / norm, z / norm
        rotation = np.array(
            [
                [x * x - y * y - z * z + w * w, 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
                [2.0 * (x * y + z * w), -x * x + y * y - z * z + w * w, 2.0 * (y * z - x * w)],
                [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), -x * x - y * y + z * z + w * w],
            ]
        )
        return Placement(np.array(position_m, dtype=float), rotation)

    @property
    def wxyz(self) -> Float[np.ndarray, "4"]:
        """Unit quaternion (w, x, y, z) with w >= 0."""
        x, y, z, w = ScipyRotation.from_matrix(self.rotation).as_quat(canonical=True)
        return np.array([w, x, y, z])

    def act(self, points_m: Points) -> Points:
        """Transform ``points_m`` ``(n, 3)`` from this frame to the parent frame."""
        return np.asarray(points_m @ self.rotation.T + self.position_m)

    def inverse(self) -> "Placement":
        """Inverse placement: ``T_foot_world`` of ``T_world_foot``."""
        return Placement(-self.rotation.T @ self.position_m, self.rotation.T.copy())

    def __matmul__(self, other: "Placement") -> "Placement":
        """``T_world_foot @ T_foot_toe = T_world_toe``."""
        return Placement(self.rotation @ other.position_m + self.position_m, self.rotation @ other.rotation)
