"""Gait plan: positions and times of the stances from speed and stature.

    step length = w H * cadence,  speed = step length * cadence   (constant walk ratio)

The walk ratio of adults at any comfortable speed is 0.0065 m per (step/min) at a stature of 1.71 m (Sekiya and Nagasaki
1998); it is scaled with stature. Double support takes 21 % of a step at 1.2 m/s and more at lower speeds
(Perry 1992). Step length, step time and step width vary from step to step with 2 %, 2 % and 8 mm (Hausdorff 2005,
Brach 2005: young adults), drawn from the seed; their mean is preserved, so that the speed is as given.

Every plan starts and ends at rest, with two shorter steps at either end. A recording of a subject who is already
walking is cut from the middle of such a plan.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.random import Generator

from stridelab.conventions import Series
from stridelab.recordings.recording import Side

WALK_RATIO: Final = 0.0038
"""Step length over cadence, in minutes per stature."""
MIN_SPEED_M_S: Final = 0.1
"""Speed below which the subject stands."""
_RAMP: Final = (0.42, 0.82)
"""Length of the first (and last) two steps relative to the others."""
_REST_S: Final = 1.0
SHIFT_S: Final = 0.6
"""Time in which the load shifts to one foot before the first step, and back after the last."""
_FLAT: Final = 0.8
"""Share of double support after which the leading foot is flat."""
_HEEL_OFF: Final = 0.54
"""Share of single support after which the heel rises."""
_FULL_STRIDE: Final = 0.8
"""Stride over stature at which heel strike and toe-off have the full pitch."""
_STRIKE_RAD: Final = 0.28
_OFF_RAD: Final = 1.0
_LENGTH_SD: Final = 0.02
_TIME_SD: Final = 0.02
_WIDTH_SD_M: Final = 0.008


@dataclass(frozen=True)
class Stance:
    """Stance of one foot. Infinite ``strike_s`` or ``off_s``: it is in contact from the start, or until the end.

    ``x_m, y_m`` is the ankle above the flat sole. Between ``strike_s`` and ``flat_s`` the foot rolls on its heel, from
    ``heel_off_s`` to ``off_s`` on its ball; the pitch of the foot (positive: toes down) at either end grows with the
    step before and after.
    """

    side: Side
    x_m: float
    y_m: float
    strike_s: float
    flat_s: float
    heel_off_s: float
    off_s: float
    strike_pitch_rad: float = 0.0
    off_pitch_rad: float = 0.0


@dataclass(frozen=True)
class GaitPlan:
    """Stances in the order of their strikes, the two standing feet first.

    ``record_from_s`` is the instant of the plan at which the recording starts, ``steady_s`` the interval of full steps,
    ``sole_middle_m`` the distance from the ankle forward to the middle of a footprint.
    """

    stances: tuple[Stance, ...]
    step_length_m: float
    step_time_s: float
    speed_m_s: float
    record_from_s: float
    duration_s: float
    end_s: float
    steady_s: tuple[float, float]
    sole_middle_m: float = 0.06

    @property
    def walks(self) -> bool:
        """Whether the plan has any step."""
        return len(self.stances) > 2


def plan_gait(
    height_m: float, speed_m_s: float, duration_s: float, *, from_rest: bool, stance_width_m: float, rng: Generator
) -> GaitPlan:
    """Plan a recording of ``duration_s`` of level walking along +x (standing below ``MIN_SPEED_M_S``)."""
    if speed_m_s < MIN_SPEED_M_S:
        return standing_plan(duration_s, stance_width_m)
    length = math.sqrt(60.0 * WALK_RATIO * height_m * speed_m_s)
    step_s = length / speed_m_s
    ramps = 2 * len(_RAMP)
    if from_rest:
        n_steps = max(int((duration_s - 2 * _REST_S - 2 * SHIFT_S) / step_s) - 1, ramps)
    else:
        n_steps = math.ceil(duration_s / step_s) + 2 + 2 * ramps
    factors = np.ones(n_steps)
    factors[: len(_RAMP)], factors[-len(_RAMP) :] = _RAMP, _RAMP[::-1]
    lengths = length * factors * (1.0 + _LENGTH_SD * centred_draws(rng, n_steps))
    times = step_s * (1.0 + _TIME_SD * centred_draws(rng, n_steps))
    widths = stance_width_m + _WIDTH_SD_M * centred_draws(rng, n_steps)
    first: Side = "left" if rng.random() < 0.5 else "right"
    strikes = _REST_S + SHIFT_S + np.cumsum(times)
    stances = _build_stances(
        lengths, widths, strikes, double_support_fraction(speed_m_s), first, stance_width_m, height_m
    )
    end_s = float(strikes[-1]) + step_s + SHIFT_S + _REST_S
    steady = (float(strikes[len(_RAMP)]), float(strikes[-len(_RAMP) - 1]))
    if from_rest:
        return GaitPlan(stances, length, step_s, speed_m_s, 0.0, duration_s, max(end_s, duration_s), steady)
    start = steady[0] + step_s + rng.random() * step_s
    return GaitPlan(stances, length, step_s, speed_m_s, start, duration_s, end_s, steady)


def double_support_fraction(speed_m_s: float) -> float:
    """Share of double support in a step."""
    return min(max(0.21 - 0.08 * (speed_m_s - 1.2), 0.14), 0.40)


def _build_stances(
    lengths: Series,
    widths: Series,
    strikes: Series,
    double_support: float,
    first: Side,
    width_m: float,
    height_m: float,
) -> tuple[Stance, ...]:
    """Two initial stances, one stance per step, and a last stance that closes the step.

    Landing ``k`` follows the lift of the same foot, which follows the strike of the other foot by the double support.
    """
    n = len(strikes)
    other: Side = "right" if first == "left" else "left"
    sides = [(first, other)[k % 2] for k in range(n + 1)]
    x_m = np.cumsum([*lengths, 0.0])
    half_m = np.append(widths, width_m) / 2
    S = np.append(strikes, 2 * strikes[-1] - strikes[-2])
    gaps = np.diff(S, prepend=2 * S[0] - S[1])
    lifts = S - (1.0 - double_support) * gaps
    strides_m = np.array([x_m[0], x_m[1], *(x_m[2:] - x_m[:-2])])
    pitch = np.minimum(strides_m / (_FULL_STRIDE * height_m), 1.05)

    def heel_off_s(k: int) -> float:
        return float(lifts[k + 1] + _HEEL_OFF * (S[k + 1] - lifts[k + 1]))

    def y_m(side: Side, half: float) -> float:
        return half if side == "left" else -half

    stances = [
        Stance(
            other,
            0.0,
            y_m(other, width_m / 2),
            -math.inf,
            -math.inf,
            heel_off_s(-1),
            float(lifts[1]),
            0.0,
            _OFF_RAD * pitch[1],
        ),
        Stance(
            first,
            0.0,
            y_m(first, width_m / 2),
            -math.inf,
            -math.inf,
            float(lifts[0] - 0.4 * gaps[0]),
            float(lifts[0]),
            0.0,
            _OFF_RAD * pitch[0],
        ),
    ]
    for k, side in enumerate(sides):
        leaves = k + 2 <= n
        stances.append(
            Stance(
                side,
                x_m=float(x_m[k]),
                y_m=y_m(side, float(half_m[k])),
                strike_s=float(S[k]),
                flat_s=float(S[k] + _FLAT * double_support * gaps[min(k + 1, n)]),
                heel_off_s=heel_off_s(k) if leaves else math.inf,
                off_s=float(lifts[k + 2]) if leaves else math.inf,
                strike_pitch_rad=float(-_STRIKE_RAD * pitch[k]),
                off_pitch_rad=float(_OFF_RAD * pitch[k + 2]) if leaves else 0.0,
            )
        )
    return tuple(stances)


def centred_draws(rng: Generator, n: int) -> Series:
    """Standard normal draws with mean 0, clipped to 2.5."""
    draws = rng.standard_normal(n)
    return np.asarray(np.clip(draws - draws.mean(), -2.5, 2.5))


def standing_plan(duration_s: float, width_m: float) -> GaitPlan:
    """Plan with both feet in contact all the time."""
    stances = (_standing_stance("left", 0.0, width_m / 2), _standing_stance("right", 0.0, -width_m / 2))
    return GaitPlan(stances, 0.0, 1.0, 0.0, 0.0, duration_s, duration_s, (0.0, duration_s))


def _standing_stance(side: Side, x_m: float, y_m: float) -> Stance:
    return Stance(side, x_m, y_m, -math.inf, -math.inf, math.inf, math.inf)
