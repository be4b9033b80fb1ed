"""Choice of the next step from the capture point: where and when the swinging sole lands.

The capture point xi diverges from the centre of pressure p, which stays in the standing sole, so that at a landing after T

    xi(T) = p + (xi - p) exp(w T) .

The robot can come to rest if xi(T) is in the convex hull of both soles, here the segment between their centres widened
by half a sole. Of a grid of places within the reach of the leg and of times not before the leg can be there, the step is
taken whose excess over that hull is smallest, after this step and after another one of the other leg (the capture
regions of Koolen 2012 for one and two steps, with timing as in Khadiv 2020).
"""

import os
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stridelab.wholebody.recovery.footholds import Footholds

Shift = Float[np.ndarray, "2"]


@dataclass(frozen=True)
class StepLimits:
    """Reach and speed of a swing relative to the standing sole; lengths are shares of ``leg_m``.

    ``aside`` is the range of the distance to the side, in m; ``speed_m_s`` and ``least_s`` bound the time of a swing.
    """

    ahead_m: float
    back_m: float
    aside_m: tuple[float, float]
    nominal_m: float
    half_m: tuple[float, float]
    speed_m_s: float = 3.0
    acceleration_m_s2: float = float(os.environ.get('AC','22'))
    down_m_s: float = 0.6
    least_ground_s: float = 0.22
    delay_cost: float = 20.0
    next_s: float = 0.42
    margin_m: float = 0.02


@dataclass(frozen=True, eq=False)
class Step:
    """A step: the place of the sole's centre (world), its height, time to landing, predicted capture point, cost."""

    place_m: Shift
    height_m: float
    in_s: float
    capture_m: Shift
    pressure_m: Shift
    cost: float


def segment_excess(
    points: np.ndarray, ends: np.ndarray, half: np.ndarray
) -> tuple[Float[np.ndarray, "*n"], np.ndarray]:
    """Distance of points beyond the hull of a sole at the origin and one at ``ends``, and the nearest segment point."""
    length2 = np.maximum((ends * ends).sum(axis=-1), 1e-9)
    share = np.clip((points * ends).sum(axis=-1) / length2, 0.0, 1.0)
    nearest = share[..., None] * ends
    beyond = np.maximum(np.abs(points - nearest) - half, 0.0)
    return np.hypot(beyond[..., 0], beyond[..., 1]), nearest


class StepChooser:
    """Grid search over places and times."""

    def __init__(self, limits: StepLimits, footholds: Footholds) -> None:
        self._limits, self._footholds = limits, footholds
        x = np.linspace(-limits.back_m, limits.ahead_m, 33)
        y = np.linspace(*limits.aside_m, 11)
        self._grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
        self._later_s = np.array([0.0, 0.03, 0.06, 0.09, 0.12, 0.16, 0.22, 0.3, 0.45])

    def choose(
        self,
        capture_m: Shift,
        rate_per_s: float,
        stance_m: np.ndarray,
        swing_m: np.ndarray,
        swing_v_m_s: np.ndarray,
        axes: Float[np.ndarray, "2 2"],
        side: float,
        in_air: bool,
        last: Step | None,
        desired_m: Shift | None = None,
        wait_s: float = 0.0,
    ) -> Step | None:
        """The best step; ``axes`` has the heading's forward and left axes as columns, ``side`` is 1 for a left sole.

        None without a foothold.
        """
        by = self._limits
        half = np.array(by.half_m)
        local = self._grid * [1.0, side]
        places = stance_m[:2] + local @ axes.T
        corners = (np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * (half + 0.015)) @ axes.T
        heights = self._footholds.sole_heights_m(places, corners)
        known = np.isfinite(heights) & (np.abs(heights - stance_m[2]) < 0.25)
        if not known.any():
            return None
        local, places, heights = local[known], places[known], heights[known]
        away = np.hypot(np.hypot(*(places - swing_m[:2]).T), heights - swing_m[2])
        D = ((places - swing_m[:2]) @ axes)[:, None, :]
        down_s = np.maximum(swing_m[2] - heights, 0.0) / by.down_m_s + 0.02
        up_s = np.sqrt(5.77 * np.maximum(heights - swing_m[2] + 0.02, 0.0) / 15.0) + 0.08
        earliest = np.maximum(np.where(heights > swing_m[2] - 0.005, up_s, down_s), away / by.speed_m_s + 0.02)
        if not in_air:
            earliest = np.maximum(earliest, by.least_ground_s) + wait_s
        T = earliest[:, None] + self._later_s
        vT = (swing_v_m_s[:2] @ axes) * T[..., None]
        peak = 0.096 * np.maximum(np.abs(60.0 * D - 36.0 * vT), np.abs(60.0 * D - 24.0 * vT)) / T[..., None] ** 2
        hurry = np.maximum(np.hypot(peak[..., 0], peak[..., 1]) / by.acceleration_m_s2 - 1.0, 0.0)
        growth = np.exp(rate_per_s * T)[..., None]
        xi = ((capture_m - stance_m[:2]) @ axes)[None, None]
        ends = local[:, None, :]
        inner = half - by.margin_m
        p = np.clip(xi * growth / (growth - 1.0), -inner, inner)
        reached = p + (xi - p) * growth
        excess, _ = segment_excess(reached, ends, inner)
        # another step of the standing leg, from the place of this one
        rest = reached - ends
        growth2 = float(np.exp(rate_per_s * by.next_s))
        low2 = np.array([-by.back_m, min(-side * by.aside_m[0], -side * by.aside_m[1])])
        high2 = np.array([by.ahead_m, max(-side * by.aside_m[0], -side * by.aside_m[1])])
        ends2 = np.clip(rest * growth2, low2, high2)
        p2 = np.clip((rest * growth2 - ends2) / (growth2 - 1.0), -inner, inner)
        reached2 = p2 + (rest - p2) * growth2
        ends2 = np.clip(reached2, low2, high2)
        excess2, _ = segment_excess(reached2, ends2, inner)
        excess2 = np.where(excess > 0.0, excess2, 0.0)
        cost = 100.0 * excess2 + 20.0 * excess + 0.5 * T + 10.0 * np.minimum(hurry, 10.0)
        away_m = local - [0.0, side * by.nominal_m]
        cost = cost + 0.8 * (away_m * away_m).sum(axis=-1)[:, None]
        if last is not None:
            moved = places - last.place_m
            cost = cost + 2.0 * (moved * moved).sum(axis=-1)[:, None] + by.delay_cost * np.maximum(T - last.in_s, 0.0)
        if desired_m is not None:
            moved = places - desired_m
            cost = cost + 0.8 * (moved * moved).sum(axis=-1)[:, None]
        k, j = np.unravel_index(int(np.argmin(cost)), cost.shape)
        return Step(
            places[k],
            float(heights[k]),
            float(T[k, j]),
            stance_m[:2] + axes @ reached[k, j],
            stance_m[:2] + axes @ p[k, j],
            float(cost[k, j]),
        )
