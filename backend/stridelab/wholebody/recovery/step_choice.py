"""Choice of the next step from the capture point: where and when the swinging sole lands.

The capture point xi diverges from the centre of pressure p, which stays in the standing sole, so that at a landing
after T

    xi(T) = p + (xi - p) exp(w T) .

The robot can come to rest if xi(T) is in the convex hull of both soles: the segment between their centres, widened by
half a sole. Of a grid of footholds within reach of the leg and of times at which the sole can be there, the step is
taken whose excess over that hull is smallest, after this step and after another one of the other leg (the capture
regions of Koolen 2012 for one and two steps, with the time adapted as by Khadiv 2020). The sole accelerates by at most
``acceleration_m_s2``: the friction of the standing sole has to bear the reaction, and below that limit the time is
bounded by the peak of a quintic from the present velocity.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stridelab.conventions import GRAVITY_M_S2
from stridelab.wholebody.recovery.footholds import Footholds
from stridelab.wholebody.recovery.leg_geometry import LegGeometry

Shift = Float[np.ndarray, "2"]
Axes = Float[np.ndarray, "2 2"]
QUINTIC_PEAK = 5.77
"""Peak acceleration of a quintic over distance d in T from rest to rest, in units of d / T^2."""
FALL_M_S2 = 25.0
"""Peak vertical acceleration of a sole that comes down."""
DROP_M = 0.08
"""Height of the top of a swing above its place from which on the sole first passes the edge and then comes down."""
EDGE_SHARE = 0.5
"""Share of the time of such a drop before whose end the sole is above its place."""
_HERE_M = 1e-3
"""Distance below which a place is that where the sole is."""
_LEAST_S = 0.03
"""Shortest time in which a sole comes down where it is."""
CORNERS = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])


@dataclass(frozen=True)
class StepSearch:
    """Reach in shares of the leg's length, speeds, and weights of the search.

    ``apart_share`` and ``gap_m`` bound how near the soles come to each other: a share of their usual distance, and the
    gap between their edges. A swing from the ground takes ``least_s``, the step after this one ``next_s``. The capture
    point keeps ``margin_m`` from the edge of the hull, at most ``margin_share`` of half a sole, and a sole ``edge_m``
    from that of its surface. A sole accelerates
    by at most ``acceleration_m_s2``, and by ``narrow`` g times the half width of the standing sole over the CoM's
    height: the reaction turns the body about that sole.
    """

    ahead: float = 0.85
    back: float = 0.75
    aside: float = 0.85
    apart_share: float = 0.85
    gap_m: float = 0.03
    climb_m: float = 0.25
    speed_m_s: float = 3.0
    rise_m_s2: float = 15.0
    acceleration_m_s2: float = 22.0
    narrow: float = 45.0
    least_s: float = 0.22
    next_s: float = 0.42
    margin_m: float = 0.02
    margin_share: float = 0.34
    edge_m: float = 0.015
    later_s: tuple[float, ...] = (0.0, 0.03, 0.06, 0.09, 0.12, 0.16, 0.22, 0.3, 0.45)
    second_excess: float = 100.0
    first_excess: float = 20.0
    hurry: float = 10.0
    time: float = 0.5
    length: float = 0.8
    change: float = 2.0
    delay: float = 20.0


@dataclass(frozen=True, eq=False)
class Step:
    """The place of the sole's centre (world), its height, the time to its landing, and the cost of the choice."""

    place_m: Shift
    height_m: float
    in_s: float
    cost: float


@dataclass(frozen=True, eq=False)
class Swinging:
    """The sole to place: position and velocity of its centre, side, and seconds since it left the ground.

    ``aloft_s`` is None once it is clear of the ground. ``top_m`` is the height at which it is clear of the ground
    below it. A sole that ``was_up`` when the plan was left may come down at once where it is.
    """

    position_m: Float[np.ndarray, "3"]
    velocity_m_s: Float[np.ndarray, "3"]
    side: float
    aloft_s: float | None
    top_m: float = -np.inf
    is_landing: bool = False
    was_up: bool = False


def fall_time_s(drop_m: Float[np.ndarray, "*n"] | float, down_m_s: float) -> Float[np.ndarray, "*n"]:
    """Shortest time in which a sole that moves down at ``down_m_s`` comes down by ``drop_m``.

    Its quintic to rest has the peak acceleration 5.77 |d - v T / 2| / T^2.
    """
    k = FALL_M_S2 / QUINTIC_PEAK
    return np.asarray((np.sqrt(0.25 * down_m_s**2 + 4.0 * k * np.maximum(drop_m, 0.0)) - 0.5 * down_m_s) / (2.0 * k))


def nearest_in_hull(
    points: Float[np.ndarray, "*#n 2"], end: Float[np.ndarray, "*#n 2"], half: Float[np.ndarray, "2"]
) -> tuple[Float[np.ndarray, "*n 2"], Float[np.ndarray, "*n"]]:
    """Nearest point of the hull of a sole at the origin and one at ``end``, and the distance from it.

    The hull of two rectangles of equal axes is the segment between their centres widened by half a rectangle.
    """
    share = np.clip((points * end).sum(axis=-1) / np.maximum((end * end).sum(axis=-1), 1e-9), 0.0, 1.0)
    middle = share[..., None] * end
    nearest = middle + np.clip(points - middle, -half, half)
    return nearest, np.asarray(np.hypot(*np.moveaxis(points - nearest, -1, 0)))


class StepChooser:
    """Searches the grid of places and times."""

    def __init__(self, search: StepSearch, legs: LegGeometry, footholds: Footholds) -> None:
        self._search, self._footholds, self._half = search, footholds, legs.half_m
        self._spacing_m = legs.spacing_m
        self._inner_m = legs.half_m - np.minimum(search.margin_m, search.margin_share * legs.half_m)
        narrow_m_s2 = search.narrow * GRAVITY_M_S2 * float(legs.half_m[1]) / legs.com_height_m
        self._most_m_s2 = min(search.acceleration_m_s2, narrow_m_s2)
        near_m = max(search.apart_share * legs.spacing_m, 2.0 * float(legs.half_m[1]) + search.gap_m)
        self._aside_m = (near_m, search.aside * legs.leg_m)
        self._along_m = (-search.back * legs.leg_m, search.ahead * legs.leg_m)
        x, y = np.linspace(*self._along_m, 33), np.linspace(*self._aside_m, 11)
        self._grid_m = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)

    def choose_step(
        self,
        capture_m: Shift,
        rate_per_s: float,
        stance_m: Float[np.ndarray, "3"],
        swing: Swinging,
        axes: Axes,
        last: Step | None,
    ) -> Step | None:
        """The best step from the standing sole at ``stance_m``, None without a foothold.

        ``axes`` has the forward and left axes of the heading as columns.
        """
        by, inner = self._search, self._inner_m
        here = axes.T @ (swing.position_m - stance_m)[:2]
        local = self._grid_m * [1.0, swing.side]
        if swing.was_up and swing.side * here[1] > 2.0 * self._half[1]:
            local = np.vstack([local, here])
        places = stance_m[:2] + local @ axes.T
        heights = self._footholds.sole_heights_m(places, CORNERS * (self._half + by.edge_m) @ axes.T)
        with np.errstate(invalid="ignore"):
            reachable = np.abs(heights - stance_m[2]) < by.climb_m
            if swing.is_landing:  # it does not rise again, and a riser may be ahead
                reachable &= heights < swing.position_m[2] + 0.005
        if not reachable.any():
            return None
        local, places, heights = local[reachable], places[reachable], heights[reachable]
        T, effort = self._landing_times_s(places, heights, swing, axes, last)
        xi, growth = axes.T @ (capture_m - stance_m[:2]), np.exp(rate_per_s * T)[..., None]
        reached = _braked_capture(xi, growth, inner)
        _, excess = nearest_in_hull(reached, local[:, None, :], inner)
        cost = (
            by.second_excess
            * np.where(excess > 0.0, self._excess_of_next(reached - local[:, None, :], rate_per_s, swing.side), 0.0)
            + by.first_excess * excess
            + by.hurry * np.clip(effort - 1.0, 0.0, 10.0)
            + by.time * T
            + by.length * ((local - [0.0, swing.side * self._spacing_m]) ** 2).sum(axis=-1)[:, None]
        )
        if last is not None:
            cost = cost + by.change * ((places - last.place_m) ** 2).sum(axis=-1)[:, None]
            cost = cost + by.delay * np.maximum(T - last.in_s, 0.0)
        k, j = np.unravel_index(int(np.argmin(cost)), cost.shape)
        return Step(places[k], float(heights[k]), float(T[k, j]), float(cost[k, j]))

    def _landing_times_s(
        self, places_m: np.ndarray, heights_m: np.ndarray, swing: Swinging, axes: Axes, last: Step | None
    ) -> tuple[Float[np.ndarray, "k t"], Float[np.ndarray, "k t"]]:
        """Times of landing at every place, and the accelerations of the sole, as shares of the largest."""
        by, at = self._search, swing.position_m
        rise_m = heights_m - at[2]
        along = (places_m - at[:2]) @ axes
        up_s = np.sqrt(QUINTIC_PEAK * np.maximum(rise_m + 0.02, 0.0) / by.rise_m_s2) + 0.08
        far_s = np.hypot(np.hypot(*along.T), rise_m) / by.speed_m_s + 0.02
        is_over_edge = swing.top_m - heights_m > DROP_M
        fall_m = np.where(is_over_edge, np.maximum(swing.top_m, at[2]), at[2]) - heights_m
        falling_m_s = max(-float(swing.velocity_m_s[2]), 0.0) if swing.is_landing else 0.0
        down_s = fall_time_s(fall_m, falling_m_s)
        over_s = np.where(is_over_edge, EDGE_SHARE * down_s, 0.0)
        level_m = 0.005 if swing.is_landing else -0.005
        first_s = np.maximum(np.where(rise_m > level_m, up_s, down_s), far_s + over_s)
        if swing.aloft_s is not None:
            first_s = np.maximum(first_s, by.least_s) - min(swing.aloft_s, by.least_s - 0.07)
            first_s = np.maximum(first_s, over_s + 0.02)
        is_here = swing.was_up & (np.hypot(*along.T) < _HERE_M)
        first_s = np.where(is_here, np.maximum(down_s, _LEAST_S), first_s)
        T = first_s[:, None] + np.array(by.later_s)
        if last is not None:  # otherwise a landing as it was chosen could only be postponed or hastened
            T = np.column_stack([T, np.maximum(first_s, last.in_s)])
        level_s = T - over_s[:, None]
        gone = (axes.T @ swing.velocity_m_s[:2]) * level_s[..., None]
        peak = np.maximum(np.abs(60.0 * along[:, None] - 36.0 * gone), np.abs(60.0 * along[:, None] - 24.0 * gone))
        peak_m_s2 = QUINTIC_PEAK / 60.0 * np.hypot(*np.moveaxis(peak, -1, 0)) / level_s**2
        return T, np.where(is_here[:, None], 0.0, peak_m_s2 / self._most_m_s2)

    def _excess_of_next(self, rest_m: np.ndarray, rate_per_s: float, side: float) -> np.ndarray:
        """Excess after a step of the standing leg, for a capture point relative to the sole that lands before it."""
        inner, aside = self._inner_m, np.sort([-side * d for d in self._aside_m])
        growth = float(np.exp(rate_per_s * self._search.next_s))
        reached = _braked_capture(rest_m, growth, inner)
        places = np.clip(reached, [self._along_m[0], aside[0]], [self._along_m[1], aside[1]])
        return nearest_in_hull(reached, places, inner)[1]


def _braked_capture(xi: np.ndarray, growth: np.ndarray | float, half: np.ndarray) -> np.ndarray:
    """Capture point at the landing for the centre of pressure that keeps it nearest to the standing sole."""
    p = braking_pressure(xi, growth, half)
    return np.asarray(p + (xi - p) * growth)


def braking_pressure(
    xi: Float[np.ndarray, "*#n 2"], growth: Float[np.ndarray, "*#n 1"] | float, half: Float[np.ndarray, "2"]
) -> Float[np.ndarray, "*n 2"]:
    """Centre of pressure within half a sole that brings the capture point to the sole's centre, or nearest to it."""
    return np.asarray(np.clip(xi * growth / (growth - 1.0), -half, half))
