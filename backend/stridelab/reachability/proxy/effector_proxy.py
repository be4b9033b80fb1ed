"""The factor of one effector in the proxy (4.12): the density of the CoM and the frame in which it is learned.

    p_i(c | contact) = q_i(R^T (c - p)),     p the position of the contact, R the axes of the frame

The axes of a sole are those of its contact. A hand on a rail can rotate about it, so that the region of the CoM depends
on the position of the hand and the heading of the trunk: its heading frame has z up and x along the heading.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from stridelab.conventions import Points, Series
from stridelab.dynamics.spatial import Placement
from stridelab.reachability.gaussian_mixture import Mixture

Frame = Literal["contact", "heading"]
"""The contact frame of the effector, or its heading frame: at the contact, z up, x the heading of the trunk."""


@dataclass(frozen=True, eq=False)
class Proxy:
    """``mixture`` (metres) in the ``frame`` of an effector."""

    mixture: Mixture
    frame: Frame = "contact"

    def frame_placement(self, contact: Placement, heading_rad: float) -> Placement:
        """Pose of the frame for a contact of the effector, given the heading of the trunk."""
        return heading_frame(contact, heading_rad) if self.frame == "heading" else contact

    def log_density(self, com_m: Points, contact: Placement, heading_rad: float) -> Series:
        """``log p_i`` (nats, density per m^3) at ``(n, 3)`` positions of the CoM in the world."""
        return self.mixture.log_density(self.frame_placement(contact, heading_rad).inverse().act(com_m))


def heading_frame(contact: Placement, heading_rad: float) -> Placement:
    """The frame at the contact with z up and x along the heading."""
    c, s = np.cos(heading_rad), np.sin(heading_rad)
    return Placement(contact.position_m, np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))
