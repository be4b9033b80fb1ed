"""Lengths and times of steps from contacts and heel markers.

A step is named by the foot that swings and lands. Lengths are distances of the heels: of the landing foot at its
strike and the standing foot while it is flat; widths are across the walk, positive if the feet do not cross. Shares
are of the step time (double support) or of the stride time from strike to strike of one foot (stance, single support).
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from stridelab.measures.measure import Measure
from stridelab.measures.walk_motion import AHEAD, LEFT, MARKER_SD_M, OTHER_SIDE, UP, WalkMotion, strides
from stridelab.walking.steps import GaitStep

EVENT_SD_S: Final = {"plates": 0.003, "mixed": 0.009, "markers": 0.009}
"""Standard deviation of one event by the source of the timing (``walking.gait_events``)."""


def spatiotemporal(motion: WalkMotion, steps: Sequence[GaitStep]) -> list[Measure]:
    """Lengths, widths, times, speeds and shares per step, and the stride measures of steps with a following stride."""
    measures = []
    for number, step in enumerate(steps):
        measures += _of_step(motion, step, number)
    for number, step, following in strides(steps):
        measures += _of_stride(motion, step, following, number)
    return [measure for measure in measures if math.isfinite(measure.value)]


def _of_step(motion: WalkMotion, step: GaitStep, number: int) -> list[Measure]:
    event = EVENT_SD_S[step.source]
    pair, period = math.sqrt(2.0), step.period_s
    values: list[tuple[str, float, float, str]] = []
    if step.length_m is not None:
        values.append(("step_length", step.length_m, pair * MARKER_SD_M, "m"))
    if motion.covers(step.lift_off_s, step.strike_s):
        outwards = 1.0 if step.side == "left" else -1.0
        landed = motion.at(motion.feet[step.side].heel_m, step.strike_s)
        standing = motion.at(motion.feet[OTHER_SIDE[step.side]].heel_m, step.lift_off_s)
        values.append(("step_width", outwards * float(landed[LEFT] - standing[LEFT]), pair * MARKER_SD_M, "m"))
    values.append(("walking_speed", step.speed_m_s, pair * MARKER_SD_M / period, "m/s"))
    if step.prior_strike_s is not None:
        values.append(("step_time", period, pair * event, "s"))
        values.append(("cadence", 60.0 / period, 60.0 / period**2 * pair * event, "1/min"))
        double_s = step.next_lift_off_s - step.strike_s
        share = double_s / period
        values.append(("double_support_share", share, math.hypot(pair, share) * event / period, "1"))
    return [Measure(name, value, sd, unit, step.side, number) for name, value, sd, unit in values]


def _of_stride(motion: WalkMotion, step: GaitStep, following: GaitStep, number: int) -> list[Measure]:
    """From the strike of ``step`` to the next strike of the same foot, which is that of ``following``."""
    stride_s = following.strike_s - step.strike_s
    event = max(EVENT_SD_S[step.source], EVENT_SD_S[following.source])
    stance = (following.lift_off_s - step.strike_s) / stride_s
    swing_sd = math.sqrt(2.0) * event / stride_s
    values = [
        ("stride_time", stride_s, math.sqrt(2.0) * event, "s"),
        ("stance_share", stance, swing_sd, "1"),
        ("swing_share", 1.0 - stance, swing_sd, "1"),
    ]
    if motion.covers(step.strike_s, following.strike_s):
        span = motion.samples(step.strike_s, following.strike_s)
        heel = motion.feet[step.side].heel_m
        ahead = motion.at(heel, following.strike_s)[AHEAD] - motion.at(heel, step.strike_s)[AHEAD]
        varying = math.sqrt(2.0) * motion.varying_sd_m
        values += [
            ("stride_length", float(ahead), math.sqrt(2.0) * MARKER_SD_M, "m"),
            ("com_vertical_excursion", float(np.ptp(motion.com_m[span, UP])), varying, "m"),
            ("com_lateral_excursion", float(np.ptp(motion.com_m[span, LEFT])), varying, "m"),
        ]
    return [Measure(name, value, sd, unit, step.side, number) for name, value, sd, unit in values]
