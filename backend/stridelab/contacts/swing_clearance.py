"""How high a sole has to rise to pass over what lies between its two places.

The sole is carried along the straight line from one place to the other, turning as it goes. With the heights of its
centre ``z_0, z_1``, the highest top ``h`` of a box below it and the lowest point of the turning sole ``d`` below its
centre, its centre rises above ``max(z_0, z_1)`` by

    max(FOOT_CLEARANCE_M, h - max(z_0, z_1) + d + MARGIN_M)

so that at the apex all of the sole clears everything below its way by ``MARGIN_M``. What stands more than
``STEP_OVER_M`` above both places is not stepped over: that it is in the way is for the judge to say.
"""

from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation as ScipyRotation

from stridelab.contacts.surfaces import vertical_span_m
from stridelab.contacts.terrain import Terrain
from stridelab.conventions import Points
from stridelab.dynamics.placement import Placement

FOOT_CLEARANCE_M: Final = 0.06
"""What a level sole rises where nothing lies in between."""
MARGIN_M: Final = 0.03
"""Between a sole and the highest thing below its way."""
STEP_OVER_M: Final = 0.25
"""Highest obstacle that a foot is lifted over."""
SHARES: Final = np.linspace(0.0, 1.0, 25)


def rise_m(start: Placement, end: Placement, sole_m: Points, terrain: Terrain) -> float:
    """How far the centre of a sole rises above the higher of its two places.

    ``sole_m`` ``(n, 3)`` are points of the sole in its contact frame.
    """
    turn = ScipyRotation.from_matrix(start.rotation.T @ end.rotation).as_rotvec()
    rotations = start.rotation @ ScipyRotation.from_rotvec(np.outer(SHARES, turn)).as_matrix()
    offsets = np.einsum("tij,kj->tki", rotations, sole_m)
    travel = np.outer(SHARES, end.position_m - start.position_m)
    points = (offsets + (start.position_m + travel)[:, np.newaxis]).reshape(-1, 3)
    high = max(float(start.position_m[2]), float(end.position_m[2]))
    low_m, high_m = terrain.box_bounds_m
    below = (low_m[:, :2] <= points[:, :2].max(axis=0)) & (high_m[:, :2] >= points[:, :2].min(axis=0))
    near = np.flatnonzero(below.all(axis=1) & (high_m[:, 2] > high) & (low_m[:, 2] <= high + STEP_OVER_M))
    top = max([high, *(_top_m(*vertical_span_m(terrain.boxes[i], points), high) for i in near)])
    hangs = max(0.0, -float(offsets[..., 2].min()))
    return max(FOOT_CLEARANCE_M, top - high + hangs + MARGIN_M)


def _top_m(low: np.ndarray, top: np.ndarray, high_m: float) -> float:
    """The highest top that is no higher than what a foot is lifted over; boxes overhead do not count."""
    counts = (top <= high_m + STEP_OVER_M) & (low <= high_m + STEP_OVER_M)
    return float(top[counts].max()) if counts.any() else -np.inf
