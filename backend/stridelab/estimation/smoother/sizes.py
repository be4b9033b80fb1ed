"""From the user's priors and one recording to the sizes of every error, per axis of the walking frame."""

from dataclasses import replace

import numpy as np

from stridelab.conventions import GRAVITY_M_S2, Rotation
from stridelab.estimation.smoother.model import ACCELERATION, CONSTANTS, HEIGHT, MOMENT, TABLE, Sizes
from stridelab.estimation.smoother.priors import SmootherPriors
from stridelab.estimation.smoother.signals import Walk, step_frequency_hz, swing_at_ends

USUAL_STEP_HZ, USUAL_SPEED_M_S = 1.8, 1.2
UNDIRECTED_HZ_SHARE, UNDIRECTED_DAMPING = 0.75, 0.6
SAGITTAL_OVERTONE, LATERAL_OVERTONE = 2.0, 4.5
"""Overtones over the step and the stride frequency: the second, and the third to seventh together."""


def adult_momentum_m_s(mass_kg: float, height_m: float) -> tuple[float, float]:
    """RMS of L / (m g) about the walking and the lateral axis: 1.0 and 1.5 Nms at 70 kg and 1.70 m, scaled.

    The CoM lies at 0.55 of the stature.
    """
    scale = (height_m / 0.55) ** 2 / (70.0 * 1.7**2 * GRAVITY_M_S2)
    return 1.0 * scale, 1.5 * scale


def sizes_of(priors: SmootherPriors, walk: Walk, mass_kg: float, table_sd_m: tuple[float, float, float]) -> Sizes:
    """Axes x, y, z of the walking frame. The moment about the lateral axis moves x, that about the walking axis y.

    A clock that is late by ``clock_s`` displaces the force along the walk.
    """
    height = float(np.mean(walk.geometry_m[:, 2]))
    step_hz = priors.step_hz or step_frequency_hz(walk) or USUAL_STEP_HZ
    sizes = _sizes(priors, mass_kg, table_sd_m, walk.frame, height, step_hz, walk.speed_m_s)
    return replace(sizes, ends=swing_at_ends(walk))


def online_sizes(
    priors: SmootherPriors,
    mass_kg: float,
    table_sd_m: tuple[float, float, float],
    frame: Rotation,
    height_m: float,
    *,
    directed: bool,
) -> Sizes:
    """For a stream, whose walk is not known beforehand: a usual speed and step frequency.

    Without a direction, both horizontal axes take the larger momentum in a resonator broad enough for stride and step.
    """
    step_hz = priors.step_hz or USUAL_STEP_HZ
    sizes = _sizes(priors, mass_kg, table_sd_m, frame, height_m, step_hz, USUAL_SPEED_M_S)
    if directed:
        return sizes
    largest = np.array([1.0, 1.0, 0.0])
    return replace(
        sizes,
        swing_m_s=sizes.swing_m_s.max() * largest,
        swing_hz=np.full(3, UNDIRECTED_HZ_SHARE * step_hz),
        damping=np.full(3, UNDIRECTED_DAMPING),
        overtone_m_s=sizes.overtone_m_s.max() * largest,
        bias=np.maximum(sizes.bias, sizes.bias[[1, 0, 2]]),
    )


def _sizes(
    priors: SmootherPriors,
    mass_kg: float,
    table_sd_m: tuple[float, float, float],
    frame: Rotation,
    height: float,
    step_hz: float,
    speed_m_s: float,
) -> Sizes:
    weight = mass_kg * GRAVITY_M_S2
    table = np.sqrt((frame**2) @ np.square(table_sd_m))
    moment = np.hypot(priors.moment_nm, height * priors.force_n) / weight
    about_walk, about_side = priors.momentum_m_s or adult_momentum_m_s(mass_kg, height)
    swing = np.array([about_side, about_walk, 0.0])
    bias = np.zeros((3, CONSTANTS))
    bias[:, TABLE] = table
    bias[:, ACCELERATION] = np.hypot(priors.plate_force_n / mass_kg, [0.0, 0.0, priors.mass_share * GRAVITY_M_S2])
    bias[:2, HEIGHT] = table[2]
    bias[:2, MOMENT] = np.hypot(priors.plate_moment_nm / weight, [priors.clock_s * speed_m_s, 0.0])
    every = np.ones(3)
    return Sizes(
        turned=np.array([True, True, False]),
        marker_m=priors.marker_m * every,
        marker_corner_hz=priors.marker_corner_hz * every,
        acceleration_m_s2=priors.force_n / mass_kg * every,
        moment_m=moment * every,
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
