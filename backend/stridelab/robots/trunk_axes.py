"""Forward, left and up axes of the trunk, estimated from the reference posture.

Descriptions differ in the axes of their root link: that of iCub points backwards. The up axis is the mean of the sole
normals, the forward axis the mean of the sole x axes, made horizontal:

    z ~ sum_i n_i ,    x ~ sum_i x_i - (z' sum_i x_i) z ,    y = z x x

The result is rounded to the nearest of the 24 rotations that map coordinate axes to coordinate axes if that is within
``MAX_LEAN_DEG``: a link that leans in the reference posture keeps its own axes.
"""

from collections.abc import Mapping
from itertools import permutations, product
from typing import Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float
from scipy.spatial.transform import Rotation as ScipyRotation

from stridelab.conventions import Rotation
from stridelab.robots.robot import Effector

MAX_LEAN_DEG: Final = 20.0
"""Largest rotation of a link in the reference posture that is rounded to coordinate axes."""
MIN_MEAN_LENGTH: Final = 0.5
"""Minimum length of the mean normal and of the mean x axis of the soles for a defined direction."""
_SIGNED: Final = [
    np.array(signs)[:, None] * np.eye(3)[list(order)]
    for order in permutations(range(3))
    for signs in product((1, -1), repeat=3)
]
_AXES: Final = np.array([R for R in _SIGNED if np.linalg.det(R) > 0.0])


def level_axes(model: pin.Model, q: Float[np.ndarray, "nq"], effectors: Mapping[str, Effector]) -> Rotation:
    """Forward, left and up axes (columns) defined by the soles at ``q``.

    Raises ``ValueError`` for soles whose normals or x axes point away from each other.
    """
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    soles = [effector for effector in effectors.values() if effector.kind == "surface"]
    R = [data.oMf[model.getFrameId(sole.frame)].rotation @ sole.T_frame_contact.rotation for sole in soles]
    x, _, z = np.mean(R, axis=0).T
    up = z / max(np.linalg.norm(z), 1e-9)
    forward = x - (up @ x) * up
    if np.linalg.norm(z) < MIN_MEAN_LENGTH:
        raise ValueError("the z axes of the soles' contact frames point away from each other in the reference posture")
    if np.linalg.norm(forward) < MIN_MEAN_LENGTH:
        raise ValueError("the x axes of the soles' contact frames point away from each other in the reference posture")
    forward /= np.linalg.norm(forward)
    return round_to_axes(np.column_stack([forward, np.cross(up, forward), up]))


def round_to_axes(R: Rotation) -> Rotation:
    """The nearest rotation that maps coordinate axes to coordinate axes, or ``R`` if none is near."""
    cosines = (np.einsum("kij,ij->k", _AXES, R) - 1.0) / 2.0
    nearest = int(np.argmax(cosines))
    return np.asarray(_AXES[nearest] if cosines[nearest] >= np.cos(np.radians(MAX_LEAN_DEG)) else R)


def align_base(q: Float[np.ndarray, "nq"], axes: Rotation) -> Float[np.ndarray, "nq"]:
    """``q`` with its base rotated so that ``axes`` become the world axes; the base position is unchanged."""
    turned = q.copy()
    if not np.array_equal(axes, np.eye(3)):  # avoid rounding in quaternions that are already right
        turned[3:7] = (ScipyRotation.from_matrix(axes.T) * ScipyRotation.from_quat(q[3:7])).as_quat()
    return turned
