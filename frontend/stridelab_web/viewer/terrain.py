"""What can be touched: boxes with the rim of their upper face, rails with their ends."""

import numpy as np
import viser

from stridelab.schemas.scenarios import BoxSurface, RailSurface, Scenario
from stridelab_web.touches import box_corners_m, box_rotation
from stridelab_web.viewer import shapes
from stridelab_web.viewer.parts import Colour, add_mesh

BOX: Colour = (222, 229, 235)
RIM: Colour = (150, 165, 180)
GROUND: Colour = (243, 245, 247)
GRID_CELL, GRID_SECTION = (226, 231, 236), (203, 211, 218)
RAIL: Colour = (168, 180, 192)
GROUND_FROM_M = 2.5
"""A box whose upper face is at least this long and wide is drawn as ground, with a grid of 0.25 m and 1 m."""
RIM_FROM_M, RIM_M = 0.003, 0.015
"""The rim begins inside the face: sides of boxes in one plane would let it shine through."""
LIFT_M = 0.0015
"""How far lines lie above the face that they are on, so that they do not flicker."""
_FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
     [1, 5, 7], [1, 7, 3]], dtype=np.uint32,
)  # fmt: skip
"""Triangles of ``touches.box_corners_m``."""


def add_terrain(scene: viser.SceneApi, scenario: Scenario) -> None:
    """All surfaces of ``scenario`` below ``/terrain``."""
    for k, surface in enumerate(scenario.terrain):
        if isinstance(surface, RailSurface):
            _add_rail(scene, f"/terrain/{k}", surface)
        else:
            _add_box(scene, f"/terrain/{k}", surface)


def is_ground(box: BoxSurface) -> bool:
    """Whether a box is large enough to be drawn as the ground."""
    return min(box.size_m[:2]) >= GROUND_FROM_M


def _add_box(scene: viser.SceneApi, name: str, box: BoxSurface) -> None:
    corners, R = box_corners_m(box), box_rotation(box)
    # Every triangle has corners of its own, so that the faces of a box look flat.
    vertices = corners[_FACES].reshape(-1, 3).astype(np.float32)
    faces = np.arange(len(vertices), dtype=np.uint32).reshape(-1, 3)
    add_mesh(scene, name, (vertices, faces), GROUND if is_ground(box) else BOX)
    half = np.array(box.size_m) / 2
    if is_ground(box):
        yaw = np.arctan2(R[1, 0], R[0, 0]) / 2
        scene.add_grid(
            f"{name}/grid",
            width=box.size_m[0],
            height=box.size_m[1],
            cell_size=0.25,
            section_size=1.0,
            cell_color=GRID_CELL,
            section_color=GRID_SECTION,
            shadow_opacity=0.0,
            position=np.array(box.center_m) + (half[2] + LIFT_M) * R[:, 2],
            wxyz=(float(np.cos(yaw)), 0.0, 0.0, float(np.sin(yaw))),
        )
        return
    square = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    outer = np.column_stack([square * np.maximum(half[:2] - RIM_FROM_M, 0.0), np.full(4, half[2] + LIFT_M)])
    inner = np.column_stack([square * np.maximum(half[:2] - RIM_M, 0.0), np.full(4, half[2] + LIFT_M)])
    rim, rim_faces = shapes.between(outer, inner)
    add_mesh(scene, f"{name}/rim", ((np.array(box.center_m) + rim @ R.T).astype(np.float32), rim_faces), RIM)


def _add_rail(scene: viser.SceneApi, name: str, rail: RailSurface) -> None:
    ends = np.array([rail.from_m, rail.to_m])
    add_mesh(scene, name, shapes.tube(ends, rail.radius_m, sides=12), RAIL)
    for k, end in enumerate(ends):
        scene.add_icosphere(
            f"{name}/end{k}", rail.radius_m, RAIL, subdivisions=2, position=end, cast_shadow=False, receive_shadow=False
        )
