"""A humanoid as the robot wing sees it: a rigid-body model with the effectors by which it touches the world."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.conventions import Points, Rotation
from stridelab.dynamics.spatial import Placement

Group = Literal["leg", "torso", "arm", "head"]
"""Where in the body a joint lies."""


@dataclass(frozen=True, eq=False)
class Effector:
    """A part of the robot that may touch the world.

    ``T_frame_contact`` places the contact frame in the link frame ``frame``: for a sole its centre on the ground with
    z along the surface normal; for a hand the point that touches, x along a bar, z away from the surface.
    ``contact_half_size_m`` are the half edges of a surface's rectangle, ``None`` for a point. ``ankle`` names the
    pitch and the roll joint next to the effector where it has them.
    """

    name: str
    frame: str
    kind: Literal["surface", "point"]
    T_frame_contact: Placement
    contact_half_size_m: tuple[float, float] | None = None
    ankle: tuple[str, str] | None = None

    def points_m(self, margin_m: float = 0.0) -> Points:
        """Contact points ``(k, 3)`` in the contact frame, a surface's rectangle shrunk by ``margin_m`` on all sides.

        Corners come in the order of ``conventions.Corners``: (+x, +y), (-x, +y), (-x, -y), (+x, -y); a point is the
        frame's origin.
        """
        if self.contact_half_size_m is None:
            return np.zeros((1, 3))
        x, y = (half - margin_m for half in self.contact_half_size_m)
        return np.array([[x, y, 0.0], [-x, y, 0.0], [-x, -y, 0.0], [x, -y, 0.0]])


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot with a floating base; ``model`` is reduced to the joints that move in a motion.

    ``collision`` holds the shapes that can touch, mostly convex hulls, with the pairs that are checked.
    ``q_reference`` ``(nq,)`` stands with both soles on z = 0, between them x = y = 0, and looks along x. The columns of
    ``R_root_trunk`` and ``R_base_trunk`` are the trunk's axes ahead, left and up, in the axes of the root link and of
    ``base_frame``: the trunk is upright where they are those of the world. ``group`` says of every
    actuated joint where in the body it lies. ``urdf`` and ``package_dirs`` are what a simulator needs to load the
    same robot; ``locked`` maps the joints that the reduced model leaves out to the angle (rad) at which they are
    held. ``sha256`` identifies all of it.
    """

    name: str
    title: str
    licence: str
    model: pin.Model
    collision: pin.GeometryModel
    effectors: Mapping[str, Effector]
    base_frame: str
    R_root_trunk: Rotation
    R_base_trunk: Rotation
    q_reference: Float[np.ndarray, "nq"]
    group: Mapping[str, Group]
    urdf: Path
    package_dirs: tuple[Path, ...]
    locked: Mapping[str, float]
    sha256: str

    @property
    def mass_kg(self) -> float:
        """Total mass."""
        return float(pin.computeTotalMass(self.model))

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Actuated joints in the order of ``q[7:]``, ``v[6:]`` and of the torques."""
        return tuple(self.model.names)[2:]
