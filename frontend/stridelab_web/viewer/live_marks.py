"""What the page shapes in a scenario's scene: the CoM's way as it would be planned now, and after a push.

The page gives the tubes their places whenever the service has answered (static/js/live_view.js); until then they are
points.
"""

import numpy as np
import viser

from stridelab_web.viewer import shapes
from stridelab_web.viewer.parts import Colour, add_mesh
from stridelab_web.viewer.planner_scene import COM_COLOUR

PLANNED, RECOVERED, PUSH = "/live/planned", "/live/recovered", "/live/push"
RECOVERED_COLOUR: Colour = (150, 60, 160)
PUSH_COLOUR: Colour = (196, 30, 58)
RINGS, SIDES = 160, 6
"""Of the tubes: the page brings every path to so many points."""
RADIUS_M, PUSH_RADIUS_M = 0.008, 0.012


def add_live(scene: viser.SceneApi) -> None:
    """The nodes below ``/live``."""
    path_m = np.column_stack([np.zeros((RINGS, 2)), np.linspace(0.0, 1e-3, RINGS)])
    add_mesh(scene, PLANNED, shapes.tube(path_m, RADIUS_M, SIDES), COM_COLOUR)
    add_mesh(scene, RECOVERED, shapes.tube(path_m, RADIUS_M, SIDES), RECOVERED_COLOUR)
    add_mesh(scene, PUSH, shapes.tube(path_m[:2], PUSH_RADIUS_M, SIDES), PUSH_COLOUR)
