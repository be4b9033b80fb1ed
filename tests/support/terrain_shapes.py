"""Terrains of rectangles as depth cameras and scanners see them, and their points in the axes of files."""

import numpy as np

from stridelab.conventions import Points
from support.terrain_scans import Rectangle, scan_rectangles

FROM_Z_UP = {
    "+z": np.eye(3),
    "-z": np.diag([1.0, -1.0, -1.0]),
    "+y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
    "-y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "+x": np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    "-x": np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]),
}
"""Rotations from z up to files in which another axis points up."""


def box_faces(x_m: tuple[float, float], y_m: tuple[float, float], top_m: float, foot_m: float = 0.0) -> list[Rectangle]:
    """The upper face and the four sides of a box that are higher than its foot."""
    (x0, x1), (y0, y1) = x_m, y_m
    dx, dy, dz = (x1 - x0, 0.0, 0.0), (0.0, y1 - y0, 0.0), (0.0, 0.0, top_m - foot_m)
    faces: list[Rectangle] = [((x0, y0, top_m), dx, dy)]
    if top_m > foot_m:
        faces += [((x0, y0, foot_m), dy, dz), ((x1, y0, foot_m), dy, dz)]
        faces += [((x0, y0, foot_m), dx, dz), ((x0, y1, foot_m), dx, dz)]
    return faces


def l_stairs(rise_m: float = 0.16, run_m: float = 0.28) -> list[Rectangle]:
    """Four treads along x, a landing, and four treads along y."""
    faces = box_faces((-1.2, 0.0), (0.0, 1.0), 0.0)
    for k in range(4):
        faces += box_faces((k * run_m, (k + 1) * run_m), (0.0, 1.0), (k + 1) * rise_m)
    x0 = 4 * run_m
    faces += box_faces((x0, x0 + 1.0), (0.0, 1.0), 5 * rise_m)
    for k in range(4):
        faces += box_faces((x0, x0 + 1.0), (1.0 + k * run_m, 1.0 + (k + 1) * run_m), (k + 6) * rise_m)
    return faces


def ramp_beside_wall(slope_deg: float = 8.0) -> list[Rectangle]:
    """A floor, a ramp up along x, and a wall on its right seen from one side."""
    a = np.deg2rad(slope_deg)
    floor: Rectangle = ((-1.2, 0.0, 0.0), (1.2, 0.0, 0.0), (0.0, 1.4, 0.0))
    ramp: Rectangle = ((0.0, 0.0, 0.0), (2.5 * np.cos(a), 0.0, 2.5 * np.sin(a)), (0.0, 1.4, 0.0))
    wall: Rectangle = ((-1.2, 0.0, 0.0), (3.6, 0.0, 0.0), (0.0, 0.0, 1.9))
    return [floor, ramp, wall]


def room_with_table() -> list[Rectangle]:
    """A floor of 4 by 3 m, two walls that are seen from inside, one with a door, and a table."""
    floor: Rectangle = ((0.0, 0.0, 0.0), (4.0, 0.0, 0.0), (0.0, 3.0, 0.0))
    back: Rectangle = ((0.0, 3.0, 0.0), (4.0, 0.0, 0.0), (0.0, 0.0, 2.3))
    aside: list[Rectangle] = [
        ((4.0, 0.0, 0.0), (0.0, 1.2, 0.0), (0.0, 0.0, 2.3)),
        ((4.0, 2.1, 0.0), (0.0, 0.9, 0.0), (0.0, 0.0, 2.3)),
        ((4.0, 1.2, 2.0), (0.0, 0.9, 0.0), (0.0, 0.0, 0.3)),
    ]
    top: Rectangle = ((1.2, 1.6, 0.75), (1.4, 0.0, 0.0), (0.0, 0.8, 0.0))
    return [floor, back, *aside, top]


def stepping_stones() -> list[Rectangle]:
    """Two platforms and five stones of different heights between them, with nothing seen below."""
    faces = box_faces((-0.8, 0.0), (-0.5, 0.5), 0.0, -0.4) + box_faces((2.2, 3.0), (-0.5, 0.5), 0.05, -0.4)
    for k, (x, y) in enumerate(((0.3, 0.2), (0.65, -0.2), (1.05, 0.2), (1.45, -0.2), (1.8, 0.2))):
        faces += box_faces((x - 0.17, x + 0.17), (y - 0.17, y + 0.17), 0.03 * (k % 3), -0.4)
    return faces


def spoil_scan(rng: np.random.Generator, points_m: Points, outliers: float = 0.01, patches: int = 3) -> Points:
    """The points without patches of 16 to 24 cm, and with outliers."""
    for _ in range(patches):
        middle = points_m[int(rng.integers(len(points_m)))]
        points_m = points_m[np.linalg.norm(points_m - middle, axis=1) > rng.uniform(0.08, 0.12)]
    low, high = points_m.min(axis=0), points_m.max(axis=0)
    return np.concatenate([points_m, rng.uniform(low, high, (int(outliers * len(points_m)), 3))])


def scan_shape(rng: np.random.Generator, faces: list[Rectangle], spacing_m: float = 0.02) -> Points:
    """A scan of a shape with 2 mm of noise, outliers and missing patches."""
    return spoil_scan(rng, scan_rectangles(rng, faces, spacing_m, 0.002))


def see_from(points_m: Points, at_m: tuple[float, float, float]) -> Points:
    """Points in the axes of a depth camera at a place that looks along y: x right, y down, z ahead."""
    local = points_m - np.array(at_m)
    seen = np.column_stack([local[:, 0], -local[:, 2], local[:, 1]])
    z = seen[:, 2]
    return np.asarray(seen[(z > 0.3) & (np.abs(seen[:, :2]).max(axis=1) < 0.9 * z)])
