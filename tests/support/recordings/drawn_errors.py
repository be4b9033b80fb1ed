"""Recordings of a walk whose errors are drawn from what an estimator is told of them."""

from dataclasses import replace

import numpy as np

from stridelab.body.geometric_com import GeometricCom
from stridelab.estimation.error_priors import ErrorPriors
from stridelab.recordings.recording import Window, WrenchTrack
from support.recordings.analytic_motions import Harmonics, Motion, walk

TABLE_SD_M = (0.009, 0.009, 0.02)


def draw(
    seed: int,
    priors: ErrorPriors,
    window: Window,
    table_sd_m: tuple[float, float, float] = TABLE_SD_M,
    duration_s: float = 2.0,
) -> tuple[Motion, GeometricCom, WrenchTrack]:
    """One walk of 70 kg at 100 Hz whose errors and angular momentum are drawn from the priors, and its truth."""
    t = np.arange(round(100 * duration_s)) / 100.0
    rng = np.random.default_rng(seed)
    amplitude = np.sqrt(2) * 70 * np.array(priors.momentum_rate_nm_kg)
    lines = ((priors.step_hz / 2, np.array([1.0, 0, 0])), (priors.step_hz, np.array([0, 1.0, 0])))
    waves = tuple(
        (hz, a / (2 * np.pi * hz) * axis, rng.uniform(0, 2 * np.pi))
        for (hz, axis), a in zip(lines, amplitude, strict=True)
    )
    motion = Motion(walk().com, Harmonics(np.zeros(3), np.zeros(3), waves), 70.0)
    late_s = rng.normal(0, priors.clock_s)
    f_error = 70 * rng.normal(0, priors.acceleration_m_s2) + rng.normal(0, priors.force_n, (len(t), 3))
    nu_error = np.append(rng.normal(0, priors.moment_nm, 2), 0.0)
    f = motion.force(t - late_s) + f_error
    # the moment error is stated at the body: a force error comes with its lever arm
    nu = motion.moment(t - late_s) + np.cross(motion.com.at(t - late_s), f_error) + nu_error
    geometric = motion.geometric(t, rng.normal(0, table_sd_m), rng.normal(0, priors.marker_m, (len(t), 3)))
    complete = (window.start_s <= t) & (window.end_s >= t)
    return motion, replace(geometric, sd_m=table_sd_m), WrenchTrack(t, f, nu, complete, (window,))
