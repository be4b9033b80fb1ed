"""From the user's priors and one recording to the sizes of every error, per axis of the walking frame."""

import numpy as np

from stridelab.conventions import GRAVITY_M_S2
from stridelab.estimation.smoother.model import Sizes
from stridelab.estimation.smoother.priors import SmootherPriors
from stridelab.estimation.smoother.signals import Walk, step_frequency_hz

USUAL_STEP_HZ = 1.8
SAGITTAL_OVERTONE, LATERAL_OVERTONE = 2.0, 4.5
"""Overtones over the step and the stride frequency: the second, and the third to seventh together."""


def adult_momentum_m_s(mass_kg: float, height_m: float) -> tuple[float, float]:
    """RMS of L / (m g) about the walking and the lateral axis: 1.0 and 1.5 Nms at 70 kg and 1.70 m, scaled.

    The CoM lies at 0.55 of the stature.
    """
    scale = (height_m / 0.55) ** 2 / (70.0 * 1.7**2 * GRAVITY_M_S2)
    return 1.0 * scale, 1.5 * scale


def sizes_of(
    priors: SmootherPriors, walk: Walk, mass_kg: float, table_sd_m: tuple[float, float, float]
) -> Sizes:
    """Axes x, y, z of the walking frame. The moment about the lateral axis moves x, that about the walking axis y.

    An error of the height, times the horizontal force, is noise of y2. A clock that is late by ``clock_s`` displaces
    the force along the walk.
    """
    weight = mass_kg * GRAVITY_M_S2
    height = float(np.mean(walk.geometry_m[:, 2]))
    table = np.sqrt((walk.frame**2) @ np.square(table_sd_m))
    sway = np.sqrt(np.mean(walk.force_n[walk.seen] ** 2, axis=0)) / weight
    moment = np.hypot(priors.moment_nm, height * priors.force_n) / weight
    step_hz = priors.step_hz or step_frequency_hz(walk) or USUAL_STEP_HZ
    about_walk, about_side = priors.momentum_m_s or adult_momentum_m_s(mass_kg, height)
    swing = np.array([about_side, about_walk, 0.0])
    bias = np.zeros((3, 3))
    bias[:, 0] = table
    bias[:, 1] = np.hypot(priors.plate_force_n / mass_kg, [0.0, 0.0, priors.mass_share * GRAVITY_M_S2])
    bias[:2, 2] = np.hypot(priors.plate_moment_nm / weight, [priors.clock_s * walk.speed_m_s, 0.0])
    every = np.ones(3)
    return Sizes(
        turned=np.array([True, True, False]),
        marker_m=priors.marker_m * every,
        marker_corner_hz=priors.marker_corner_hz * every,
        acceleration_m_s2=priors.force_n / mass_kg * every,
        moment_m=np.hypot(moment, table[2] * sway),
        plate_corner_hz=priors.plate_corner_hz * every,
        table_varying_m=priors.table_varying_m * every,
        table_varying_s=priors.table_varying_s * every,
        swing_m_s=swing,
        swing_hz=step_hz * np.array([1.0, 0.5, 1.0]),
        damping=priors.damping * every,
        overtone_m_s=priors.overtone_share * swing,
        overtone_hz=step_hz * np.array([SAGITTAL_OVERTONE, 0.5 * LATERAL_OVERTONE, 1.0]),
        bias=bias,
        beyond_m_s2=priors.acceleration_beyond_m_s2 * every,
        beyond_s=priors.acceleration_beyond_s * every,
        height_m=height,
    )
