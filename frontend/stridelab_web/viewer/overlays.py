"""What the page shapes in a scenario's scene: the CoM's way as it would be planned now, and after a push.

The page gives the tubes their places whenever the service has answered (static/js/editor/live_preview.js); until
then they are points.

What the page shapes in a scenario's scene: where contacts hold the robot at rest, and the best place for its CoM.

The page gives the region its corners and puts the rest where the judge says (static/js/editor/support_overlay.js);
until then there is a small circle.
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
"""Of the tubes: the page brings every path to so many points."""
RADIUS_M, PUSH_RADIUS_M = 0.008, 0.012


def add_live(scene: viser.SceneApi) -> None:
    """The nodes below ``/live``."""
    path_m = np.column_stack([np.zeros((RINGS, 2)), np.linspace(0.0, 1e-3, RINGS)])
    add_mesh(scene, PLANNED, meshes.tube(path_m, RADIUS_M, SIDES), COM_COLOUR)
    add_mesh(scene, RECOVERED, meshes.tube(path_m, RADIUS_M, SIDES), RECOVERED_COLOUR)
    add_mesh(scene, PUSH, meshes.tube(path_m[:2], PUSH_RADIUS_M, SIDES), PUSH_COLOUR)


REGION, EDGE, PLUMB, COM = "/support/region", "/support/edge", "/support/plumb", "/support/com"
COLOUR: Colour = (0, 121, 107)
"""Neither foot, hand nor force has it."""
CORNERS = 64
"""Of the region; the page fills up those that a polygon does not need with its last one."""
OPACITY = 0.3
SUPPORT_MARKS_RADIUS_M, PLUMB_RADIUS_M = 0.01, 0.004


def add_support(scene: viser.SceneApi) -> None:
    """The nodes below ``/support``."""
    angle = 2 * np.pi * np.arange(CORNERS) / CORNERS
    circle = SUPPORT_MARKS_RADIUS_M * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    add_mesh(scene, REGION, meshes.polygon(circle), COLOUR, opacity=OPACITY)
    add_mesh(scene, EDGE, meshes.between(circle, 0.9 * circle), COLOUR)
    add_mesh(scene, PLUMB, meshes.cylinder(PLUMB_RADIUS_M), COM_COLOUR, side="front")
    add_com(scene, COM)
