"""The Rauch-Tung-Striebel smoother: against a textbook's loop, and against the filter it repairs."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stridelab.estimation.kalman.filter import KalmanFilter, RtsSmoother
from stridelab.estimation.kalman.jerk_model import JerkModel, split_stretches
from stridelab.estimation.kalman.passes import Axis
from stridelab.recordings.recording import Window
from support.oracles.estimators import textbook
from support.recordings.analytic_motions import masked_record, uniform, walk


@pytest.mark.parametrize(("rate_hz", "sigma", "n"), [(100.0, 20.0, 400), (200.0, 1.0, 900), (1000.0, 20.0, 1500)])
def test_two_directions_of_information_are_the_textbook_smoother(rate_hz: float, sigma: float, n: int):
    y, measured = masked_record(rate_hz, n)
    axis = Axis(
        JerkModel(1 / rate_hz, sigma), (1e-4, 1e-2, 4e-4), split_stretches(measured), np.diag([1.0, 25.0, 100.0])
    )
    x0 = np.array([y[0, 0], 0.0, 0.0])
    A, B = axis.model.A, axis.model.B
    theirs = textbook(A, B @ B.T * sigma**2, np.array(axis.variance), y, x0, axis.start_covariance)
    ours = axis.smooth_states(y[None], x0[None])
    assert_allclose(ours.mean[0], theirs.smoothed, atol=1e-7)
    assert_allclose(ours.mean[0, :, 0], theirs.smoothed[:, 0], atol=1e-9)
    scale = np.sqrt(np.einsum("kii,kjj->kij", theirs.smoothed_covariance, theirs.smoothed_covariance))
    assert (np.abs(ours.covariance - theirs.smoothed_covariance) / scale).max() < 1e-6


def test_smoothing_delays_nothing():
    """A sinusoid on which all inputs agree keeps its phase in mid-record; the filter on the same model is late."""
    rate_hz, n, w = 200.0, 4000, 2 * np.pi * 0.9
    t = np.arange(n) / rate_hz
    y = np.column_stack([np.sin(w * t), -(w**2) * np.sin(w * t), np.sin(w * t)])[None]
    axis = Axis(
        JerkModel(1 / rate_hz, 1.0),
        (1e-4, 1e-2, 4e-4),
        split_stretches(np.ones((n, 3), dtype=bool)),
        np.diag([1.0, 25, 100]),
    )
    middle = (t > 7) & (t < 13)
    waves = np.column_stack([np.sin(w * t), np.cos(w * t)])[middle]
    for result, late_s in (
        (axis.smooth_states(y, np.zeros((1, 3))), 0.0),
        (axis.filter_states(y, np.zeros((1, 3))), axis.lag_s(0.9)),
    ):
        a, b = np.linalg.lstsq(waves, result.mean[0, middle, 0], rcond=None)[0]
        assert -np.arctan2(b, a) / w == pytest.approx(late_s, abs=1e-5)
    assert axis.lag_s(0.9) > 0.01


@pytest.mark.parametrize("window", [Window(0.0, 1.995), Window(0.5, 1.5)])
def test_it_is_closer_to_the_truth_than_the_filter_on_the_same_model(window: Window):
    t, motion = np.arange(400) / 200.0, walk()
    geometric, wrench = motion.geometric(t), motion.wrench_track(t, window)
    for model in (KalmanFilter(sigma_jerk_m_s3=20.0), KalmanFilter.tuned()):
        errors = [
            np.sqrt(np.mean((e.com_m - motion.com.at(e.time_s)) ** 2))
            for e in (estimator.estimate(geometric, wrench, 70.0) for estimator in (RtsSmoother(kalman=model), model))
        ]
        assert errors[0] < 0.6 * errors[1]


def test_a_body_that_coasts_is_estimated_from_the_first_sample_on():
    t, motion = np.arange(400) / 200.0, uniform()
    wrench = motion.wrench_track(t, Window(0.0, 1.995))
    estimate = RtsSmoother().estimate(motion.geometric(t), wrench, motion.mass_kg)
    assert_allclose(estimate.com_m, motion.com.at(t), atol=1e-4)
    assert_allclose(estimate.velocity_m_s, np.tile(motion.com.rate, (400, 1)), atol=1e-3)
