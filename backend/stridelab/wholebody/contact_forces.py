"""Contact forces of one effector: how they act on the joints and the pyramid that they must stay in.

A surface carries one force per corner of its rectangle, a point carries one. The pyramid

    |f_x|, |f_y| <= mu / sqrt(2) f_n ,    f_n >= 0

lies inside the exact cone ``|f_t| <= mu f_n``: its edges touch it. Forces are in world axes, x, y and n those of the
contact frame.
"""

import numpy as np
from jaxtyping import Float

from stridelab.contacts.sequence import Contact
from stridelab.conventions import Points
from stridelab.wholebody.hierarchy import Inequalities
from stridelab.wholebody.rigid_body import FrameState

_INSIDE_N = 1e-3
"""Distance from the pyramid's faces, so that the solver's tolerance cannot leave the cone."""


def pyramid(contact: Contact, points: int) -> Inequalities:
    """Five rows per contact point on the ``3 points`` components of its forces."""
    x, y, n = contact.placement.rotation.T
    mu = contact.friction / np.sqrt(2.0)
    one = np.array([x - mu * n, -x - mu * n, y - mu * n, -y - mu * n, -n])
    upper = np.full(5 * points, -_INSIDE_N)
    return Inequalities(np.kron(np.eye(points), one), np.full(5 * points, -np.inf), upper)


def force_jacobian(frame: FrameState, points_m: Points) -> Float[np.ndarray, "m nv"]:
    """Jacobian ``(3 k, nv)`` of contact points given in the contact frame: ``J_p = J_v - [R p]x J_w``."""
    x, y, z = frame.rotation @ points_m.T
    lever = np.zeros((len(points_m), 3, 6))
    lever[:, 0, 0] = lever[:, 1, 1] = lever[:, 2, 2] = 1.0
    lever[:, 0, 4], lever[:, 0, 5] = z, -y
    lever[:, 1, 3], lever[:, 1, 5] = -z, x
    lever[:, 2, 3], lever[:, 2, 4] = y, -x
    return np.asarray(lever.reshape(-1, 6) @ frame.J)
