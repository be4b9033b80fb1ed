"""The event ``E`` of the measure ``conditioned``: a robot that stands as it does on stairs and beside rails.

Lengths are shares of the leg's length ``l``, the largest distance of a sole from its hip, so that one event serves
robots of any size. Every condition holds seen from each sole: no foot is preferred.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Mask, Points, Rotations

Interval = tuple[float, float]


@dataclass(frozen=True)
class Stance:
    """Soles flat, the one where the other can step; base upright; knees bent; shanks clear of a step ahead.

    ``ahead``, ``above`` and ``aside`` (least, most, on its own side) say where the other sole is, ``toes_deg`` by how
    much it is turned. ``upright_deg`` bounds the angle between the trunk's z axis and the vertical, and its heading
    from the mean one of the soles. ``extension`` is the distance from the hip's last joint to the ankle's first over
    the longest one: a leg that is straight cannot push, one that is folded cannot carry. A step as high as ``step`` at
    most rises ``toe_gap`` before each toe.
    """

    ahead: float = 0.6
    above: float = 0.25
    aside: Interval = (0.16, 0.5)
    toes_deg: float = 23.0
    upright_deg: float = 20.0
    extension: Interval = (0.58, 0.95)
    step: float = 0.25
    toe_gap: float = 0.055

    def drawn_soles(self, n: int, side: float, rng: np.random.Generator) -> tuple[Points, Float[np.ndarray, "n"]]:
        """Places (shares of ``l``) and headings of a second sole seen from a first one, uniform; some are not in ``E``.

        ``side`` is +1 where the second sole is on the left.
        """
        p = rng.uniform([-self.ahead, self.aside[0], -self.above], [self.ahead, self.aside[1], self.above], (n, 3))
        turn = np.radians(self.toes_deg)
        return p * [1.0, side, 1.0], rng.uniform(-turn, turn, n)

    def stepped(self, p: Points, side: float) -> Mask:
        """Whether a sole at ``p`` (shares of ``l``) in the frame of another one is where a step may put it."""
        least, most = self.aside
        return np.asarray(
            (np.abs(p[:, 0]) <= self.ahead)
            & (np.abs(p[:, 2]) <= self.above)
            & (side * p[:, 1] >= least)
            & (side * p[:, 1] <= most)
        )

    def drawn_bases(self, heading_rad: Float[np.ndarray, "n"], rng: np.random.Generator) -> Rotations:
        """Orientations of the trunk in the world: roll, pitch and yaw uniform; some are not upright."""
        most = np.radians(self.upright_deg)
        roll, pitch, yaw = rng.uniform(-most, most, (3, len(heading_rad)))
        return np.asarray(about(2, heading_rad + yaw) @ about(1, pitch) @ about(0, roll))

    def upright(self, R_world_trunk: Rotations) -> Mask:
        """Whether the trunk stands upright."""
        return np.asarray(R_world_trunk[:, 2, 2] >= np.cos(np.radians(self.upright_deg)))


def about(axis: int, angle_rad: Float[np.ndarray, "n"]) -> Rotations:
    """Rotations about a coordinate axis (0, 1, 2)."""
    R = np.zeros((len(angle_rad), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R[:, axis, axis] = 1.0
    R[:, i, i] = R[:, j, j] = np.cos(angle_rad)
    R[:, j, i] = np.sin(angle_rad)
    R[:, i, j] = -R[:, j, i]
    return R
