"""Walking frame (along, lateral, vertical): axes for reporting errors independently of the walking direction."""

import numpy as np

from stridelab.conventions import Points, Rotation

WALKING_M_S = 0.05
"""Mean speed below which the body counts as staying in place, and the axes are those of the world."""


def walk_frame(velocity_m_s: Points) -> Rotation:
    """Unit vectors along the walk, to its left and up, as rows; ``track @ frame.T`` is in these axes."""
    mean = np.nanmean(velocity_m_s, axis=0) * [1.0, 1.0, 0.0]
    speed = float(np.linalg.norm(mean))
    along = mean / speed if speed > WALKING_M_S else np.array([1.0, 0.0, 0.0])
    up = np.array([0.0, 0.0, 1.0])
    return np.array([along, np.cross(up, along), up])
