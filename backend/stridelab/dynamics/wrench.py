"""Total contact wrench (2.5): force and moment on the body about a given point, with gravity pointing down.

Standing still the contact force is ``f = -m g = (0, 0, +9.81 m)``: the ground pushes the body up.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Points, Vector3

ContactPoints = Float[np.ndarray, "contacts n 3"]
"""One point, force or moment per contact and sample."""


@dataclass(frozen=True)
class Wrench:
    """Force and moment on the body, one row per sample; the moment is about the world origin unless transported."""

    force_n: Points
    moment_nm: Points


def total_wrench(position_m: ContactPoints, force_n: ContactPoints, moment_nm: ContactPoints) -> Wrench:
    """Sum of any number of contacts (2.5): ``f_c = sum f_i``, ``nu_c = sum p_i x f_i + nu_i``.

    ``moment_nm[i]`` is the moment that contact i exerts about its own point ``position_m[i]``. Without contacts
    (shape ``(0, n, 3)``, flight) the wrench is zero.
    """
    return Wrench(
        force_n=force_n.sum(axis=0),
        moment_nm=(np.cross(position_m, force_n) + moment_nm).sum(axis=0),
    )


def transport(wrench: Wrench, displacement_m: Points | Vector3) -> Wrench:
    """Express the wrench about a point displaced by ``displacement_m``: ``nu_P = nu_O - OP x f``.

    Transporting by p and then by q equals transporting by p + q.
    """
    return Wrench(
        force_n=wrench.force_n,
        moment_nm=wrench.moment_nm - np.cross(np.broadcast_to(displacement_m, wrench.force_n.shape), wrench.force_n),
    )
