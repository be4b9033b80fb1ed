"""Curves over the gait cycle: tracks of a walk, resampled from strike to strike of one foot.

A cycle has ``N_SAMPLES`` samples from 0 to 100 % of the time between two strikes of the same foot, which gives the
cycle its side. Curves of several cycles, recordings or people are averaged sample by sample.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Series
from stridelab.measures.extrapolated_com import extrapolated_com
from stridelab.measures.margin_of_stability import sideways_margin_m
from stridelab.measures.walk_motion import AHEAD, LEFT, UP, WalkMotion, strides
from stridelab.recordings.recording import Side
from stridelab.walking.steps import GaitStep

N_SAMPLES: Final = 101
MIN_SHARE: Final = 0.5
"""Share of the cycles that must have a sample for its mean: the stance does not end at the same percentage in all."""
CurveName = Literal["com_vertical", "com_lateral", "margin_of_stability_ml", "margin_of_stability_ap"]
CURVE_NAMES: Final[tuple[CurveName, ...]] = get_args(CurveName)
Cycle = Float[np.ndarray, "101"]


@dataclass(frozen=True)
class CycleCurve:
    """One quantity over one cycle, in metres; NaN where it is not defined or a marker is hidden."""

    name: CurveName
    side: Side
    value_m: Cycle


@dataclass(frozen=True)
class MeanCurve:
    """Mean of ``n`` curves and their standard deviation (n - 1; None for one curve), in metres.

    NaN where fewer than ``MIN_SHARE`` of the curves have a value.
    """

    n: int
    mean_m: Cycle
    sd_m: Cycle | None


def cycle_curves(motion: WalkMotion, steps: Sequence[GaitStep]) -> list[CycleCurve]:
    """Curves of all strides within the estimate, in metres.

    ``com_vertical`` and ``com_lateral`` are positions of the CoM relative to their mean over the cycle, up and
    towards the foot of the cycle. ``margin_of_stability_ml`` and ``_ap`` are the distances from the extrapolated CoM
    outwards to the outermost and ahead to the foremost point of this foot, during its stance.
    """
    xcom = extrapolated_com(motion)
    curves = []
    for _, step, following in strides(steps):
        if not motion.covers(step.strike_s, following.strike_s):
            continue
        time_s = np.linspace(step.strike_s, following.strike_s, N_SAMPLES)
        side, outwards = step.side, 1.0 if step.side == "left" else -1.0
        outline_m = motion.feet[side].outline_m
        stance = time_s <= following.lift_off_s
        tracks: dict[CurveName, Series] = {
            "com_vertical": motion.com_m[:, UP],
            "com_lateral": outwards * motion.com_m[:, LEFT],
            "margin_of_stability_ml": sideways_margin_m(motion, xcom, side),
            "margin_of_stability_ap": outline_m[:, :, AHEAD].max(axis=1) - xcom.position_m[:, AHEAD],
        }
        for name, track in tracks.items():
            value = np.interp(time_s, motion.time_s, track)
            value = value - value.mean() if name.startswith("com_") else np.where(stance, value, np.nan)
            curves.append(CycleCurve(name, side, np.asarray(value)))
    return [curve for curve in curves if np.isfinite(curve.value_m).any()]


def mean_curve(curves: Iterable[Cycle]) -> MeanCurve | None:
    """Mean and standard deviation sample by sample; None without curves."""
    values = np.array(list(curves))
    if not len(values):
        return None
    given = np.isfinite(values)
    counts = given.sum(axis=0)
    enough = counts >= max(1.0, MIN_SHARE * len(values))
    total = np.where(given, values, 0.0).sum(axis=0)
    mean = np.where(enough, total / np.maximum(counts, 1), np.nan)
    squares = np.where(given, (values - mean) ** 2, 0.0).sum(axis=0)
    sd = np.where(enough & (counts > 1), np.sqrt(squares / np.maximum(counts - 1, 1)), np.nan)
    return MeanCurve(len(values), mean, sd if len(values) > 1 else None)
