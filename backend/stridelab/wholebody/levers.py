"""How far a shape moves when a joint does, in whatever posture.

A point of shape k is never farther from the axis of joint j, which carries it, than

    l_jk = |c_k| + r_k + sum of the links between them ,

``(c_k, r_k)`` the sphere around the shape in its joint's frame. The distance of a pair of shapes therefore changes by
at most ``sum_j l_jk |dq_j|`` over the joints that move one of them against the other: those that carry one and not the
other. Of the base, which moves shapes against the world alone, a rotation counts like that of a joint, and a
translation by itself.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from jaxtyping import Float, Int

from stridelab.conventions import Vector3

Sphere = tuple[Vector3, float]


class Levers(NamedTuple):
    """Per pair and coordinate of the velocity: the sign with which it moves the first against the second, the lever."""

    sign: Float[np.ndarray, "n nv"]
    reach_m: Float[np.ndarray, "n nv"]

    @staticmethod
    def of(
        model: pin.Model, joints: Int[np.ndarray, "n 2"], shapes: Int[np.ndarray, "n 2"], spheres: Sequence[Sphere]
    ) -> "Levers":
        """Of pairs by the joints (0 is the world) and the numbers of their shapes."""
        carries, between_m = _chains(model)
        size_m = np.array([np.linalg.norm(centre) + radius for centre, radius in spheres])
        reach_m = between_m[joints] + size_m[shapes][..., None]
        alone = carries[joints[:, 0]] - carries[joints[:, 1]]
        lever = np.where(alone > 0.0, reach_m[:, 0], reach_m[:, 1])
        columns = np.concatenate([np.full(model.joints[i].nv, i) for i in range(1, model.njoints)]).astype(int)
        sign, reach = alone[:, columns], np.abs(alone[:, columns]) * lever[:, columns]
        straight = np.array([column < 3 or _slides(model, joint) for column, joint in enumerate(columns.tolist())])
        reach[:, straight] = np.abs(sign[:, straight])
        return Levers(sign, reach)


def _chains(model: pin.Model) -> tuple[Float[np.ndarray, "k k"], Float[np.ndarray, "k k"]]:
    """``[i, j]``: 1 where joint j carries the body of joint i, and the length of the links from j to i."""
    n = model.njoints
    carries, between_m = np.zeros((n, n)), np.zeros((n, n))
    for i in range(1, n):
        parent = model.parents[i]
        link_m = float(np.linalg.norm(model.jointPlacements[i].translation)) + _travel_m(model, i)
        carries[i] = carries[parent]
        between_m[i] = np.where(carries[parent] > 0.0, between_m[parent] + link_m, 0.0)
        carries[i, i] = 1.0
    return carries, between_m


def _slides(model: pin.Model, joint: int) -> bool:
    return str(model.joints[joint].shortname()).startswith("JointModelP")


def _travel_m(model: pin.Model, joint: int) -> float:
    """How much a sliding joint can lengthen its link."""
    if not _slides(model, joint):
        return 0.0
    at = model.joints[joint].idx_q
    return float(max(abs(model.lowerPositionLimit[at]), abs(model.upperPositionLimit[at])))
