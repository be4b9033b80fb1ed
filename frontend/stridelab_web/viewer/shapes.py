"""Small triangle meshes: unit cylinder, cone, and the band around the path of the centre of mass."""

import numpy as np

SIDES = 10
BAND_SIDES = 12
Mesh = tuple[np.ndarray, np.ndarray]
"""Vertices ``(n, 3)`` and faces ``(m, 3)``."""


def cylinder(radius_m: float) -> Mesh:
    """From the origin to (0, 0, 1): scaled along z it is a stick of any length."""
    ring = _ring(SIDES)
    low = np.column_stack([radius_m * ring, np.zeros(SIDES)])
    vertices = np.concatenate([low, low + np.array([0, 0, 1])])
    return vertices.astype(np.float32), _tube_faces(2, SIDES)


def cone(radius_m: float, height_m: float) -> Mesh:
    """Tip in the origin, base at (0, 0, -height): the head of an arrow."""
    base = np.column_stack([radius_m * _ring(SIDES), np.full(SIDES, -height_m)])
    vertices = np.concatenate([base, [[0, 0, 0], [0, 0, -height_m]]])
    k = np.arange(SIDES)
    after = (k + 1) % SIDES
    sides = np.column_stack([k, after, np.full(SIDES, SIDES)])
    bottom = np.column_stack([after, k, np.full(SIDES, SIDES + 1)])
    return vertices.astype(np.float32), np.concatenate([sides, bottom]).astype(np.uint32)


def band(path_m: np.ndarray, radius_m: np.ndarray, direction: np.ndarray) -> Mesh:
    """Tube around ``path_m`` ``(n, 3)`` with semi-axes ``radius_m`` ``(n, 3)`` per axis, seen along ``direction``.

    The cross-section is perpendicular to ``direction`` (horizontal, unit), the same for all samples: a path that
    stands still has no direction of its own.
    """
    lateral = np.array([-direction[1], direction[0], 0.0])
    up = np.array([0.0, 0.0, 1.0])
    width = np.sqrt((radius_m**2) @ (lateral**2))[:, None, None]
    height = radius_m[:, 2][:, None, None]
    ring = _ring(BAND_SIDES)
    offsets = width * ring[None, :, :1] * lateral + height * ring[None, :, 1:] * up
    vertices = (path_m[:, None, :] + offsets).reshape(-1, 3)
    return vertices.astype(np.float32), _tube_faces(len(path_m), BAND_SIDES)


def _ring(sides: int) -> np.ndarray:
    angle = 2 * np.pi * np.arange(sides) / sides
    return np.column_stack([np.cos(angle), np.sin(angle)])


def _tube_faces(rings: int, sides: int) -> np.ndarray:
    k = np.arange(sides)
    after = (k + 1) % sides
    quad = np.concatenate([np.column_stack([k, after, k + sides]), np.column_stack([after, after + sides, k + sides])])
    return np.concatenate([quad + ring * sides for ring in range(rings - 1)]).astype(np.uint32)
