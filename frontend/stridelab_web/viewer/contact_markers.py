"""Marks of contacts on the terrain: a footprint with its toe, or a ball for a hand, in the colour of the effector."""

import numpy as np
import viser

from stridelab.schemas.scenarios import Scenario
from stridelab_web.scene.contacts import HalfSizes, PlacedContact, contact_node, effector_side, placed_contacts
from stridelab_web.viewer import meshes
from stridelab_web.viewer.scene_parts import Colour, add_mesh

COLOURS: dict[str, Colour] = {"left": (11, 92, 156), "right": (224, 138, 30), "hand": (86, 97, 108)}
"""The same as on the pages (app.css): distinguishable with every kind of colour vision; marks also have numbers."""
HAND_RADIUS_M = 0.034
EDGE_M = 0.012
LIFT_M, TOUCHING_LIFT_M, LABEL_M = 0.004, 0.006, 0.02
LABEL_SCALE = 0.85
TOE = 0.45
"""Length of the toe's triangle beyond the patch, as a share of its half width."""


def add_marks(
    scene: viser.SceneApi, scenario: Scenario, sizes: HalfSizes, touching: bool
) -> dict[int, viser.MeshHandle]:
    """Add a mark per contact, by number; with ``touching`` also a full one, shown while the contact is loaded."""
    return {touch.number: add_mark(scene, touch, sizes, touching) for touch in placed_contacts(scenario)}


def add_mark(scene: viser.SceneApi, touch: PlacedContact, sizes: HalfSizes, touching: bool) -> viser.MeshHandle:
    """Add the mark of one contact; replaces a mark with the same number."""
    colour = COLOURS[effector_side(touch.effector)]
    name, half = contact_node(touch), sizes.get(touch.effector)
    # A drag needs an area to take hold of: pale where it is only a place, full where it carries.
    made = add_mesh(scene, name, _mark_area(half, LIFT_M), colour, opacity=0.4)
    place_mark(made, touch)
    add_mesh(scene, f"{name}/edge", _mark_edge(half), colour)
    if touching:
        add_mesh(scene, f"{name}/touching", _mark_area(half, TOUCHING_LIFT_M), colour)
    scene.add_label(
        f"{name}/label",
        str(touch.number),
        position=(0.0, 0.0, LABEL_M),
        anchor="bottom-center",
        font_screen_scale=LABEL_SCALE,
    )
    return made


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
