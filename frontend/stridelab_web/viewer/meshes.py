"""Small triangle meshes: sticks, arrow heads, paths, patches and balls."""

import itertools
from collections.abc import Sequence

import numpy as np
import trimesh

SIDES = 10
TUBE_SIDES = 6
RIM_STEPS = 48
RIM_SHARE = 0.01
"""Thickness of a funnel's rim over its height."""
OCTANT_STEPS = 6
"""Patches along each edge of an eighth of a sphere."""
Mesh = tuple[np.ndarray, np.ndarray]
"""Vertices ``(n, 3)`` and faces ``(m, 3)``."""


def cylinder(radius_m: float) -> Mesh:
    """A cylinder from the origin to (0, 0, 1), which is scaled along z."""
    ring = _unit_circle(SIDES)
    low = np.column_stack([radius_m * ring, np.zeros(SIDES)])
    vertices = np.concatenate([low, low + np.array([0, 0, 1])])
    return vertices.astype(np.float32), _tube_faces(2, SIDES)


def solid_of_revolution(profile: Sequence[tuple[float, float]]) -> Mesh:
    """The solid about the z axis with a ring for every pair of height and radius of ``profile``."""
    rings = [np.column_stack([radius * _unit_circle(SIDES), np.full(SIDES, height)]) for height, radius in profile]
    return np.concatenate(rings).astype(np.float32), _tube_faces(len(rings), SIDES)


def cone(radius_m: float, height_m: float) -> Mesh:
    """A cone with its tip in the origin and its base at (0, 0, -height): the head of an arrow."""
    base = np.column_stack([radius_m * _unit_circle(SIDES), np.full(SIDES, -height_m)])
    vertices = np.concatenate([base, [[0, 0, 0], [0, 0, -height_m]]])
    k = np.arange(SIDES)
    after = (k + 1) % SIDES
    sides = np.column_stack([k, after, np.full(SIDES, SIDES)])
    bottom = np.column_stack([after, k, np.full(SIDES, SIDES + 1)])
    return vertices.astype(np.float32), np.concatenate([sides, bottom]).astype(np.uint32)


def open_cone(slope: float, height_m: float) -> Mesh:
    """An open cone with its tip in the origin, ``slope`` times as wide as high around the z axis, and its rim."""
    rim = np.column_stack([slope * height_m * _unit_circle(RIM_STEPS), np.full(RIM_STEPS, height_m)])
    k = np.arange(RIM_STEPS)
    sides = np.column_stack([k, (k + 1) % RIM_STEPS, np.full(RIM_STEPS, RIM_STEPS)])
    wall = np.concatenate([rim, np.zeros((1, 3))]).astype(np.float32), sides.astype(np.uint32)
    return merge_meshes([wall, tube(np.concatenate([rim, rim[:1]]), RIM_SHARE * height_m)])


def simplify_path(path_m: np.ndarray, within_m: float) -> np.ndarray:
    """Indices of points of ``path_m`` ``(n, 3)`` such that all points are ``within_m`` of the lines between them.

    Douglas and Peucker (1973): sections are split at the point farthest from their chord.
    """
    indices = {0, len(path_m) - 1}
    stretches = [(0, len(path_m) - 1)]
    while stretches:
        first, last = stretches.pop()
        if last - first < 2:
            continue
        chord, offset = path_m[last] - path_m[first], path_m[first + 1 : last] - path_m[first]
        square = float(chord @ chord)
        along = np.clip(offset @ chord / square, 0.0, 1.0) if square > 0 else np.zeros(len(offset))
        far_m = np.linalg.norm(offset - along[:, None] * chord, axis=1)
        if far_m.max() > within_m:
            middle = first + 1 + int(np.argmax(far_m))
            indices.add(middle)
            stretches += [(first, middle), (middle, last)]
    return np.array(sorted(indices))


def tube(path_m: np.ndarray, radius_m: float, sides: int = TUBE_SIDES) -> Mesh:
    """Thin tube along ``path_m`` ``(n, 3)``, each ring perpendicular to the path."""
    tangent = np.gradient(path_m.astype(float), axis=0)
    norm = np.linalg.norm(tangent, axis=1, keepdims=True)
    tangent = np.where(norm > 1e-9, tangent / np.where(norm > 1e-9, norm, 1.0), [1.0, 0.0, 0.0])
    # Whichever world axis is farther from the tangent spans the ring with it.
    helper = np.where(np.abs(tangent[:, 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    first = np.cross(helper, tangent)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(tangent, first)
    ring = radius_m * _unit_circle(sides)
    vertices = path_m[:, None] + ring[None, :, :1] * first[:, None] + ring[None, :, 1:] * second[:, None]
    return vertices.reshape(-1, 3).astype(np.float32), _tube_faces(len(path_m), sides)


def inner_frame(corners_m: np.ndarray, share: float) -> Mesh:
    """Frame inside four corners ``(4, 3)``; its width is ``share`` of the distance to their middle."""
    return band_between(corners_m, corners_m + share * (corners_m.mean(axis=0) - corners_m))


def band_between(outer_m: np.ndarray, inner_m: np.ndarray) -> Mesh:
    """The band between two closed lines of ``n`` corners ``(n, 3)`` each."""
    n = len(outer_m)
    k = np.arange(n)
    after = (k + 1) % n
    faces = np.concatenate([np.column_stack([k, after, after + n]), np.column_stack([k, after + n, k + n])])
    return np.concatenate([outer_m, inner_m]).astype(np.float32), faces.astype(np.uint32)


def polygon(corners_m: np.ndarray) -> Mesh:
    """A convex polygon ``(n, 3)`` as a fan."""
    k = np.arange(1, len(corners_m) - 1)
    return corners_m.astype(np.float32), np.column_stack([np.zeros_like(k), k, k + 1]).astype(np.uint32)


def ball(radius_m: float, subdivisions: int = 2) -> Mesh:
    """A sphere around the origin, with ``20 * 4**subdivisions`` triangles."""
    solid = trimesh.creation.icosphere(subdivisions, radius_m)
    return np.asarray(solid.vertices, dtype=np.float32), np.asarray(solid.faces, dtype=np.uint32)


def wheel(share: float, spokes: int) -> Mesh:
    """A wheel of radius 1 about the y axis: a rim with half thickness ``share``, and thin spokes."""
    angle = 2 * np.pi * np.arange(RIM_STEPS + 1) / RIM_STEPS
    ring = tube(np.column_stack([np.sin(angle), np.zeros_like(angle), -np.cos(angle)]), share)
    ends = 2 * np.pi * np.arange(spokes) / spokes
    hub = np.zeros(3)
    lines = [tube(np.array([hub, [np.sin(a), 0.0, -np.cos(a)]]), share / 3) for a in ends]
    return merge_meshes([ring, *lines])


def sphere_halves(radius_m: float) -> tuple[Mesh, Mesh]:
    """A sphere around the origin in two halves of alternating octants."""
    quarter = np.linspace(0, np.pi / 2, OCTANT_STEPS + 1)
    halves: tuple[list[Mesh], list[Mesh]] = ([], [])
    for x, y, z in itertools.product((1, -1), repeat=3):
        lines = np.array([[np.cos(a) * np.cos(b), np.sin(a) * np.cos(b), np.sin(b)] for b in quarter for a in quarter])
        k = (np.arange(OCTANT_STEPS)[:, None] * (OCTANT_STEPS + 1) + np.arange(OCTANT_STEPS)).reshape(-1)
        above = k + OCTANT_STEPS + 1
        faces = np.concatenate([np.column_stack([k, k + 1, above + 1]), np.column_stack([k, above + 1, above])])
        # A mirrored octant is inside out.
        turned = faces if x * y * z > 0 else faces[:, ::-1]
        vertices = (radius_m * lines * [x, y, z]).astype(np.float32)
        halves[x * y * z < 0].append((vertices, turned.astype(np.uint32)))
    return merge_meshes(halves[0]), merge_meshes(halves[1])


def merge_meshes(meshes: list[Mesh]) -> Mesh:
    """Several meshes as one."""
    offsets = np.cumsum([0, *(len(vertices) for vertices, _ in meshes[:-1])])
    faces = [faces + np.uint32(offset) for (_, faces), offset in zip(meshes, offsets, strict=True)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(faces)


def _unit_circle(sides: int) -> np.ndarray:
    angle = 2 * np.pi * np.arange(sides) / sides
    return np.column_stack([np.cos(angle), np.sin(angle)])


def _tube_faces(rings: int, sides: int) -> np.ndarray:
    k = np.arange(sides)
    after = (k + 1) % sides
    quad = np.concatenate([np.column_stack([k, after, k + sides]), np.column_stack([after, after + sides, k + sides])])
    return np.concatenate([quad + ring * sides for ring in range(rings - 1)]).astype(np.uint32)
