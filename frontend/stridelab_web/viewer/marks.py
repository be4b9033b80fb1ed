"""Touches as marks on the terrain: a footprint with its toe, or a disc for a hand, in the colour of the effector."""

import numpy as np
import viser

from stridelab.schemas.scenarios import Scenario
from stridelab_web.footholds import HalfSizes, node, side
from stridelab_web.touches import Touch, touches
from stridelab_web.viewer import shapes
from stridelab_web.viewer.parts import Colour, add_mesh

COLOURS: dict[str, Colour] = {"left": (11, 92, 156), "right": (224, 138, 30), "hand": (86, 97, 108)}
"""The same as on the pages (app.css): told apart with every kind of colour vision, and numbers say the rest."""
HAND_RADIUS_M = 0.045
EDGE_M = 0.012
LIFT_M, TOUCHING_LIFT_M = 0.004, 0.006
TOE = 0.45
"""Length of the toe's triangle beyond the patch, as a share of its half width."""


def add_marks(
    scene: viser.SceneApi, scenario: Scenario, sizes: HalfSizes, touching: bool
) -> dict[int, viser.MeshHandle]:
    """A mark per touch of ``scenario``, by number; with ``touching`` a second, full one, shown while it is loaded."""
    made = {}
    for touch in touches(scenario):
        colour = COLOURS[side(touch.effector)]
        half = sizes.get(touch.effector)
        outline = _outline(half)
        name = node(touch)
        # A drag needs an area to take hold of: pale where it is only a place, full where it carries.
        made[touch.number] = add_mesh(scene, name, _lifted(shapes.polygon(outline), LIFT_M), colour, opacity=0.35)
        place(made[touch.number], touch)
        inner = outline * (1 - EDGE_M / np.abs(outline).max())
        add_mesh(scene, f"{name}/edge", _lifted(shapes.between(outline, inner), LIFT_M), colour)
        if touching:
            add_mesh(scene, f"{name}/touching", _lifted(shapes.polygon(outline), TOUCHING_LIFT_M), colour)
        scene.add_label(f"{name}/label", str(touch.number), position=(0.0, 0.0, 0.03), anchor="bottom-center")
    return made


def place(handle: viser.MeshHandle, touch: Touch) -> None:
    """Put a mark where its touch is."""
    handle.position = touch.contact.position_m
    handle.wxyz = touch.contact.orientation_wxyz


def _outline(half_m: tuple[float, float] | None) -> np.ndarray:
    """Corners ``(n, 3)`` in the contact frame, counterclockwise: a sole with its toe, or a disc."""
    if half_m is None:
        angle = 2 * np.pi * np.arange(20) / 20
        flat = HAND_RADIUS_M * np.column_stack([np.cos(angle), np.sin(angle)])
    else:
        x, y = half_m
        flat = np.array([[x, -y], [x + TOE * y, 0.0], [x, y], [-x, y], [-x, -y]])
    return np.column_stack([flat, np.zeros(len(flat))])


def _lifted(mesh: shapes.Mesh, lift_m: float) -> shapes.Mesh:
    vertices, faces = mesh
    return vertices + np.array([0.0, 0.0, lift_m], dtype=np.float32), faces
