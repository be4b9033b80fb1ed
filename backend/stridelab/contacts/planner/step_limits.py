"""Reach limits and step defaults of a robot for the contact planner.

``contacts`` must not import ``reachability``; ``reachability.planner_limits`` reads the limits from the cards. The
``heading`` limits hold in the frame with z up and x along the trunk's heading, for a robot that stands upright; the
``contact`` limits are those of ``validation``, in the contact frame.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull

from stridelab.contacts.effector_geometry import EffectorReach
from stridelab.conventions import Points, Vector3

HIGH_STEP_SHARE: Final = 1.2
"""Length of the highest step over that of the default step: TALOS cannot follow 0.57 m ahead and 0.17 m up."""
FEET_GAP_M: Final = 0.03
"""Half the gap between two soles side by side."""
FEET_GAP_MIN_M: Final = 0.04
"""Least gap between two soles: shoes are wider, both of HRP-2 by 31 mm in all."""

EASY_AHEAD_SHARE: Final = 1.1
"""Length of an easy step over that of the default step."""
EASY_ASIDE_SHARE: Final = 0.6
"""By how much the soles are farther apart in an easy step to the side, over the default step (TALOS 0.18 m)."""


@dataclass(frozen=True, eq=False)
class EffectorLimits:
    """Limits of one effector: its contact patch and the region of the CoM relative to its contact."""

    kind: Literal["surface", "point"]
    half_size_m: tuple[float, float]
    heading: EffectorReach
    contact: EffectorReach


@dataclass(frozen=True)
class StepDefaults:
    """Default steps of a robot.

    ``toe_gap_m`` is the preferred distance of a sole from edges and risers, ``rise_max_m`` the highest stair. The feet
    swing in turn, ``first_foot`` first if either could; the hands move before every second step. A robot is
    ``body_height_m`` high; a foot keeps ``body_half_size_m`` (ahead, aside) from obstacles as high as the hands, which
    leaves room for the body.
    """

    step_m: float
    rise_max_m: float
    width_m: float
    width_min_m: float
    toe_gap_m: float = 0.05
    body_height_m: float = 1.8
    body_half_size_m: tuple[float, float] = (0.25, 0.40)
    foot_move_s: float = 1.4
    hand_move_s: float = 1.8
    rest_s: float = 0.4
    ends_s: float = 2.0
    first_foot: str = "right_foot"


@dataclass(frozen=True, eq=False)
class RobotLimits:
    """All effectors by name, the largest distance between the feet, and the defaults.

    With ``is_easy``, steps are as short as those of a walk: arms and legs follow them beside walls and in turns, too.
    """

    effectors: Mapping[str, EffectorLimits]
    feet_distance_max_m: float
    defaults: StepDefaults
    is_easy: bool = False

    @property
    def feet(self) -> tuple[str, str]:
        """Left and right foot."""
        return "left_foot", "right_foot"

    def length_per_rise(self, moving: str) -> float:
        """By how much a step becomes shorter per metre of its height: the highest one spans ``HIGH_STEP_SHARE``."""
        high = float(self.offset_box_m(moving)[1][0])
        return max(0.0, high - HIGH_STEP_SHARE * self.defaults.step_m) / self.defaults.rise_max_m

    def offset_box_m(self, moving: str, turn_rad: float = 0.0) -> tuple[Vector3, Vector3]:
        """Bounds of the position of a landing foot relative to the other one, in the heading frame of the landing one.

        ``p_m - p_s`` lies in ``box_s - box_m``, since both limits contain the same CoM, and within the defaults. Feet
        turned by ``turn_rad`` against each other are so much farther apart as the toe or heel of one turns aside.
        """
        still = self.feet[1 - self.feet.index(moving)]
        s, m = self.effectors[still].heading, self.effectors[moving].heading
        low, high = np.subtract(s.com_low_m, m.com_high_m), np.subtract(s.com_high_m, m.com_low_m)
        d = self.feet_distance_max_m * BALL_COVER
        near = self.defaults.width_min_m + self.effectors[still].half_size_m[0] * abs(float(np.sin(turn_rad)))
        ahead, far = d, d
        if self.is_easy:
            ahead = min(d, EASY_AHEAD_SHARE * self.defaults.step_m)
            far = min(d, near + EASY_ASIDE_SHARE * self.defaults.step_m)
        side = (near, far) if moving == self.feet[0] else (-far, -near)
        rise = self.defaults.rise_max_m
        return np.maximum(low, (-ahead, side[0], -rise)), np.minimum(high, (ahead, side[1], rise))


def _cube_directions() -> Points:
    grid = np.array(np.meshgrid(*[(-1.0, 0.0, 1.0)] * 3)).reshape(3, -1).T
    grid = grid[np.abs(grid).any(axis=1)]
    return np.asarray(grid / np.linalg.norm(grid, axis=1)[:, np.newaxis])


DIRECTIONS: Final[Points] = _cube_directions()
"""Unit vectors to the faces, edges and corners of a cube: normals of 26 half-spaces that approximate a ball."""
BALL_COVER: Final = float(np.abs(ConvexHull(DIRECTIONS).equations[:, 3]).min())
"""``{v: n_k v <= COVER r}`` lies inside the ball of radius ``r``: no point of the sphere is farther from the nearest
direction than ``arccos(COVER)``."""


def ball_rows(radius_m: float, low: Vector3, high: Vector3) -> tuple[Points, float]:
    """Half-spaces ``n v <= offset`` that approximate the ball from inside, without those implied by the box."""
    farthest = np.maximum(DIRECTIONS * low, DIRECTIONS * high).sum(axis=1)
    return DIRECTIONS[farthest > BALL_COVER * radius_m], BALL_COVER * radius_m


def heading_frame(yaw_rad: float) -> Float[np.ndarray, "3 3"]:
    """Axes of the heading frame as columns."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
