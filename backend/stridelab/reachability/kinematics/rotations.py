"""Batched operations on rotation matrices."""

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation as ScipyRotation

from stridelab.conventions import Points, Rotation, Rotations, Series, Vector3


def rotate_about_axis(R: Rotations, axis: Vector3, angle_rad: Series) -> Rotations:
    """``R exp([a] angle)`` by Rodrigues' formula, with ``[a]`` the cross matrix of the unit vector ``axis``."""
    cross = np.array(pin.skew(axis))
    s, c = np.sin(angle_rad)[:, None, None], np.cos(angle_rad)[:, None, None]
    R_a = multiply_rotations(R, cross)
    return np.asarray(R + s * R_a + (1.0 - c) * multiply_rotations(R_a, cross))


def multiply_rotations(R: Rotations, right: Rotation) -> Rotations:
    """``R by``: one product of two long matrices, several times as fast as many small ones."""
    return np.asarray((R.reshape(-1, 3) @ right).reshape(-1, 3, 3))


def rotation_vectors(R: Rotations) -> Points:
    """``log R`` in radians; does not check that ``R`` are rotations."""
    if not len(R):
        return np.zeros((0, 3))
    return np.asarray(ScipyRotation.from_matrix(R, assume_valid=True).as_rotvec())
