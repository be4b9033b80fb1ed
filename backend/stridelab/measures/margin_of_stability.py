"""Margin of stability: distance of the extrapolated CoM from the edge of the base of support (Hof 2005, 2008).

Sideways, in single support on the foot of one side, the margin is the distance from the extrapolated CoM outwards to
the outermost point of that foot's outline; its minimum over single support, both ends included, is the margin of the
step. Ahead, at the strike of a foot, it is the distance from the extrapolated CoM to the foremost point of the landing
foot's outline. Positive margins lie inside the base. The outline follows from the markers of the foot
(``foot_outline``); its own error (about 1 cm, constant for a person) is not part of the stated standard deviation.
"""

import math
from collections.abc import Sequence

import numpy as np

from stridelab.conventions import Series
from stridelab.measures.extrapolated_com import ExtrapolatedCom, extrapolated_com
from stridelab.measures.measure import Measure
from stridelab.measures.spatiotemporal import position_sd_m
from stridelab.measures.walk_motion import AHEAD, FOOT_SKIN_SD_M, LEFT, MARKER_SD_M, OTHER_SIDE, FootMotion, WalkMotion
from stridelab.recordings.recording import Side
from stridelab.walking.steps import GaitStep


def margins_of_stability(motion: WalkMotion, steps: Sequence[GaitStep]) -> list[Measure]:
    """Margins per step, in metres; steps with a hidden foot or outside the estimate are left out.

    ``margin_of_stability_ml_min`` is of the standing foot, ``margin_of_stability_ap_contact``,
    ``margin_of_stability_ml_contact`` and ``capture_point_offset_{ap,ml}`` are of the landing foot: the offset is the
    middle of the landing foot's outline minus the capture point, positive ahead and outwards.
    """
    xcom = extrapolated_com(motion)
    measures = []
    for number, step in enumerate(steps):
        if motion.covers(step.lift_off_s, step.strike_s):
            measures += _single_support(motion, xcom, step, number)
            measures += _at_strike(motion, xcom, step, number)
    return [measure for measure in measures if math.isfinite(measure.value)]


def sideways_margin_m(motion: WalkMotion, xcom: ExtrapolatedCom, side: Side) -> Series:
    """Distance from the extrapolated CoM outwards to the outermost point of the foot of ``side``, at every sample."""
    outwards = 1.0 if side == "left" else -1.0
    outermost = (outwards * motion.feet[side].outline_m[:, :, LEFT]).max(axis=1)
    return np.asarray(outermost - outwards * xcom.position_m[:, LEFT])


def _single_support(motion: WalkMotion, xcom: ExtrapolatedCom, step: GaitStep, number: int) -> list[Measure]:
    side = OTHER_SIDE[step.side]
    if side not in motion.feet:
        return []
    within = motion.time_s[motion.samples(step.lift_off_s, step.strike_s)]
    at_s = np.concatenate([[step.lift_off_s], within, [step.strike_s]])
    margin = np.interp(at_s, motion.time_s, sideways_margin_m(motion, xcom, side))
    if len(within) == 0 or not np.isfinite(margin).all():
        return []
    k = int(np.argmin(margin))
    sd, of_foot = _errors_m(xcom, motion.find_sample(at_s[k]), LEFT)
    return [Measure("margin_of_stability_ml_min", float(margin[k]), sd, "m", side, number, of_foot)]


def _at_strike(motion: WalkMotion, xcom: ExtrapolatedCom, step: GaitStep, number: int) -> list[Measure]:
    outwards = 1.0 if step.side == "left" else -1.0
    foot = motion.feet[step.side]
    outline = _outline_at(motion, foot, step.strike_s)
    x = [float(np.interp(step.strike_s, motion.time_s, xcom.position_m[:, axis])) for axis in (AHEAD, LEFT)]
    k = motion.find_sample(step.strike_s)
    ahead_of = foot.heel_m - np.pad(xcom.position_m, ((0, 0), (0, 1)))
    ahead, sideways = (
        _errors_m(xcom, k, axis, position_sd_m(motion, ahead_of, step.strike_s, step.strike_error, axis))
        for axis in (AHEAD, LEFT)
    )
    middle = outline.mean(axis=0)
    values = (
        ("margin_of_stability_ap_contact", outline[:, AHEAD].max() - x[0], ahead),
        ("margin_of_stability_ml_contact", (outwards * outline[:, LEFT]).max() - outwards * x[1], sideways),
        ("capture_point_offset_ap", middle[AHEAD] - x[0], ahead),
        ("capture_point_offset_ml", outwards * (middle[LEFT] - x[1]), sideways),
    )
    return [Measure(name, float(value), sd, "m", step.side, number, own) for name, value, (sd, own) in values]


def _outline_at(motion: WalkMotion, foot: FootMotion, at_s: float) -> np.ndarray:
    return np.array(
        [motion.interpolate_track(foot.outline_m[:, point], at_s) for point in range(foot.outline_m.shape[1])]
    )


def _errors_m(xcom: ExtrapolatedCom, sample: int, axis: int, late_m: float = 0.0) -> tuple[float | None, float]:
    """Error of a margin, and the part of it that is not of the extrapolated CoM.

    The latter is of a marker of the foot, of its motion with the skin, and of their change within the error of the
    event.
    """
    of_foot = math.hypot(MARKER_SD_M, FOOT_SKIN_SD_M, late_m)
    return None if xcom.sd_m is None else math.hypot(float(xcom.sd_m[sample, axis]), of_foot), of_foot
