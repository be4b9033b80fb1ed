"""Overlays of a scenario's scene: the planned path of the CoM, its path after a push, and the support region.

The page shapes them with the responses of the service (static/js/editor/live_preview.js, support_overlay.js);
until then the tubes are points and the region is a small circle.
"""

import numpy as np
import viser

from stridelab_web.viewer import meshes
from stridelab_web.viewer.plan_scene import COM_COLOUR, add_com
from stridelab_web.viewer.scene_parts import Colour, add_mesh

PLANNED, RECOVERED, PUSH = "/live/planned", "/live/recovered", "/live/push"
RECOVERED_COLOUR: Colour = (150, 60, 160)
PUSH_COLOUR: Colour = (196, 30, 58)
RINGS, SIDES = 160, 6
"""Size of the tubes; the page resamples every path to this number of points."""
RADIUS_M, PUSH_RADIUS_M = 0.008, 0.012


def add_live_paths(scene: viser.SceneApi) -> None:
    """Add the nodes below ``/live``."""
    path_m = np.column_stack([np.zeros((RINGS, 2)), np.linspace(0.0, 1e-3, RINGS)])
    add_mesh(scene, PLANNED, meshes.tube(path_m, RADIUS_M, SIDES), COM_COLOUR)
    add_mesh(scene, RECOVERED, meshes.tube(path_m, RADIUS_M, SIDES), RECOVERED_COLOUR)
    add_mesh(scene, PUSH, meshes.tube(path_m[:2], PUSH_RADIUS_M, SIDES), PUSH_COLOUR)


REGION, EDGE, PLUMB, COM = "/support/region", "/support/edge", "/support/plumb", "/support/com"
COLOUR: Colour = (0, 121, 107)
"""Colour that no foot, hand or force has."""
CORNERS = 64
"""Corners of the region; for smaller polygons the page repeats the last one."""
OPACITY = 0.3
SUPPORT_MARKS_RADIUS_M, PLUMB_RADIUS_M = 0.01, 0.004


def add_support_region(scene: viser.SceneApi) -> None:
    """Add the nodes below ``/support``: region, its edge, and the best position of the CoM."""
    angle = 2 * np.pi * np.arange(CORNERS) / CORNERS
    circle = SUPPORT_MARKS_RADIUS_M * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    add_mesh(scene, REGION, meshes.polygon(circle), COLOUR, opacity=OPACITY)
    add_mesh(scene, EDGE, meshes.band_between(circle, 0.9 * circle), COLOUR)
    add_mesh(scene, PLUMB, meshes.cylinder(PLUMB_RADIUS_M), COM_COLOUR, side="front")
    add_com(scene, COM)
