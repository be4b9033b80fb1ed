"""How much room the reach limits of several contacts leave for one CoM position.

With contact frames ``(R_i, p_i)``, boxes ``[l_i, u_i]`` and spheres of radius ``r_i`` the slack of a set of contacts is

    t* = max_{c, t} t   such that   l_i + t <= R_i^T (c - p_i) <= u_i - t   and   |c - p_i| <= r_i - t   for all i

positive where one position satisfies all limits, negative by how much all limits would have to be widened: a
programme of ``central_path`` in which every limit has room to give.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.contacts.central_path import Limits, Unknowns
from stridelab.contacts.shapes import EffectorReach
from stridelab.conventions import Points, Vector3
from stridelab.dynamics.placement import Placement

ReachSet = Sequence[tuple[Placement, EffectorReach]]
"""Contacts that must be reached from one CoM position."""


@dataclass(frozen=True, eq=False)
class Slack:
    """Answer for one set.

    ``slack_m`` is ``t*``, ``com_m`` the position that attains it. ``pull`` ``(n, 3)`` is the gradient of ``t*`` with
    respect to the place of each contact; the rows sum to zero.
    """

    slack_m: float
    com_m: Vector3
    pull: Points


def slacks(sets: Sequence[ReachSet]) -> list[Slack]:
    """``t*`` of every set; none of them may be empty."""
    if not sets:
        return []
    problem = ReachLimits.of(sets)
    x, weight = problem.limits.most(problem.start())
    flat, ball = problem.limits.slopes(x)
    pulls = -weight * (flat.reshape(*ball.shape[:2], 6, 4).sum(axis=2) + ball)[..., :3]
    com_m = problem.world_m(x)
    return [Slack(float(problem.scale[i] * x[i, 3]), com_m[i], pulls[i, : len(group)]) for i, group in enumerate(sets)]


@dataclass(frozen=True, eq=False)
class ReachLimits:
    """All sets in one array, lengths from ``origin_m`` in units of ``scale``; small sets repeat a contact."""

    limits: Limits
    origin_m: Float[np.ndarray, "s 3"]
    scale: Float[np.ndarray, "s"]

    @staticmethod
    def of(sets: Sequence[ReachSet], width: float = 1.0) -> "ReachLimits":
        """``width`` 1 asks for room to every limit, 0 only that they hold."""
        n = max(len(group) for group in sets)
        full = [[*group, *[group[0]] * (n - len(group))] for group in sets]
        p = np.array([[at.position_m for at, _ in group] for group in full])
        R = np.array([[at.rotation for at, _ in group] for group in full])
        low, high = (np.array([[getattr(r, key) for _, r in group] for group in full]) for key in _BOUNDS)
        origin = p.mean(axis=1)
        p = p - origin[:, np.newaxis]
        scale = np.maximum(1.0, np.abs(p).max(axis=(1, 2)))
        axes = np.swapaxes(R, 2, 3)
        offset = np.einsum("sikj,sij->sik", axes, p)
        rows = np.concatenate([axes, -axes], axis=2).reshape(len(sets), -1, 3)
        room = np.concatenate([offset + high, -offset - low], axis=2).reshape(len(sets), -1) / scale[:, np.newaxis]
        radii = np.array([[reach.com_distance_max_m for _, reach in group] for group in full]) / scale[:, np.newaxis]
        centers = p / scale[:, np.newaxis, np.newaxis]
        return ReachLimits(Limits(rows, np.full(room.shape, width), room, centers, radii, width), origin, scale)

    def start(self) -> Unknowns:
        """The middle of the contacts, with ``t`` so low that every limit holds with room."""
        balls = self.limits.radii - np.linalg.norm(self.limits.centers, axis=2)
        room = np.minimum(self.limits.limits.min(axis=1), balls.min(axis=1))
        return np.column_stack([np.zeros((len(room), 3)), room - 1.0])

    def world_m(self, x: Unknowns) -> Points:
        """The points ``c`` in the world."""
        return np.asarray(self.scale[:, np.newaxis] * x[:, :3] + self.origin_m)


_BOUNDS: Final = ("com_low_m", "com_high_m")
