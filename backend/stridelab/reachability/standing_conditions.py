"""The event ``E`` of the measure ``conditioned``: postures of a robot that stands on stairs and beside rails.

Lengths are relative to the leg length ``l``, the largest distance of a sole from its hip, so that one event applies to
robots of any size. Every condition holds relative to each sole: no foot is preferred.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Mask, Points, Rotations

Interval = tuple[float, float]


@dataclass(frozen=True)
class Stance:
    """Flat soles within a step of each other, upright base, bent knees, shanks clear of a step ahead.

    ``ahead``, ``above`` and ``aside`` (minimum, maximum, on its own side) bound the position of the other sole,
    ``toes_deg`` its yaw. ``upright_deg`` bounds the angle between the trunk's z axis and the vertical, and its heading
    relative to the mean of the soles. ``extension`` bounds the distance from the last hip joint to the first ankle
    joint relative to the longest one: a straight leg cannot push, a folded one cannot support the robot. A step of
    height up to ``step`` rises ``toe_gap`` before each toe.
    """

    ahead: float = 0.6
    above: float = 0.25
    aside: Interval = (0.16, 0.5)
    toes_deg: float = 23.0
    upright_deg: float = 20.0
    extension: Interval = (0.58, 0.95)
    step: float = 0.25
    toe_gap: float = 0.055

    def draw_soles(self, n: int, side: float, rng: np.random.Generator) -> tuple[Points, Float[np.ndarray, "n"]]:
        """Draw positions (relative to ``l``) and yaws of the second sole in the frame of the first, not all in ``E``.

        ``side`` is +1 if the second sole is on the left.
        """
        p = rng.uniform([-self.ahead, self.aside[0], -self.above], [self.ahead, self.aside[1], self.above], (n, 3))
        turn = np.radians(self.toes_deg)
        return p * [1.0, side, 1.0], rng.uniform(-turn, turn, n)

    def within_step(self, p: Points, side: float) -> Mask:
        """Whether a sole at ``p`` (relative to ``l``) in the frame of another one is within a step."""
        least, most = self.aside
        return np.asarray(
            (np.abs(p[:, 0]) <= self.ahead)
            & (np.abs(p[:, 2]) <= self.above)
            & (side * p[:, 1] >= least)
            & (side * p[:, 1] <= most)
        )

    def draw_trunks(self, heading_rad: Float[np.ndarray, "n"], rng: np.random.Generator) -> Rotations:
        """Draw world orientations of the trunk with uniform roll, pitch and yaw, not all upright."""
        most = np.radians(self.upright_deg)
        roll, pitch, yaw = rng.uniform(-most, most, (3, len(heading_rad)))
        return np.asarray(axis_rotations(2, heading_rad + yaw) @ axis_rotations(1, pitch) @ axis_rotations(0, roll))

    def is_upright(self, R_world_trunk: Rotations) -> Mask:
        """Whether the trunk is upright."""
        return np.asarray(R_world_trunk[:, 2, 2] >= np.cos(np.radians(self.upright_deg)))


def axis_rotations(axis: int, angle_rad: Float[np.ndarray, "n"]) -> Rotations:
    """Rotations about a coordinate axis (0, 1, 2)."""
    R = np.zeros((len(angle_rad), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R[:, axis, axis] = 1.0
    R[:, i, i] = R[:, j, j] = np.cos(angle_rad)
    R[:, j, i] = np.sin(angle_rad)
    R[:, i, j] = -R[:, j, i]
    return R
