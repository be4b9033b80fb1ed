"""Marks of contacts on the terrain: a footprint with its toe, or a ball for a hand, in the colour of the effector."""

import numpy as np
import viser

from stridelab.schemas.scenarios import Scenario
from stridelab_web.scene.contacts import (
    HalfSizes,
    PlacedContact,
    contact_node,
    effector_side,
    placed_contacts,
    rotation_matrix,
    side_nodes,
)
from stridelab_web.viewer import meshes
from stridelab_web.viewer.scene_parts import Colour, add_mesh

COLOURS: dict[str, Colour] = {"left": (11, 92, 156), "right": (224, 138, 30), "hand": (86, 97, 108)}
"""The same as on the pages (app.css): distinguishable with every kind of colour vision; marks also have numbers."""
HAND_RADIUS_M = 0.034
EDGE_M = 0.012
LIFT_M, TOUCHING_LIFT_M, LABEL_M = 0.004, 0.006, 0.02
LABEL_SCALE = 0.85
PALE = 0.4
"""Opacity of a place where no contact is loaded."""
TOE = 0.45
"""Length of the toe's triangle beyond the patch, as a share of its half width."""


def add_mark(scene: viser.SceneApi, touch: PlacedContact, sizes: HalfSizes) -> viser.MeshHandle:
    """Add the mark of one contact; replaces a mark with the same number."""
    colour = COLOURS[effector_side(touch.effector)]
    name, half = contact_node(touch), sizes.get(touch.effector)
    # A drag needs an area to take hold of: pale where it is only a place, full where it carries.
    made = add_mesh(scene, name, _mark_area(half, LIFT_M), colour, opacity=PALE)
    place_mark(made, touch)
    add_mesh(scene, f"{name}/edge", _mark_edge(half), colour)
    _add_number(scene, touch)
    return made


def add_fixed_marks(scene: viser.SceneApi, scenario: Scenario, sizes: HalfSizes) -> None:
    """Add the marks of a plan: one node per side for all places, and a full mark per contact while it is loaded."""
    placed = placed_contacts(scenario)
    for side, name in side_nodes(placed).items():
        same = [touch for touch in placed if effector_side(touch.effector) == side]
        areas = [_placed_mesh(_mark_area(sizes.get(touch.effector), LIFT_M), touch) for touch in same]
        edges = [_placed_mesh(_mark_edge(sizes.get(touch.effector)), touch) for touch in same]
        add_mesh(scene, name, meshes.merge_meshes(areas), COLOURS[side], opacity=PALE, side="front")
        add_mesh(scene, f"{name}/edge", meshes.merge_meshes(edges), COLOURS[side])
    for touch in placed:
        name, contact = contact_node(touch), touch.contact
        scene.add_frame(name, show_axes=False, position=contact.position_m, wxyz=contact.orientation_wxyz)
        area = _mark_area(sizes.get(touch.effector), TOUCHING_LIFT_M)
        add_mesh(scene, f"{name}/touching", area, COLOURS[effector_side(touch.effector)])
        _add_number(scene, touch)


def _placed_mesh(mesh: meshes.Mesh, touch: PlacedContact) -> meshes.Mesh:
    vertices, faces = mesh
    R = rotation_matrix(touch.contact.orientation_wxyz)
    return (np.array(touch.contact.position_m) + vertices @ R.T).astype(np.float32), faces


def _add_number(scene: viser.SceneApi, touch: PlacedContact) -> None:
    scene.add_label(
        f"{contact_node(touch)}/label",
        str(touch.number),
        position=(0.0, 0.0, LABEL_M),
        anchor="bottom-center",
        font_screen_scale=LABEL_SCALE,
    )


def place_mark(handle: viser.MeshHandle, touch: PlacedContact) -> None:
    """Move a mark to its contact."""
    handle.position = touch.contact.position_m
    handle.wxyz = touch.contact.orientation_wxyz


def _mark_area(half_m: tuple[float, float] | None, lift_m: float) -> meshes.Mesh:
    """A sole with its toe, or a ball for a point."""
    if half_m is None:
        return meshes.ball(HAND_RADIUS_M + lift_m)
    return meshes.polygon(_sole_corners(half_m, lift_m))


def _mark_edge(half_m: tuple[float, float] | None) -> meshes.Mesh:
    """The line around a sole, or around the middle of a ball."""
    if half_m is None:
        angle = 2 * np.pi * np.arange(24) / 24
        ring = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
        return meshes.band_between((HAND_RADIUS_M + EDGE_M) * ring, HAND_RADIUS_M * ring)
    share = 1 - EDGE_M / max(half_m)
    return meshes.band_between(
        _sole_corners(half_m, LIFT_M), _sole_corners((share * half_m[0], share * half_m[1]), LIFT_M)
    )


def _sole_corners(half_m: tuple[float, float], lift_m: float) -> np.ndarray:
    """Corners ``(5, 3)`` of a sole in the contact frame, counterclockwise."""
    x, y = half_m
    flat = np.array([[x, -y], [x + TOE * y, 0.0], [x, y], [-x, y], [-x, -y]])
    return np.column_stack([flat, np.full(len(flat), lift_m)])
