"""Range of the whole-body angular momentum about the CoM over a stride (Herr and Popovic 2008; Silverman 2011).

    L = sum_i m_i (c_i - c) x (v_i - v),    range of L / (m v h)

per axis, with m the body mass, v the mean walking speed and h the stature, which makes it free of units. The axes are
those of the walk: x ahead (frontal plane), y to the left (sagittal plane), z up (transverse plane). The rotation of
each segment about its own CoM is neglected.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from stridelab.measures.measure import Measure
from stridelab.measures.walk_motion import WalkMotion, strides
from stridelab.walking.steps import GaitStep

RELATIVE_SD: Final = (0.10, 0.16, 0.37)
"""Relative error of a range per axis, measured on simulated walks: point masses in place of rotating segments."""


def angular_momentum_ranges(motion: WalkMotion, steps: Sequence[GaitStep]) -> list[Measure]:
    """``angular_momentum_range_{x,y,z}`` per stride, from strike to strike; none without a stature or if standing."""
    speed = motion.mean_speed_m_s
    if motion.stature_m is None or speed <= 0.0:
        return []
    scaled = motion.momentum_per_kg / (speed * motion.stature_m)
    measures = []
    for number, step, following in strides(steps):
        if not motion.covers(step.strike_s, following.strike_s):
            continue
        during = scaled[motion.samples(step.strike_s, following.strike_s)]
        if np.isfinite(during).all():
            for axis, name in enumerate("xyz"):
                width = float(np.ptp(during[:, axis]))
                measures.append(
                    Measure(f"angular_momentum_range_{name}", width, RELATIVE_SD[axis] * width, "1", step.side, number)
                )
    return measures
