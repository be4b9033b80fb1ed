"""Lengths and times of steps from contacts and heel markers.

A step is named by the foot that swings and lands. Lengths are distances of the heels, each read while the foot is flat,
at the lift-off of the other foot, so that two steps add up to a stride; widths are the same across the walk, positive
if the feet do not cross. Shares are of the step time (double support) or of the stride time from strike to strike of
one foot (stance, single support).

Events have a common error (the same in all events of a kind) and an own error (``walking.gait_events``). To first order

    (sd)^2 = sum of (weight own)^2 over the events + sum over the kinds of (sum of weight common)^2,

so that an error common to two strikes drops out of the time between them. The weight is the derivative of the measure;
that of a position at an event is its velocity there, as a difference over the event's own uncertainty.

Markers move with the skin, in the rhythm of the stride: that drops out of the length of a stride, but not of the speed
of a step, at whose ends the skin is elsewhere, nor of the distances between the feet. Both heels are read at the same
phase of their strides, and a part of the variance of their skin is taken as alike, mirrored (``FOOT_SKIN_ALIKE``):
ahead it drops out of their difference, across it adds up.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from stridelab.conventions import Points
from stridelab.measures.measure import Measure
from stridelab.measures.walk_motion import (
    AHEAD,
    FOOT_SKIN_ALIKE,
    FOOT_SKIN_SD_M,
    LEFT,
    MARKER_SD_M,
    OTHER_SIDE,
    PELVIS_SKIN_SD_M,
    UP,
    WalkMotion,
    strides,
)
from stridelab.walking.event_calibration import EventError
from stridelab.walking.steps import GaitStep

HALF_STRIDE_CHANGE: Final = 1.81
"""2 sqrt(share of the odd harmonics), where amplitudes are 1, 1/2 and 1/3."""


def spatiotemporal(motion: WalkMotion, steps: Sequence[GaitStep]) -> list[Measure]:
    """Lengths, widths, times, speeds and shares per step, and the stride measures of steps with a following stride.

    If one foot is marked, the walking speed is that of its strides, and what needs the other foot is left out.
    """
    measures = []
    for number, step in enumerate(steps):
        measures += _of_step(motion, step, number)
    for number, step, following in strides(steps):
        measures += _of_stride(motion, step, following, number)
    if not any(measure.name.startswith("com_") for measure in measures):
        for number, (step, following) in enumerate(pairwise(steps)):
            if step.next_lift_off_s == following.lift_off_s:
                measures += _excursions(motion, step, step.lift_off_s, following.next_lift_off_s, number)
    return [measure for measure in measures if math.isfinite(measure.value)]


def timing_sd(strikes: Sequence[tuple[float, EventError]], lift_offs: Sequence[tuple[float, EventError]] = ()) -> float:
    """Standard deviation of a sum of weighted events: pairs of a weight and the error of its event."""
    own = sum((weight * error.own_s) ** 2 for weight, error in (*strikes, *lift_offs))
    common = sum(sum(weight * error.common_s for weight, error in kind) ** 2 for kind in (strikes, lift_offs))
    return math.sqrt(own + common)


def position_sd_m(motion: WalkMotion, track: Points, at_s: float, error: EventError, axis: int) -> float:
    """Error of a position at an event, from the change of ``track`` along ``axis`` within the event's error."""
    sd_s = math.hypot(error.common_s, error.own_s)
    return 0.5 * abs(
        float(motion.interpolate_track(track, at_s + sd_s)[axis] - motion.interpolate_track(track, at_s - sd_s)[axis])
    )


def _of_step(motion: WalkMotion, step: GaitStep, number: int) -> list[Measure]:
    if OTHER_SIDE[step.side] not in motion.feet:
        return []
    period = step.period_s
    landing, standing = motion.feet[step.side].heel_m, motion.feet[OTHER_SIDE[step.side]].heel_m
    skin_m = {
        axis: math.sqrt(2.0 * (1.0 + mirrored * FOOT_SKIN_ALIKE)) * FOOT_SKIN_SD_M
        for axis, mirrored in ((AHEAD, -1.0), (LEFT, 1.0))
    }
    values: list[tuple[str, float, float, str]] = []

    def heels_sd_m(axis: int) -> float:
        landed_m = position_sd_m(motion, landing, step.next_lift_off_s, step.next_lift_off_error, axis)
        return math.hypot(
            math.sqrt(2.0) * MARKER_SD_M,
            skin_m[axis],
            landed_m,
            position_sd_m(motion, standing, step.lift_off_s, step.lift_off_error, axis),
        )

    if step.length_m is not None:
        values.append(("step_length", step.length_m, heels_sd_m(AHEAD), "m"))
    if motion.covers(step.lift_off_s, step.next_lift_off_s):
        outwards = 1.0 if step.side == "left" else -1.0
        width = (
            motion.interpolate_track(landing, step.next_lift_off_s)[LEFT]
            - motion.interpolate_track(standing, step.lift_off_s)[LEFT]
        )
        values.append(("step_width", outwards * float(width), heels_sd_m(LEFT), "m"))
    values.append(("walking_speed", step.speed_m_s, _speed_sd_m_s(motion, step), "m/s"))
    if step.prior_strike_s is not None:
        prior, strike, next_off = step.prior_strike_error, step.strike_error, step.next_lift_off_error
        period_sd = timing_sd([(1.0, strike), (-1.0, prior)])
        values.append(("step_time", period, period_sd, "s"))
        values.append(("cadence", 60.0 / period, 60.0 / period**2 * period_sd, "1/min"))
        share = (step.next_lift_off_s - step.strike_s) / period
        share_sd = timing_sd([(-1.0 - share, strike), (share, prior)], [(1.0, next_off)]) / period
        values.append(("double_support_share", share, share_sd, "1"))
    return [Measure(name, value, sd, unit, step.side, number) for name, value, sd, unit in values]


def _speed_sd_m_s(motion: WalkMotion, step: GaitStep) -> float:
    """Errors of the pelvis at both ends, and of the ends: the speed there differs from the mean.

    A step is half a stride. A motion of the skin with harmonics k of the stride and amplitudes 1 / k, k = 1 to 3, then
    changes by ``HALF_STRIDE_CHANGE`` of its standard deviation: the odd ones reverse.
    """
    duration = step.next_lift_off_s - step.lift_off_s
    faster = [
        float(motion.velocity_m_s[motion.find_sample(at_s), AHEAD]) - step.speed_m_s
        for at_s in (step.lift_off_s, step.next_lift_off_s)
    ]
    ends = timing_sd([], [(-faster[0], step.lift_off_error), (faster[1], step.next_lift_off_error)])
    return math.hypot(math.sqrt(2.0) * MARKER_SD_M, HALF_STRIDE_CHANGE * PELVIS_SKIN_SD_M, ends) / duration


def _of_stride(motion: WalkMotion, step: GaitStep, following: GaitStep, number: int) -> list[Measure]:
    """From the strike of ``step`` to the next strike of the same foot, which is that of ``following``."""
    stride_s = following.strike_s - step.strike_s
    first, lift_off, last = step.strike_error, following.lift_off_error, following.strike_error
    stance = (following.lift_off_s - step.strike_s) / stride_s
    stance_sd = timing_sd([(stance - 1.0, first), (-stance, last)], [(1.0, lift_off)]) / stride_s
    values = [
        ("stride_time", stride_s, timing_sd([(-1.0, first), (1.0, last)]), "s"),
        ("stance_share", stance, stance_sd, "1"),
        ("swing_share", 1.0 - stance, stance_sd, "1"),
    ]
    if motion.covers(step.strike_s, following.strike_s):
        heel = motion.feet[step.side].heel_m
        ahead = (
            motion.interpolate_track(heel, following.strike_s)[AHEAD]
            - motion.interpolate_track(heel, step.strike_s)[AHEAD]
        )
        length_sd = math.hypot(
            math.sqrt(2.0) * MARKER_SD_M,
            position_sd_m(motion, heel, step.strike_s, first, AHEAD),
            position_sd_m(motion, heel, following.strike_s, last, AHEAD),
        )
        values.append(("stride_length", float(ahead), length_sd, "m"))
        if OTHER_SIDE[step.side] not in motion.feet:
            speed = float(ahead) / stride_s
            values.append(("walking_speed", speed, math.hypot(length_sd, speed * values[0][2]) / stride_s, "m/s"))
    measures = [Measure(name, value, sd, unit, step.side, number) for name, value, sd, unit in values]
    return measures + _excursions(motion, step, step.strike_s, following.strike_s, number)


def _excursions(motion: WalkMotion, step: GaitStep, start_s: float, end_s: float, number: int) -> list[Measure]:
    """Ranges and speed of the CoM over a stride; from lift-off to lift-off if no stride between strikes is covered."""
    if not motion.covers(start_s, end_s):
        return []
    com = motion.com_m[motion.samples(start_s, end_s)]
    sd = math.sqrt(2.0) * motion.varying_sd_m
    ahead = (
        motion.interpolate_track(motion.com_m, end_s)[AHEAD] - motion.interpolate_track(motion.com_m, start_s)[AHEAD]
    )
    speed = float(ahead) / (end_s - start_s)
    return [
        *(
            Measure(f"com_{name}_excursion", float(np.ptp(com[:, axis])), sd, "m", step.side, number)
            for name, axis in (("vertical", UP), ("lateral", LEFT))
        ),
        Measure("com_speed", speed, sd / (end_s - start_s), "m/s", step.side, number),
    ]
