"""A humanoid robot: a rigid-body model with its end effectors."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.conventions import Points, Rotation
from stridelab.dynamics.spatial import Placement

Group = Literal["leg", "torso", "arm", "head"]
"""Body part that a joint belongs to."""


@dataclass(frozen=True, eq=False)
class Effector:
    """An end effector: a part of the robot that may be in contact with the environment.

    ``T_frame_contact`` places the contact frame in the link frame ``frame``: for a sole its centre on the ground with
    z along the surface normal; for a hand the contact point, x along a bar, z away from the surface.
    ``contact_half_size_m`` are the half edges of a surface's rectangle, ``None`` for a point. ``ankle`` names the
    pitch and the roll joint next to the effector, if it has them.
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

    ``collision`` holds the collision shapes, mostly convex hulls, with the pairs that sampling and control check.
    ``full_collision`` also has the shapes that the card leaves out there for speed, for the certificate and the replay.
    ``q_reference`` ``(nq,)`` stands with both soles on z = 0, centred at x = y = 0 and facing along x. The columns of
    ``R_root_trunk`` and ``R_base_trunk`` are the forward, left and up axes of the trunk in the root link and in
    ``base_frame``; the trunk is upright when they coincide with the world axes. ``group`` maps every actuated joint to
    its body part. ``urdf`` and ``package_dirs`` are what a simulator needs to load the same robot; ``locked`` maps the
    joints that the reduced model leaves out to the angle (rad) at which they are locked. ``sha256`` identifies the
    robot.
    """

    name: str
    title: str
    licence: str
    model: pin.Model
    collision: pin.GeometryModel
    full_collision: pin.GeometryModel
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

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Actuated joints in the order of ``q[7:]``, ``v[6:]`` and of the torques."""
        return tuple(self.model.names)[2:]
