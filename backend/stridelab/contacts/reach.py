"""How much room the reach limits of several contacts leave for one CoM position.

With contact frames ``(R_i, p_i)``, boxes ``[l_i, u_i]`` and spheres of radius ``r_i`` the slack of a set of contacts is

    t* = max_{c, t} t   such that   l_i + t <= R_i^T (c - p_i) <= u_i - t   and   |c - p_i| <= r_i - t   for all i

positive where one position satisfies all limits, negative by how much all limits would have to be widened. The
problem is convex with four unknowns; many sets are solved at once by following the central path of its logarithmic
barrier with Newton steps damped by ``1 / (1 + decrement)``, which stay inside without a line search
(Boyd & Vandenberghe, Convex Optimization, 11.3 and 9.6).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.contacts.shapes import EffectorReach
from stridelab.conventions import Points, Vector3
from stridelab.dynamics.placement import Placement

ACCURACY_M: Final = 1e-4
"""Bound on the error of ``t*``, for contacts that are a few metres apart."""
SHRINK: Final = 0.3
"""Ratio of successive barrier weights."""
CENTRING_STEPS: Final = 5
"""Newton steps per barrier weight."""

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
    problem = _Problem(sets)
    x, weight = problem.start(), 1.0
    while weight * problem.complexity > ACCURACY_M:
        weight *= SHRINK
        for _ in range(CENTRING_STEPS):
            x = problem.centred(x, weight)
    pulls = problem.pulls(x, weight)
    unscaled = problem.scale[:, np.newaxis] * x
    return [
        Slack(float(unscaled[i, 3]), unscaled[i, :3] + problem.origin[i], pulls[i, : len(group)])
        for i, group in enumerate(sets)
    ]


class _Problem:
    """All sets in one array; sets with fewer contacts repeat their first one. Lengths are divided by ``scale``."""

    def __init__(self, sets: Sequence[ReachSet]) -> None:
        n = max(len(group) for group in sets)
        full = [[*group, *[group[0]] * (n - len(group))] for group in sets]
        p = np.array([[at.position_m for at, _ in group] for group in full])
        R = np.array([[at.rotation for at, _ in group] for group in full])
        low, high = (np.array([[getattr(r, key) for _, r in group] for group in full]) for key in _BOUNDS)
        self.origin: Float[np.ndarray, "s 3"] = p.mean(axis=1)
        p = p - self.origin[:, np.newaxis]
        self.scale: Float[np.ndarray, "s"] = np.maximum(1.0, np.abs(p).max(axis=(1, 2)))
        scale = self.scale[:, np.newaxis, np.newaxis]
        axes = np.swapaxes(R, 2, 3)
        offset = np.einsum("sikj,sij->sik", axes, p)
        self.rows = np.concatenate([axes, -axes], axis=2)
        self.limits = np.concatenate([offset + high, -offset - low], axis=2) / scale
        self.p = p / scale
        self.r = np.array([[reach.com_distance_max_m for _, reach in group] for group in full]) / scale[:, 0]
        self.complexity = 8 * n

    def start(self) -> Float[np.ndarray, "s 4"]:
        """The middle of the contacts, with ``t`` so low that every limit holds with room."""
        room = np.minimum(self.limits.min(axis=(1, 2)), (self.r - np.linalg.norm(self.p, axis=2)).min(axis=1))
        return np.column_stack([np.zeros((len(room), 3)), room - 1.0])

    def centred(self, x: Float[np.ndarray, "s 4"], weight: float) -> Float[np.ndarray, "s 4"]:
        """One damped Newton step on ``-t / weight - sum log(slack)``."""
        box, ball = self._slopes(x)
        grad = -(box.sum(axis=1) + ball.sum(axis=1))
        grad[:, 3] -= 1.0 / weight
        H = np.einsum("sma,smb->sab", box, box) + np.einsum("sma,smb->sab", ball, ball)
        curve = 2.0 / self._ball_slack(x)
        H[:, :3, :3] += curve.sum(axis=1)[:, np.newaxis, np.newaxis] * np.eye(3)
        H[:, 3, 3] -= curve.sum(axis=1)
        step = -np.linalg.solve(H, grad[..., np.newaxis])[..., 0]
        decrement = np.sqrt(np.maximum(-(grad * step).sum(axis=1), 0.0))
        return np.asarray(x + step / (1.0 + decrement)[:, np.newaxis])

    def pulls(self, x: Float[np.ndarray, "s 4"], weight: float) -> Float[np.ndarray, "s n 3"]:
        """``sum_j lambda_j a_j`` per contact, the multipliers being ``weight / slack`` on the central path."""
        box, ball = self._slopes(x)
        per_contact = box.reshape(*self.rows.shape[:3], 4).sum(axis=2) + ball
        return np.asarray(-weight * per_contact[..., :3])

    def _ball_slack(self, x: Float[np.ndarray, "s 4"]) -> Float[np.ndarray, "s n"]:
        return np.asarray((self.r - x[:, 3:]) ** 2 - ((x[:, np.newaxis, :3] - self.p) ** 2).sum(axis=2))

    def _slopes(self, x: Float[np.ndarray, "s 4"]) -> tuple[Float[np.ndarray, "s m 4"], Float[np.ndarray, "s n 4"]]:
        """Gradients of ``log(slack)`` of the faces of all boxes and of all spheres."""
        slack = self.limits - np.einsum("simk,sk->sim", self.rows, x[:, :3]) - x[:, 3, np.newaxis, np.newaxis]
        box = np.concatenate([self.rows, np.ones((*self.rows.shape[:3], 1))], axis=3) / -slack[..., np.newaxis]
        ball = np.concatenate([self.p - x[:, np.newaxis, :3], (x[:, 3:] - self.r)[..., np.newaxis]], axis=2)
        ball = 2.0 * ball / self._ball_slack(x)[..., np.newaxis]
        return box.reshape(len(x), -1, 4), ball


_BOUNDS: Final = ("com_low_m", "com_high_m")
