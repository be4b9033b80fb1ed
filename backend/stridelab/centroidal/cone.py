"""The friction cone ``mu f_z >= |f_xy|`` from inside: forces as sums of rays that lie on it.

    f = V lambda,   lambda >= 0,   V = [ mu / sqrt(2) (+-1, +-1), 1 ]

spans the largest four-sided pyramid in the cone with faces along the contact's axes. Every such force satisfies the
exact cone; in the solver the cone becomes a set of bounds, without a single inequality row.
"""

import numpy as np
from jaxtyping import Float

N_RAYS = 4


def rays(friction: float) -> Float[np.ndarray, "3 4"]:
    """``V`` in the contact frame, one ray per column, normal component 1."""
    t = friction / np.sqrt(2.0)
    return np.array([[t, -t, -t, t], [t, t, -t, -t], [1.0, 1.0, 1.0, 1.0]])
