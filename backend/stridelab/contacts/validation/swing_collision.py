"""Collision checks of swings with the boxes of the terrain."""

from collections.abc import Iterator
from typing import Final

import numpy as np

from stridelab.contacts.swing import SwingCurve, required_rise_m
from stridelab.contacts.terrain import Terrain
from stridelab.contacts.terrain_geometry import depth_in_box_m
from stridelab.contacts.validation.surface_contact import Stance, SurfaceContact, outline_points_m
from stridelab.conventions import Points, Series

SHARES: Final[Series] = np.linspace(0.0, 1.0, 25)
"""Shares of a swing at which it is checked."""
DEPTH_TOLERANCE_M: Final = 0.003
"""Depth inside a box up to which a path is accepted."""


def find_swings(stances: tuple[Stance, ...]) -> Iterator[tuple[int, SurfaceContact, SurfaceContact]]:
    """All swings: first phase, contact at lift-off and contact at landing."""
    last: dict[str, tuple[int, SurfaceContact]] = {}
    for k, stance in enumerate(stances):
        for name, touch in stance.items():
            if name in last and last[name][0] < k - 1:
                yield last[name][0] + 1, last[name][1], touch
            last[name] = (k, touch)


def swing_collisions(stances: tuple[Stance, ...], terrain: Terrain) -> Iterator[tuple[int, str, str, float]]:
    """Swings through boxes: phase, effector, name of the box, and depth (m) inside it."""
    all_swings = list(find_swings(stances))
    if not all_swings:
        return
    paths = [_swept_points(start, end, terrain) for _, start, end in all_swings]
    low, high = (np.array([extreme(path, axis=0) for path in paths]) for extreme in (np.min, np.max))
    for box in terrain.boxes:
        half = np.abs(box.placement.rotation) @ box.size_m / 2
        near = (low < box.placement.position_m + half).all(axis=1) & (high > box.placement.position_m - half).all(
            axis=1
        )
        for i in np.flatnonzero(near):
            depth = float(depth_in_box_m(box, paths[i]).max())
            if depth > DEPTH_TOLERANCE_M:
                phase, start, _ = all_swings[i]
                yield phase, start.effector, box.name, depth


def _swept_points(start: SurfaceContact, end: SurfaceContact, terrain: Terrain) -> Points:
    """Outline points of the effector along its swing."""
    sole = outline_points_m(start.shape)
    rises = required_rise_m(start.placement, end.placement, sole, terrain)
    curve = SwingCurve(start.placement, end.placement, 1.0, start.shape.kind, rise_m=rises)
    positions, rotations = curve.poses_at(SHARES)
    points = np.einsum("tij,kj->tki", rotations, sole) + positions[:, np.newaxis]
    return np.asarray(points.reshape(-1, 3))
