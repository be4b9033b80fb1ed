"""Torques of joints that are left beside their dry friction."""

import numpy as np

from stridelab.conventions import Angles


def usable_torques_nm(torque_nm: Angles, friction_nm: Angles) -> Angles:
    """Torques (N m) that are left beside the dry friction: 2 of the 3 N m of TALOS' forearm.

    At least half of ``torque_nm`` is left: the friction of a joint that is weaker than it carries a part of what rests
    on it, and bounds that exclude every torque would make a robot of which only such a joint is wrong stop at once.
    """
    return np.asarray(np.maximum(torque_nm - friction_nm, 0.5 * torque_nm))
