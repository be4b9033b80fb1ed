"""What each check of a certificate means, in one sentence for readers who have not seen its code."""

from collections.abc import Mapping
from typing import Final

from stridelab_web.pages.terms.term import Term

CHAPTER: Final = "/help/theory/whole-body#the-certificate"
"""Where the book defines the checks and their limits."""

CHECK_MEANINGS: Final[Mapping[str, str]] = {
    "solver_failures": "instants at which the controller found no motion",
    "com_error_max": "how far the centre of mass is from its plan",
    "landing_error_max": "how far a foot or hand lands from its contact",
    "landing_angle_max": "how tilted a sole is as it lands",
    "touch_down_speed_max": "how fast a foot or hand is as it lands",
    "contact_drift_max": "how far a foot or hand moves while it should rest",
    "joint_limit_margin": "how far the joint nearest to an end of its range is from it",
    "velocity_ratio_max": "speed of the fastest joint, as a share of its limit",
    "torque_ratio_max_legs_torso": "largest torque of legs and torso, as a share of its limit",
    "torque_ratio_max_arms": "largest torque of the arms, as a share of its limit",
    "friction_cone_margin": "how much more sideways force a contact could carry before it slips",
    "dynamics_residual": "force that gravity, contacts and motion leave unexplained",
    "torque_residual": "torque that differs from an independent calculation",
    "integration_gap": "how far speeds and positions disagree",
    "self_collision_pairs": "parts of the body that meet each other",
    "terrain_distance_min": "the smallest distance of any part from the terrain",
    "leg_terrain_distance_min": "the smallest distance of a leg from the terrain",
    "arm_terrain_distance_min": "the smallest distance of an arm from what it does not hold",
    "hand_depth_max": "how deep a hand is in its surface as it comes or leaves",
    "hand_load_share_max": "force of a hand, as a share of what its arm can exert there",
    "reachability_log_density_min": "how usual the place of the centre of mass is for this contact",
    "angular_momentum_mismatch_max": "rotation of the body that the plan did not have",
}


def check_term(name: str) -> Term | None:
    """The explanation of the check ``name``; None for one of another version."""
    return Term(CHECK_MEANINGS[name], CHAPTER) if name in CHECK_MEANINGS else None
