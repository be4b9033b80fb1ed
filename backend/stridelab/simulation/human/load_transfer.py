"""Planned load of the feet, and the centre of mass that realises its zero-moment point.

The horizontal moments about the zero-moment point ``p`` on the ground vanish (2.7); with ``dL``, the rate of the
angular momentum about the centre of mass, that is the corrected (2.8):

    p_x = c_x - c_z c_x'' / (c_z'' + g) - dL_y / (m (c_z'' + g))
    p_y = c_y - c_z c_y'' / (c_z'' + g) + dL_x / (m (c_z'' + g))

For given ``p``, ``c_z`` and ``dL`` this is a linear boundary-value problem for ``c_x`` and ``c_y``: its solution
between two rests is the bounded one, i.e. the linear inverted pendulum with an infinite preview (Kajita 2003), with
exact height acceleration and angular momentum (``dL`` comes from the previous whole-body pass).

The load plan consists of the share and the centre of pressure of each foot. Under one foot the centre of pressure moves
from the heel over the flat sole to the ball; in double support the load moves smoothly (minimum jerk) from the trailing
to the leading foot. The zero-moment point to track is

    p = sum_feet share_i p_i,   share_left + share_right = 1   on level ground (2.7).

Standing subjects sway: the centre of pressure moves by a few millimetres (Winter 1995: 4 mm forward, 2 mm sideways
rms).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from numpy.random import Generator
from scipy.interpolate import PchipInterpolator
from scipy.linalg import solve_banded

from stridelab.conventions import GRAVITY_M_S2, Points, Series
from stridelab.recordings.recording import Side
from stridelab.simulation.human.body_proportions import SIDES, Proportions, side_sign
from stridelab.simulation.human.foot_trajectories import TOE_OUT_RAD, rocker_m
from stridelab.simulation.human.gait_plan import SHIFT_S, GaitPlan, Stance

Plane = Float[np.ndarray, "n 2"]
"""Points on the level ground."""

Transfer = Callable[[Series], Series]
"""Share that has passed to the leading foot as a function of the share of the time of double support."""
STEEPNESS: Final = 1.5
"""Exponent of the load that remains on the trailing foot."""
SWAY_M: Final = (0.004, 0.002)
_SWAY_HZ: Final = (0.08, 1.0)


@dataclass(frozen=True)
class LoadPlan:
    """Share of the vertical force and centre of pressure per foot, and the resulting zero-moment point."""

    share: Mapping[Side, Series]
    cop_m: Mapping[Side, Plane]
    zmp_m: Plane


def minimum_jerk(s: Series) -> Series:
    """Quintic from 0 to 1 with zero velocity and acceleration at both ends."""
    s = np.clip(s, 0.0, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)


def steep_transfer(s: Series) -> Series:
    """From 0 to 1 with the largest slope at the start: the leading foot reaches 20 N in 3 ms, like on plates.

    A person of 70 kg has 8 N/ms at the strike and unloads from 53 to 20 N in 11 ms. Plates without low-pass show 10 to
    40 N/ms (median of 24 strikes: 4.5 ms from 20 to 150 N) and 13 ms.
    """
    return np.asarray(1.0 - (1.0 - np.clip(s, 0.0, 1.0)) ** STEEPNESS)


def plan_load(
    plan: GaitPlan, p: Proportions, time_s: Series, rng: Generator, transfer: Transfer = minimum_jerk
) -> LoadPlan:
    """Shares and centres of pressure at the instants ``time_s`` of the plan; ``transfer`` is the course of a shift."""
    left = _left_share(plan, time_s, transfer)
    share: dict[Side, Series] = {"left": left, "right": 1.0 - left}
    wander = sway(time_s, rng)
    cop = {side: _centre_of_pressure(plan, side, p, time_s) + wander for side in SIDES}
    zmp = sum((share[side][:, None] * cop[side] for side in SIDES), np.zeros((len(time_s), 2)))
    return LoadPlan(share, cop, zmp)


def _left_share(plan: GaitPlan, t: Series, transfer: Transfer) -> Series:
    share = np.full(len(t), 0.5)
    if not plan.walks:
        return share
    lift_s = plan.stances[1].off_s
    shifts = [(lift_s - SHIFT_S, lift_s, plan.stances[0].side)]
    for following in plan.stances[2:]:
        trailing_off_s = _off_after(plan, following)
        if np.isfinite(trailing_off_s):
            shifts.append((following.strike_s, trailing_off_s, following.side))
    for start_s, end_s, onto in shifts:
        target = 1.0 if onto == "left" else 0.0
        share = share + (target - share) * transfer((t - start_s) / (end_s - start_s))
    level_s = plan.stances[-1].strike_s
    return np.asarray(share + (0.5 - share) * minimum_jerk((t - level_s) / SHIFT_S))


def _off_after(plan: GaitPlan, leading: Stance) -> float:
    """Toe-off of the other foot after the strike of ``leading``."""
    return next(s.off_s for s in plan.stances if s.side != leading.side and s.off_s > leading.strike_s)


def _centre_of_pressure(plan: GaitPlan, side: Side, p: Proportions, t: Series) -> Plane:
    """Centre of pressure of one foot; in swing that of the last stance, from mid-swing on that of the next."""
    resting_m = 0.35 * p.ball_m
    yaw = side_sign(side) * TOE_OUT_RAD
    cop = np.empty((len(t), 2))
    stances = [stance for stance in plan.stances if stance.side == side]
    strikes_s = [stance.strike_s for stance in stances[1:]] + [np.inf]
    since_s = -np.inf
    for stance, next_strike_s in zip(stances, strikes_s, strict=True):
        knots = []
        if np.isfinite(stance.strike_s):
            flat = stance.flat_s
            knots += [(stance.strike_s, -0.85 * p.heel_m), (flat, -0.6 * p.heel_m)]
        if np.isfinite(stance.off_s):
            knots += [(stance.heel_off_s, p.ball_m), (stance.off_s, p.ball_m + rocker_m(p) * stance.off_pitch_rad)]
        if not np.isfinite(stance.strike_s) and knots:
            knots.insert(0, (stance.heel_off_s - SHIFT_S, resting_m))
        if not np.isfinite(stance.off_s) and knots:
            knots.append((stance.flat_s + SHIFT_S, resting_m))
        part = t >= since_s
        along = np.full(int(part.sum()), resting_m)
        if knots:
            at, where = np.array(knots).T
            along = PchipInterpolator(at, where)(np.clip(t[part], at[0], at[-1]))
        cop[part] = np.column_stack([stance.x_m + np.cos(yaw) * along, stance.y_m + np.sin(yaw) * along])
        since_s = (stance.off_s + next_strike_s) / 2
    return cop


def sway(t: Series, rng: Generator) -> Plane:
    """Postural sway: sinusoids of random phase between 0.08 and 1 Hz with amplitudes proportional to 1/f."""
    f = np.geomspace(*_SWAY_HZ, 12)
    phase = rng.uniform(0.0, 2.0 * np.pi, (2, len(f)))
    waves = np.sin(2.0 * np.pi * f * t[:, None, None] + phase) / f
    return np.asarray(waves.sum(axis=2) * np.array(SWAY_M) / np.sqrt(0.5 * np.sum(f**-2.0)))


def com_over_zmp(zmp_m: Plane, height_m: Series, momentum_rate_nm: Points, mass_kg: float, dt_s: float) -> Points:
    """Centre of mass whose zero-moment point is ``zmp_m`` (finite differences; at rest at both ends)."""
    n = len(height_m)
    lift = np.gradient(np.gradient(height_m, dt_s), dt_s) + GRAVITY_M_S2  # c_z'' + g
    stiffness = height_m / lift / dt_s**2
    dL = momentum_rate_nm / (mass_kg * lift[:, None])
    target = zmp_m + np.column_stack([dL[:, 1], -dL[:, 0]])
    bands = np.zeros((3, n))
    bands[0, 2:] = -stiffness[1:-1]
    bands[1] = 1.0 + 2.0 * stiffness
    bands[2, :-2] = -stiffness[1:-1]
    bands[1, [0, -1]] = 1.0
    return np.column_stack([solve_banded((1, 1), bands, target), height_m])
