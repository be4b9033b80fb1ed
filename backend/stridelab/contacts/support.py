"""What carries the robot: the soles of a phase, whether friction can hold them, and whether they overlap."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.optimize import nnls

from stridelab.contacts.point_contacts import PointContacts
from stridelab.contacts.touching import Stance, Touch

CONE_EDGES: Final = 16
"""Edges of the pyramid that stands in for a friction cone, from the inside."""
RESIDUAL: Final = 1e-6
"""Forces that miss the robot's weight by less than this share of it carry it."""


def soles(stance: Stance) -> list[Touch]:
    """The contacts of a phase that can carry the robot."""
    return [touch for touch in stance.values() if touch.shape.kind == "surface"]


def slipping(stance: Stance) -> Touch | None:
    """The steepest sole of a phase whose friction cones cannot carry a weight, None where they can.

    The weight ``e_z`` must be a sum of forces inside the cones of the soles; hands are too weak to count.
    """
    steep = [(steepness(touch), touch) for touch in soles(stance)]
    if not steep or min(angle for angle, _ in steep) <= 0.0:
        return None
    at = PointContacts.of([(touch.placement, None, touch.friction) for _, touch in steep])
    _, residual = nnls(at.forces(CONE_EDGES).reshape(-1, 3).T, np.array([0.0, 0.0, 1.0]))
    return None if residual < RESIDUAL else max(steep, key=lambda found: found[0])[1]


def steepness(touch: Touch) -> float:
    """Angle (rad) by which a contact is too steep to hold by friction alone; negative where it holds."""
    slope = np.arccos(np.clip(touch.placement.rotation[2, 2], -1.0, 1.0))
    return float(slope - np.arctan(touch.friction))


def overlap(one: Touch, other: Touch) -> bool:
    """Whether two soles lie in the same place: no edge of either separates their outlines (seen from above)."""
    if abs(one.placement.position_m[2] - other.placement.position_m[2]) > 0.05:
        return False
    first, second = one.corners_m[:, :2], other.corners_m[:, :2]
    edges = np.vstack([np.diff(first[:3], axis=0), np.diff(second[:3], axis=0)])
    for axis in edges[:, ::-1] * [1.0, -1.0]:
        a, b = first @ axis, second @ axis
        if a.max() <= b.min() or b.max() <= a.min():
            return False
    return True


def pairs(touches: Sequence[Touch]) -> list[tuple[Touch, Touch]]:
    """All pairs."""
    return [(a, b) for i, a in enumerate(touches) for b in touches[i + 1 :]]
