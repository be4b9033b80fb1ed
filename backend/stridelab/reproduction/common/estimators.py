"""Estimators compared in the simulation study, with priors that match the simulated noise.

The thesis' Kalman filter uses the true noise covariance (2.5.3), hence the smoother does too. All estimators are given
the size of the body model error but not its value, and no information on the angular momentum.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np

from stridelab.conventions import GRAVITY_M_S2
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.estimation.estimator import ComEstimator
from stridelab.estimation.kalman.filter import TUNED_SIGMA_JERK_M_S3, KalmanFilter, RtsSmoother
from stridelab.estimation.kalman.jerk_model import InputNoise
from stridelab.estimation.markers_only import GeometryOnly
from stridelab.estimation.smoother import Smoother, SmootherPriors
from stridelab.reproduction.studies.estimator_study import StudyTrial

GEOMETRY: Final = "geometry"
THESIS: Final = "complementary-thesis"
AUTO: Final = "complementary"
KALMAN: Final = "kalman-thesis"
TUNED: Final = "kalman"
RTS: Final = "rts"
SMOOTHER: Final = "smoother"
NAMES: Final = (GEOMETRY, THESIS, AUTO, KALMAN, TUNED, RTS, SMOOTHER)
"""Names as in ``compare-estimators``; ``-thesis`` uses the settings of the thesis, the others those of stridelab.
``kalman`` and ``rts`` use a jerk that is realistic for walking and, here, the true noise."""
_PLATE_HEIGHT_M: Final = 0.83
"""Height of the CoM above the plates: lever arm of the force noise in the position of the axis."""


def study_estimators(trial: StudyTrial, *, beyond_window: bool = False) -> Mapping[str, ComEstimator]:
    """All estimators for one trial by name; ``beyond_window`` extends the smoother beyond the force window."""
    noise = true_input_noise(trial)
    tuned = KalmanFilter(sigma_jerk_m_s3=TUNED_SIGMA_JERK_M_S3, noise=noise)
    return {
        GEOMETRY: GeometryOnly(),
        THESIS: ComplementaryFilter.thesis(),
        AUTO: ComplementaryFilter(),
        KALMAN: KalmanFilter(noise=noise),
        TUNED: tuned,
        RTS: RtsSmoother(kalman=tuned),
        SMOOTHER: Smoother(priors=true_noise_priors(trial), beyond_window=beyond_window),
    }


def true_noise_priors(trial: StudyTrial) -> SmootherPriors:
    """Smoother priors with the sizes of the simulated noise.

    Raises ``InvalidInput`` (``prior-out-of-range``) for a trial without noise.
    """
    noise = trial.noise
    return SmootherPriors(
        marker_m=float(np.mean(trial.noise_sd_m)),
        marker_corner_hz=noise.high_pass_hz,
        force_n=noise.force_n,
        moment_nm=noise.moment_nm,
        plate_corner_hz=noise.high_pass_hz,
        plate_force_n=noise.plate_bias_n,
        plate_moment_nm=noise.plate_bias_nm,
        walking_moment_nm=(0.0, 0.0),
        clock_s=abs(noise.latency_s),
    )


def true_input_noise(trial: StudyTrial) -> InputNoise:
    """Measurement noise of the Kalman filter: the simulated noise propagated to the three inputs."""
    x, y, z = trial.noise_sd_m
    force = trial.noise.force_n
    axis = float(np.hypot(trial.noise.moment_nm, _PLATE_HEIGHT_M * force) / (trial.mass_kg * GRAVITY_M_S2))
    return InputNoise(geometry_m=(x, y, z), force_n=(force, force, force), axis_m=(axis, axis, z))
