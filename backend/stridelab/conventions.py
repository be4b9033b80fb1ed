"""Units, frames and array aliases of the whole project.

World frame: z up, right-handed. Metres, seconds, kilograms, newtons, radians everywhere inside the code;
other units are converted once, where a file is read or written. Forces act *on the body*. Wrenches are
(force, moment) with the moment at the world origin unless a name says otherwise. Quaternions are ``wxyz``;
``T_world_foot`` maps foot coordinates to world coordinates. Time axes start at 0, the first frame of the
recording.

Gravity points down, as in (4.2) of the thesis: standing still means ``f = -m g``. Chapter 2 of the thesis uses the
opposite sign (2.3); ``dynamics`` converts its equations to this convention.
"""

from collections.abc import Callable
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

GRAVITY_M_S2: Final = 9.81
"""Norm of the gravity field."""

g: Final = np.array([0.0, 0.0, -GRAVITY_M_S2])
"""Gravity vector of (4.2), in m/s^2."""
g.flags.writeable = False

Vector3 = Float[np.ndarray, "3"]
"""A point, force or moment."""
PerAxis = Float[np.ndarray, "3"]
"""One number for each of x, y and z: errors, residuals, coverages."""
Points = Float[np.ndarray, "n 3"]
"""One 3D point (or force, or moment) per sample."""
Series = Float[np.ndarray, "n"]
"""One number per sample."""
Mask = Bool[np.ndarray, "n"]
"""One truth value per sample."""
Corners = Float[np.ndarray, "4 3"]
"""Corners of a plate in the order of its own quadrants: (+x, +y), (-x, +y), (-x, -y), (+x, -y)."""
Rotation = Float[np.ndarray, "3 3"]
Rotations = Float[np.ndarray, "n 3 3"]
Angles = Float[np.ndarray, "na"]
"""One number per actuated joint of a robot."""
Configurations = Float[np.ndarray, "n nq"]
"""One configuration of a robot per sample."""

Progress = Callable[[float, str], None]
"""Progress callback: called with the completed fraction (0 to 1) and the name of the current stage."""
