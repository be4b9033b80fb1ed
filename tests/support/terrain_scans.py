"""Generated scans of terrains: points at random on rectangles and bars, with noise."""

from collections.abc import Sequence

import numpy as np

from stridelab.conventions import Points

Vector = tuple[float, float, float]
Rectangle = tuple[Vector, Vector, Vector]
"""A corner and two edges."""


def scan_rectangles(
    rng: np.random.Generator, rectangles: Sequence[Rectangle], spacing_m: float, noise_m: float = 0.0
) -> Points:
    """Points of rectangles, on average one per square of the spacing."""
    parts = []
    for corner, u, v in rectangles:
        count = rng.poisson(np.linalg.norm(u) * np.linalg.norm(v) / spacing_m**2)
        parts.append(np.array(corner) + rng.uniform(size=(count, 1)) * u + rng.uniform(size=(count, 1)) * v)
    points_m = np.concatenate(parts)
    return np.asarray(points_m + rng.normal(0.0, noise_m, points_m.shape))


def scan_bar(
    rng: np.random.Generator, ends: tuple[Vector, Vector], radius_m: float, spacing_m: float, noise_m: float
) -> Points:
    """Points around a round bar."""
    a, b = np.array(ends)
    d = (b - a) / np.linalg.norm(b - a)
    u = np.cross(d, [0.0, 1.0, 0.0])
    u /= np.linalg.norm(u)
    count = rng.poisson(np.linalg.norm(b - a) * 2.0 * np.pi * radius_m / spacing_m**2)
    turn = rng.uniform(0.0, 2.0 * np.pi, (count, 1))
    around = radius_m * (np.cos(turn) * u + np.sin(turn) * np.cross(d, u))
    points_m = a + rng.uniform(size=(count, 1)) * (b - a) + around
    return np.asarray(points_m + rng.normal(0.0, noise_m, points_m.shape))


def flight_rectangles(
    rise_m: float, run_m: float, treads: int, width_m: float, ends_m: float
) -> tuple[list[Rectangle], list[Rectangle]]:
    """Level rectangles of a flight along x, from the floor to the landing, and its risers."""
    level: list[Rectangle] = [((-ends_m, -0.5 * width_m, 0.0), (ends_m, 0.0, 0.0), (0.0, width_m, 0.0))]
    risers: list[Rectangle] = []
    for k in range(treads):
        depth_m = ends_m if k == treads - 1 else run_m
        level.append(((k * run_m, -0.5 * width_m, (k + 1) * rise_m), (depth_m, 0.0, 0.0), (0.0, width_m, 0.0)))
        risers.append(((k * run_m, -0.5 * width_m, k * rise_m), (0.0, width_m, 0.0), (0.0, 0.0, rise_m)))
    return level, risers
