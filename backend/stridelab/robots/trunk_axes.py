"""Which way a link looks and where its top is: axes x ahead, y left, z up, found in the reference posture.

Descriptions differ in the axes of their root link: that of iCub looks backwards. The soles say what is up (the mean
of their normals) and ahead (the mean of their x axes, made horizontal):

    z ~ sum_i n_i ,    x ~ sum_i x_i - (z' sum_i x_i) z ,    y = z x x

A link that leans in the reference posture still has its own axes: of the 24 rotations that carry coordinate axes on
coordinate axes the nearest is taken where it is nearer than ``LEAN_DEG``.
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

LEAN_DEG: Final = 20.0
"""So far a link may lean or turn in the reference posture."""
LEAST_SUM: Final = 0.5
"""Least length of the mean normal and of the mean x axis of the soles: below it they say nothing."""
_SIGNED: Final = [
    np.array(signs)[:, None] * np.eye(3)[list(order)]
    for order in permutations(range(3))
    for signs in product((1, -1), repeat=3)
]
_AXES: Final = np.array([R for R in _SIGNED if np.linalg.det(R) > 0.0])


def level_axes(model: pin.Model, q: Float[np.ndarray, "nq"], effectors: Mapping[str, Effector]) -> Rotation:
    """Axes ahead, left and up of the world in which the soles stand at ``q``, as columns.

    Raises ``ValueError`` for soles whose normals or x axes point away from each other.
    """
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    soles = [effector for effector in effectors.values() if effector.kind == "surface"]
    R = [data.oMf[model.getFrameId(sole.frame)].rotation @ sole.T_frame_contact.rotation for sole in soles]
    x, _, z = np.mean(R, axis=0).T
    up = z / max(np.linalg.norm(z), 1e-9)
    ahead = x - (up @ x) * up
    if np.linalg.norm(z) < LEAST_SUM:
        raise ValueError("the z axes of the soles' contact frames point away from each other in the reference posture")
    if np.linalg.norm(ahead) < LEAST_SUM:
        raise ValueError("the x axes of the soles' contact frames point away from each other in the reference posture")
    ahead /= np.linalg.norm(ahead)
    return own_axes(np.column_stack([ahead, np.cross(up, ahead), up]))


def own_axes(R: Rotation) -> Rotation:
    """The rotation of coordinate axes on coordinate axes that is nearest to ``R``, or ``R`` where none is near."""
    cosines = (np.einsum("kij,ij->k", _AXES, R) - 1.0) / 2.0
    nearest = int(np.argmax(cosines))
    return np.asarray(_AXES[nearest] if cosines[nearest] >= np.cos(np.radians(LEAN_DEG)) else R)


def faced(q: Float[np.ndarray, "nq"], axes: Rotation) -> Float[np.ndarray, "nq"]:
    """``q`` with its base turned so that the ``axes`` of its world become those of ours; its place is left as it is."""
    turned = q.copy()
    if not np.array_equal(axes, np.eye(3)):  # or rounding would change what is already there
        turned[3:7] = (ScipyRotation.from_matrix(axes.T) * ScipyRotation.from_quat(q[3:7])).as_quat()
    return turned
