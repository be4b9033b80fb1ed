"""One effector's part of the proxy (4.12): the density of the CoM, and the frame in which it was learned.

    p_i(c | contact) = q_i(R^T (c - p)),     p the contact's place, R the axes of the frame

A sole's axes are those of its contact. A hand that holds a rail may turn about it: what says where the CoM can be is
where the hand is and which way the trunk looks, so that the axes of its heading frame are vertical, and x the heading.
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

    def placement(self, contact: Placement, heading_rad: float) -> Placement:
        """Where the frame is for a contact of the effector, of a robot whose trunk looks along ``heading_rad``."""
        return heading_frame(contact, heading_rad) if self.frame == "heading" else contact

    def log_density(self, com_m: Points, contact: Placement, heading_rad: float) -> Series:
        """``log p_i`` (nats, density per m^3) at ``(n, 3)`` positions of the CoM in the world."""
        return self.mixture.log_density(self.placement(contact, heading_rad).inverse().act(com_m))


def heading_frame(contact: Placement, heading_rad: float) -> Placement:
    """At the contact, z up, x along the heading."""
    c, s = np.cos(heading_rad), np.sin(heading_rad)
    return Placement(contact.position_m, np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))
