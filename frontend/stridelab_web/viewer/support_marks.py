"""What the page shapes in a scenario's scene: where contacts hold the robot at rest, and the best place for its CoM.

The page gives the region its corners and puts the rest where the judge says (static/js/support_view.js); until then
there is a small circle.
"""

import numpy as np
import viser

from stridelab_web.viewer import shapes
from stridelab_web.viewer.parts import Colour, add_mesh
from stridelab_web.viewer.planner_scene import COM_COLOUR, add_com

REGION, EDGE, PLUMB, COM = "/support/region", "/support/edge", "/support/plumb", "/support/com"
COLOUR: Colour = (0, 121, 107)
"""Neither foot, hand nor force has it."""
CORNERS = 64
"""Of the region; the page fills up those that a polygon does not need with its last one."""
OPACITY = 0.3
RADIUS_M, PLUMB_RADIUS_M = 0.01, 0.004


def add_support(scene: viser.SceneApi) -> None:
    """The nodes below ``/support``."""
    angle = 2 * np.pi * np.arange(CORNERS) / CORNERS
    circle = RADIUS_M * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    add_mesh(scene, REGION, shapes.polygon(circle), COLOUR, opacity=OPACITY)
    add_mesh(scene, EDGE, shapes.between(circle, 0.9 * circle), COLOUR)
    add_mesh(scene, PLUMB, shapes.cylinder(PLUMB_RADIUS_M), COM_COLOUR, side="front")
    add_com(scene, COM)
