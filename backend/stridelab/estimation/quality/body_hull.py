"""Distance of a centre of mass outside the body: beyond the convex hull of its markers and joint centres.

A convex combination of points of a body lies in the convex hull of the body. The markers are on the skin, so their
hull covers the body except for its unmarked parts.
"""

from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull, QhullError

from stridelab.conventions import Points

MAX_FRAMES: Final = 60
"""Maximum number of evaluated frames: a body moves by 3 cm between them in a walk of 2 s."""

Clouds = Float[np.ndarray, "frames points 3"]


def distance_outside_m(com_m: Points, body_m: Clouds) -> Float[np.ndarray, " looked"]:
    """Distance of ``com_m`` (n x 3) outside the convex hull of ``body_m`` (n x points x 3, NaN where hidden).

    It is the largest distance beyond the plane of a face of the hull: 0 inside, and a lower bound near an edge. NaN if
    fewer than four points are visible or all are coplanar. Of long recordings ``MOST_FRAMES`` evenly spread frames are
    evaluated and returned.
    """
    frames = np.unique(np.linspace(0, len(com_m) - 1, min(MAX_FRAMES, len(com_m))).round().astype(int))
    return np.array([_distance_outside_m(com_m[i], body_m[i]) for i in frames])


def _distance_outside_m(point: Float[np.ndarray, "3"], cloud: Float[np.ndarray, "points 3"]) -> float:
    seen = cloud[np.isfinite(cloud).all(axis=1)]
    if len(seen) < 4 or not np.isfinite(point).all():
        return float("nan")
    try:
        faces = ConvexHull(seen).equations
    except QhullError:
        return float("nan")
    return max(0.0, float((faces[:, :3] @ point + faces[:, 3]).max()))
