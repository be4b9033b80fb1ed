"""Many small programmes at once: the most room ``t`` that half-spaces and balls leave for a point ``c`` of space.

    t* = max_{c, t} t   such that   a_j c + v_j t <= b_j   and   |c - p_i| <= r_i - w t

A limit with ``v_j = 1`` (``w = 1``) is one from which ``c`` shall stay as far away as it can, one with 0 need only
hold. The problem is convex with four unknowns. The central path of its logarithmic barrier is followed with Newton
steps damped by ``1 / (1 + decrement)``, which stay inside without a line search (Boyd & Vandenberghe, Convex
Optimization, 11.3 and 9.6).
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

ACCURACY_M: Final = 1e-4
"""Bound on the error of ``t*``, for contacts that are a few metres apart."""
SHRINK: Final = 0.3
"""Ratio of successive barrier weights."""
CENTRING_STEPS: Final = 5
"""Newton steps per barrier weight."""

Unknowns = Float[np.ndarray, "s 4"]
"""``(c, t)`` of every programme."""


@dataclass(frozen=True, eq=False)
class Limits:
    """``s`` programmes with ``m`` half-spaces and ``n`` balls each; one that has fewer repeats some of its own.

    ``rows`` are the ``a_j``, ``widths`` the ``v_j``, ``limits`` the ``b_j``; ``ball_width`` is ``w``.
    """

    rows: Float[np.ndarray, "s m 3"]
    widths: Float[np.ndarray, "s m"]
    limits: Float[np.ndarray, "s m"]
    centers: Float[np.ndarray, "s n 3"]
    radii: Float[np.ndarray, "s n"]
    ball_width: float

    def most(self, x: Unknowns) -> tuple[Unknowns, float]:
        """The optima, from strictly feasible ``x``, and the barrier weight at which the path was left."""
        complexity = self.rows.shape[1] + 2 * self.centers.shape[1]
        weight = 1.0
        while weight * complexity > ACCURACY_M:
            weight *= SHRINK
            for _ in range(CENTRING_STEPS):
                x = self._centred(x, weight)
        return x, weight

    def slopes(self, x: Unknowns) -> tuple[Float[np.ndarray, "s m 4"], Float[np.ndarray, "s n 4"]]:
        """Gradients of the logarithms of all slacks; multipliers are ``weight / slack`` on the central path."""
        slack = self.limits - np.einsum("smk,sk->sm", self.rows, x[:, :3]) - self.widths * x[:, 3:]
        flat = np.concatenate([self.rows, self.widths[..., np.newaxis]], axis=2) / -slack[..., np.newaxis]
        w = self.ball_width
        ball = np.concatenate(
            [self.centers - x[:, np.newaxis, :3], (w * (w * x[:, 3:] - self.radii))[..., np.newaxis]], axis=2
        )
        return flat, 2.0 * ball / self._ball_slack(x)[..., np.newaxis]

    def _centred(self, x: Unknowns, weight: float) -> Unknowns:
        """One damped Newton step on ``-t / weight - sum log(slack)``."""
        flat, ball = self.slopes(x)
        grad = -(flat.sum(axis=1) + ball.sum(axis=1))
        grad[:, 3] -= 1.0 / weight
        H = np.einsum("sma,smb->sab", flat, flat) + np.einsum("sna,snb->sab", ball, ball)
        curve = (2.0 / self._ball_slack(x)).sum(axis=1)
        H[:, :3, :3] += curve[:, np.newaxis, np.newaxis] * np.eye(3)
        H[:, 3, 3] -= self.ball_width**2 * curve
        step = -np.linalg.solve(H, grad[..., np.newaxis])[..., 0]
        decrement = np.sqrt(np.maximum(-(grad * step).sum(axis=1), 0.0))
        return np.asarray(x + step / (1.0 + decrement)[:, np.newaxis])

    def _ball_slack(self, x: Unknowns) -> Float[np.ndarray, "s n"]:
        across = ((x[:, np.newaxis, :3] - self.centers) ** 2).sum(axis=2)
        return np.asarray((self.radii - self.ball_width * x[:, 3:]) ** 2 - across)
