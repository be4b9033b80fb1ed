"""Terrain: boxes with the rim of their upper face, and rails with their ends."""

import itertools
from collections.abc import Sequence

import numpy as np
import viser

from stridelab.schemas.scenarios import BoxSurface, RailSurface, Scenario
from stridelab_web.scene.contacts import box_rotation
from stridelab_web.viewer import meshes
from stridelab_web.viewer.scene_parts import Colour, add_mesh

BOX: Colour = (222, 229, 235)
RIM: Colour = (150, 165, 180)
GROUND: Colour = (243, 245, 247)
GRID_CELL, GRID_SECTION = (226, 231, 236), (203, 211, 218)
RAIL: Colour = (168, 180, 192)
GROUND_FROM_M = 2.5
"""A box whose upper face is at least this long and wide is drawn as ground, with a grid of 0.25 m and 1 m."""
RIM_FROM_M, RIM_M = 0.003, 0.015
"""The rim begins inside the face, because it would be visible through coplanar sides of boxes."""
LIFT_M = 0.0015
"""Height of lines above their face, which avoids flicker."""
SAME_M = 1e-6
Span = tuple[np.ndarray, np.ndarray]
"""The lowest and the highest corner of an axis-parallel box."""


def add_terrain(scene: viser.SceneApi, scenario: Scenario, *, merged: bool = False) -> None:
    """All surfaces of ``scenario`` below ``/terrain``, one node per surface.

    With ``merged`` all boxes that are not the ground are one node and their rims another: a browser draws node by node,
    and twenty stones cost it as much as a robot.
    """
    boxes = [surface for surface in scenario.terrain if isinstance(surface, BoxSurface)]
    bodies, rims = [], []
    for k, surface in enumerate(scenario.terrain):
        name = f"/terrain/{k}"
        if isinstance(surface, RailSurface):
            _add_rail(scene, name, surface)
            continue
        body = _box_mesh(surface, [box for box in boxes if box is not surface])
        if is_ground(surface):
            if body is not None:
                add_mesh(scene, name, body, GROUND)
            _add_grid(scene, f"{name}/grid", surface)
        elif merged:
            bodies += [] if body is None else [body]
            rims.append(_rim_mesh(surface))
        else:
            if body is not None:
                add_mesh(scene, name, body, BOX)
            add_mesh(scene, f"{name}/rim", _rim_mesh(surface), RIM)
    for name, parts, colour in (("/terrain/boxes", bodies, BOX), ("/terrain/boxes/rims", rims, RIM)):
        if parts:
            add_mesh(scene, name, meshes.merge_meshes(parts), colour)


def is_ground(box: BoxSurface) -> bool:
    """Whether a box is large enough to be drawn as the ground."""
    return min(box.size_m[:2]) >= GROUND_FROM_M


def faces_m(box: BoxSurface, others: Sequence[BoxSurface]) -> np.ndarray:
    """Corners ``(n, 4, 3)`` in the world, counterclockwise from outside, of the visible faces of a box.

    Parts inside another box are left out: stairs are overlapping boxes with coplanar sides, through which edges of
    hidden faces would be visible. Only boxes with parallel edges are considered.
    """
    R, half = box_rotation(box), np.array(box.size_m) / 2
    spans = [span for other in others if (span := _span_in_frame(box, other)) is not None]
    faces = []
    for k, sign in itertools.product(range(3), (-1.0, 1.0)):
        rest, level = [(k + 1) % 3, (k + 2) % 3], sign * half[k]
        holes = [(low[rest], high[rest]) for low, high in spans if low[k] + SAME_M < level < high[k] - SAME_M]
        for patch in free_m(half[rest], holes):
            corners = np.full((4, 3), level)
            corners[:, rest] = patch if sign > 0 else patch[::-1]
            faces.append(np.array(box.center_m) + corners @ R.T)
    return np.array(faces).reshape(-1, 4, 3)


def free_m(half_m: np.ndarray, holes: Sequence[Span]) -> np.ndarray:
    """Corners ``(n, 4, 2)``, counterclockwise, of rectangles that cover ``-half_m`` to ``half_m`` without the holes.

    Adjacent rectangles share whole edges, so that there are no gaps between them.
    """
    ends = np.array([-half_m, half_m, *itertools.chain.from_iterable(holes)])
    x, y = (np.unique(np.round(np.clip(ends[:, k], -half_m[k], half_m[k]), 6)) for k in range(2))
    rectangles = []
    for (x0, x1), (y0, y1) in itertools.product(itertools.pairwise(x), itertools.pairwise(y)):
        middle = np.array([x0 + x1, y0 + y1]) / 2
        if not any(((low < middle) & (middle < high)).all() for low, high in holes):
            rectangles.append([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    return np.array(rectangles).reshape(-1, 4, 2)


def _span_in_frame(box: BoxSurface, other: BoxSurface) -> Span | None:
    """``other`` in the frame of ``box``; None where their edges are not parallel."""
    R = box_rotation(box)
    turn = np.abs(R.T @ box_rotation(other))
    if np.abs(turn - np.round(turn)).max() > SAME_M:
        return None
    middle, reach = R.T @ (np.array(other.center_m) - box.center_m), turn @ np.array(other.size_m) / 2
    return middle - reach, middle + reach


def _box_mesh(box: BoxSurface, others: Sequence[BoxSurface]) -> meshes.Mesh | None:
    """The visible faces of a box in the world; None if there are none."""
    # Every triangle has corners of its own, so that the faces of a box look flat.
    vertices = faces_m(box, others)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3).astype(np.float32)
    return (vertices, np.arange(len(vertices), dtype=np.uint32).reshape(-1, 3)) if len(vertices) else None


def _add_grid(scene: viser.SceneApi, name: str, box: BoxSurface) -> None:
    """The grid on the upper face of a box."""
    R, height_m = box_rotation(box), box.size_m[2] / 2 + LIFT_M
    yaw = np.arctan2(R[1, 0], R[0, 0]) / 2
    scene.add_grid(
        name,
        width=box.size_m[0],
        height=box.size_m[1],
        cell_size=0.25,
        section_size=1.0,
        cell_color=GRID_CELL,
        section_color=GRID_SECTION,
        shadow_opacity=0.0,
        position=np.array(box.center_m) + height_m * R[:, 2],
        wxyz=(float(np.cos(yaw)), 0.0, 0.0, float(np.sin(yaw))),
    )


def _rim_mesh(box: BoxSurface) -> meshes.Mesh:
    """The rim of the upper face of a box, in the world."""
    R, half = box_rotation(box), np.array(box.size_m) / 2
    square = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    outer = np.column_stack([square * np.maximum(half[:2] - RIM_FROM_M, 0.0), np.full(4, half[2] + LIFT_M)])
    inner = np.column_stack([square * np.maximum(half[:2] - RIM_M, 0.0), np.full(4, half[2] + LIFT_M)])
    rim, faces = meshes.band_between(outer, inner)
    return (np.array(box.center_m) + rim @ R.T).astype(np.float32), faces


def _add_rail(scene: viser.SceneApi, name: str, rail: RailSurface) -> None:
    ends = np.array([rail.from_m, rail.to_m])
    corners, faces = meshes.ball(rail.radius_m, subdivisions=1)
    balls = [((corners + end).astype(np.float32), faces) for end in ends]
    add_mesh(scene, name, meshes.merge_meshes([meshes.tube(ends, rail.radius_m, sides=12), *balls]), RAIL)
