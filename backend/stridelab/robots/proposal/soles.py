"""Flat patch of a foot: the largest rectangle on the lowest plane of its collision shapes.

With the points ``p_i`` of the shapes and a direction ``n`` near down, the patch is the convex hull of those with
``n' p_i >= max n' p - tolerance``, projected along ``n``. A rectangle with centre ``c``, half edges ``w`` and ``r w``
lies in the polygon ``A p <= b`` if

    A c + (|A_x| + r |A_y|) w <= b

which is a linear program for every ratio ``r``; the one of largest area is taken.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import coal
import numpy as np
import pinocchio as pin
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, QhullError

from stridelab.conventions import Points, Rotation, Vector3

TOLERANCE: Final = 0.0025
"""Height of the patch relative to the length of the leg."""
MAX_TILT_DEG: Final = 40.0
RATIOS: Final = np.geomspace(0.15, 1.6, 16)
_RING: Final = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)


@dataclass(frozen=True)
class Sole:
    """A sole in the frame of the foot's joint: rotation with z up and x ahead, centre, half edges, and the foot's."""

    R: Rotation
    centre_m: Vector3
    half_size_m: tuple[float, float]
    foot_half_size_m: tuple[float, float]


def sole_of(shapes: Sequence[pin.GeometryObject], ahead: Vector3, up: Vector3, leg_m: float) -> Sole | None:
    """The sole of a foot with ``shapes``; ``ahead`` and ``up`` in the frame of its joint. None without a flat patch."""
    points = np.concatenate([np.zeros((0, 3)), *(shape_points(shape, -up) for shape in shapes)])
    if len(points) < 3:
        return None
    best: Sole | None = None
    for normal in _directions(points, -up):
        sole = _patch(np.concatenate([shape_points(shape, normal) for shape in shapes]), -normal, ahead, leg_m)
        if sole is not None and (best is None or np.prod(sole.half_size_m) > 1.02 * np.prod(best.half_size_m)):
            best = sole
    return best


def shape_points(shape: pin.GeometryObject, direction: Vector3) -> Points:
    """Vertices ``(n, 3)`` of a shape in the frame of its joint; of a round one its extreme points."""
    geometry, T = shape.geometry, shape.placement
    local = T.rotation.T @ direction
    if isinstance(geometry, coal.Sphere):
        points = geometry.radius * np.array([local])
    elif isinstance(geometry, coal.Box):
        signs = np.array([(i, j, k) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
        points = signs * np.array(geometry.halfSide)
    elif isinstance(geometry, (coal.Cylinder, coal.Capsule)):
        r, h = geometry.radius, geometry.halfLength
        ring = np.column_stack([r * np.cos(_RING), r * np.sin(_RING)])
        across = np.array([local[0], local[1]])
        if np.linalg.norm(across) > 1e-9:
            ring = np.vstack([ring, r * across / np.linalg.norm(across)])
        points = np.vstack([np.column_stack([ring, np.full(len(ring), z)]) for z in (-h, h)])
    elif isinstance(geometry, (coal.BVHModelBase, coal.ConvexBase)):
        vertices = geometry.vertices() if isinstance(geometry, coal.BVHModelBase) else geometry.points()
        points = np.asarray(vertices) * np.asarray(shape.meshScale if isinstance(geometry, coal.ConvexBase) else 1.0)
    else:
        points = np.zeros((0, 3))
    return np.asarray(points @ T.rotation.T + T.translation)


def _directions(points: Points, down: Vector3) -> list[Vector3]:
    """Down, and the normals of the hull's largest faces near it."""
    directions = [down]
    try:
        hull = ConvexHull(points)
    except QhullError:
        return directions
    normals = hull.equations[:, :3]
    corners = points[hull.simplices]
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    near = normals @ down > np.cos(np.radians(MAX_TILT_DEG))
    return [*directions, *(normals[index] for index in np.argsort(-areas * near)[:12] if near[index])]


def _patch(points: Points, up: Vector3, ahead: Vector3, leg_m: float) -> Sole | None:
    x = ahead - (ahead @ up) * up
    x /= np.linalg.norm(x)
    R = np.column_stack([x, np.cross(up, x), up])
    local = points @ R
    low = local[:, 2].min()
    flat = local[local[:, 2] <= low + TOLERANCE * leg_m][:, :2]
    rectangle = _largest_rectangle(flat)
    if rectangle is None:
        return None
    centre, half = rectangle
    extent = 0.5 * np.ptp(local[:, :2], axis=0)
    return Sole(R, R @ np.array([*centre, low]), half, (float(extent[0]), float(extent[1])))


def _largest_rectangle(points: np.ndarray) -> tuple[np.ndarray, tuple[float, float]] | None:
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        return None
    A, b = hull.equations[:, :2], -hull.equations[:, 2]
    step = RATIOS[1] / RATIOS[0]
    best, area, size = 1.0, 0.0, (0.0, 0.0)
    for finer in (False, True):
        for ratio in best * np.geomspace(1.0 / step, step, 11) if finer else RATIOS:
            rows = np.column_stack([A, np.abs(A[:, 0]) + ratio * np.abs(A[:, 1])])
            solved = linprog([0.0, 0.0, -1.0], A_ub=rows, b_ub=b, bounds=[(None, None), (None, None), (0.0, None)])
            if solved.status == 0 and solved.x[2] ** 2 * ratio > area:
                best, area = ratio, float(solved.x[2]) ** 2 * ratio
                size = float(solved.x[2]), float(ratio * solved.x[2])
    if not area:
        return None
    # the centre may slide while one pair of edges touches: the middle of where it can be
    room = b - np.abs(A) @ size * (1.0 - 1e-6)
    free = [(None, None)] * 2
    ends = [[linprog(sign * axis, A_ub=A, b_ub=room, bounds=free).x @ axis for sign in (1, -1)] for axis in np.eye(2)]
    return np.mean(ends, axis=1), size
