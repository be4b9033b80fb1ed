"""Reach limits and step defaults of the contact planner, computed from the reachability cards of a robot.

Both measures are used. The ``conditioned`` card gives the region of the CoM of a robot that stands upright, which the
planned steps respect; the wider ``uniform`` one is the limit of the scenario validation. The step defaults scale with
``h``, the highest CoM above a sole in the conditioned card.
"""

from types import MappingProxyType
from typing import Final

import numpy as np

from stridelab.contacts.effector_geometry import EffectorReach, effector_shapes
from stridelab.contacts.planner.step_limits import FEET_GAP_M, FEET_GAP_MIN_M, EffectorLimits, RobotLimits, StepDefaults
from stridelab.errors import NotFound
from stridelab.reachability.card import Reach, ReachabilityCard
from stridelab.reachability.store import load_card

STEP_SHARE: Final = 0.31
"""Step length over h (TALOS: 0.30 m, the depth of its stairs)."""
RISE_SHARE: Final = 0.19
"""Highest stair over h (TALOS: 0.18 m; its shank hits a stair of 0.20 m, but not one of 0.15 m)."""
BODY_HEIGHT_SHARE: Final = 1.85
"""Height of the robot over h (TALOS 1.75, HRP-2 1.73, G1 1.83)."""
BODY_DEPTH_SHARE: Final = 0.25
"""Distance over h from the middle of a sole to the front of the body and of the hands in front of it."""
BODY_WIDTH_SHARE: Final = 0.50
"""Half the width over h, elbows included (TALOS 0.51, HRP-2 0.45, G1 0.35)."""
FEET: Final = ("left_foot", "right_foot")


def planner_limits(robot_name: str) -> RobotLimits:
    """Limits of a robot with two feet.

    Raises ``NotFound`` (``robot-not-found``, ``reachability-not-learned``) and ``UnreadableFile``
    (``reachability-damaged``).
    """
    shapes = effector_shapes(robot_name)
    card = load_card(robot_name, "conditioned")
    effectors = {}
    for name, shape in shapes.items():
        if shape.reach is None or name not in card.effectors:
            raise NotFound("reachability-not-learned", f"The reach of {name} of {robot_name} has not been learned.")
        upright = card.effectors[name].reach
        heading = _intersect_reach(upright, shape.reach) if shape.kind == "surface" else _beside_hand(name, upright)
        effectors[name] = EffectorLimits(shape.kind, shape.half_size_m or (0.0, 0.0), heading, shape.reach)
    h = max(effectors[name].heading.com_high_m[2] for name in FEET)
    soles = sum(effectors[name].half_size_m[1] for name in FEET)
    width_m = soles + 2 * FEET_GAP_M
    defaults = StepDefaults(
        step_m=STEP_SHARE * h,
        rise_max_m=RISE_SHARE * h,
        width_m=width_m,
        width_min_m=soles + FEET_GAP_MIN_M,
        body_height_m=BODY_HEIGHT_SHARE * h,
        body_half_size_m=(BODY_DEPTH_SHARE * h, BODY_WIDTH_SHARE * h - width_m / 2),
    )
    return RobotLimits(MappingProxyType(effectors), _feet_distance_m(card), defaults)


def _feet_distance_m(card: ReachabilityCard) -> float:
    return next(pair.distance_max_m for pair in card.pairs if set(pair.effectors) == set(FEET))


def _beside_hand(name: str, reach: Reach) -> EffectorReach:
    """Reach of a hand on its own side of the CoM: an arm across the trunk can hold the rail of the other one."""
    (x0, y0, z0), (x1, y1, z1) = reach.com_low_m, reach.com_high_m
    low_y, high_y = (y0, min(y1, 0.0)) if name.startswith("left") else (max(y0, 0.0), y1)
    return EffectorReach((x0, low_y, z0), (x1, high_y, z1), reach.com_distance_max_m)


def _intersect_reach(reach: Reach, widest: EffectorReach) -> EffectorReach:
    """Intersection of both limits; on level ground the frame of a sole is the heading frame."""
    low, high = np.maximum(reach.com_low_m, widest.com_low_m), np.minimum(reach.com_high_m, widest.com_high_m)
    (x0, y0, z0), (x1, y1, z1) = low.tolist(), high.tolist()
    return EffectorReach((x0, y0, z0), (x1, y1, z1), min(reach.com_distance_max_m, widest.com_distance_max_m))
