"""Placement windows: how far a contact may move on its surface along x and y of its own frame.

The requested window is reduced until the contact stays on its face (or the rail's line) and clear of every box that
rises beside it. With d the displacement each of these is a half-plane ``n d <= b`` that holds at d = 0; the sides of
the window that violate it shrink proportionally, which is exact for parallel axes.
"""

from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.contacts.sequence import Contact
from stridelab.contacts.terrain import Box, ContactArea, Terrain, contact_area, face_towards
from stridelab.conventions import Points

MIN_OBSTACLE_HEIGHT_M: Final = 0.01
"""Boxes that rise more than this above the contact are obstacles; lower ones are ignored."""
COSINE_TOLERANCE: Final = 1e-9
"""Cosines up to this count as zero."""

Window = Float[np.ndarray, "2"]


def placement_window_m(
    contact: Contact, points_m: Points, terrain: Terrain, reach_m: tuple[float, float]
) -> tuple[Window, Window]:
    """Lower and upper displacement bounds; both 0 if the contact's surface is not in the terrain.

    ``points_m`` ``(k, 3)`` are the corners of the contact in its frame.
    """
    own = next((surface for surface in terrain.surfaces if surface.name == contact.surface), None)
    if own is None:
        return np.zeros(2), np.zeros(2)
    face = face_towards(own, contact.placement.rotation[:, 2]) if isinstance(own, Box) else contact_area(own)
    axes, corners_m = contact.placement.rotation[:, :2], contact.placement.act(points_m)
    planes = _face_edges(face, axes, corners_m)
    for box in terrain.boxes:
        if box is not own:
            planes += _obstacle_side(box, face, axes, corners_m)
    lower, upper = -np.array(reach_m), np.array(reach_m)
    for n, b in planes:
        n = np.where(np.abs(n) > COSINE_TOLERANCE, n, 0.0)
        farthest = float(np.maximum(n * lower, n * upper).sum())
        if farthest > b:
            share = max(b, 0.0) / farthest
            upper = np.where(n > 0.0, share * upper, upper)
            lower = np.where(n < 0.0, share * lower, lower)
    return lower, upper


HalfPlane = tuple[Float[np.ndarray, "2"], float]


def _face_edges(face: ContactArea, axes: Float[np.ndarray, "3 2"], corners_m: Points) -> list[HalfPlane]:
    """Half-planes of the four edges of the face."""
    local, directions = (corners_m - face.center_m) @ face.frame[:, :2], face.frame[:, :2].T @ axes
    half_planes = []
    for i in range(2):
        half_planes.append((directions[i], float(face.half_m[i] - local[:, i].max())))
        half_planes.append((-directions[i], float(face.half_m[i] + local[:, i].min())))
    return half_planes


def _obstacle_side(box: Box, face: ContactArea, axes: Float[np.ndarray, "3 2"], corners_m: Points) -> list[HalfPlane]:
    """Half-plane of the box side farthest from the contact; empty if the box does not rise above the contact."""
    R, half = box.placement.rotation, box.size_m / 2
    top = (box.placement.position_m - corners_m.mean(axis=0)) @ face.normal + np.abs(face.normal @ R) @ half
    if top <= MIN_OBSTACLE_HEIGHT_M:
        return []
    local, directions = (corners_m - box.placement.position_m) @ R, R.T @ axes
    sides = [(-directions[i], float(local[:, i].min() - half[i])) for i in range(3)]
    sides += [(directions[i], float(-half[i] - local[:, i].max())) for i in range(3)]
    return [max(sides, key=lambda side: side[1])]
