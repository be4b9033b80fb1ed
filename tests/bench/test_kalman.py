"""Speed of the Kalman filter and of the smoother on its model; run by ``make bench`` (skipped otherwise)."""

from collections.abc import Callable

import numpy as np
import pytest

from stridelab.estimation.kalman.filter import KalmanFilter, RtsSmoother
from stridelab.estimation.kalman.passes import Axis, JerkRecord
from stridelab.recordings.recording import Window
from support.oracles.estimators import textbook
from support.recordings.analytic_motions import walk

RATE_HZ = 200.0
MOTION = walk()


def jerk_record(samples: int) -> JerkRecord:
    t = np.arange(samples) / RATE_HZ
    wrench = MOTION.wrench_track(t, Window(0.0, samples / RATE_HZ))
    return KalmanFilter().prepare_record(MOTION.geometric(t), wrench, MOTION.mass_kg)


def three_axes(record: JerkRecord, passed: Callable[..., object]) -> None:
    i = record.inputs
    for j, axis in enumerate(record.axes):
        y = np.stack([i.geometry_m[:, j], i.acceleration_m_s2[:, j], i.axis_point_m[:, j]], axis=-1)[None]
        passed(axis, y, np.array([[y[0, 0, 0], 0.0, 0.0]]))


@pytest.mark.parametrize("samples", [1800, 200_000])
def test_kalman_filter(benchmark, note_rate, samples):
    record = jerk_record(samples)
    benchmark(lambda: three_axes(record, Axis.filter_states))
    note_rate(samples)


@pytest.mark.parametrize("samples", [1800, 200_000])
def test_rts_smoother(benchmark, note_rate, samples):
    record = jerk_record(samples)
    benchmark(lambda: three_axes(record, Axis.smooth_states))
    note_rate(samples)


@pytest.mark.parametrize("samples", [1800])
def test_textbook_kalman_and_rts_loop_for_comparison(benchmark, note_rate, samples):
    """The same three axes, sample by sample; filter and smoother come out of one loop."""
    record = jerk_record(samples)

    def loop(axis: Axis, y: np.ndarray, start: np.ndarray) -> None:
        noise = axis.model.B @ axis.model.B.T * axis.model.sigma_jerk_m_s3**2
        textbook(axis.model.A, noise, np.array(axis.variance), y[0], start[0], axis.start_covariance)

    benchmark.pedantic(lambda: three_axes(record, loop), rounds=3)
    note_rate(samples)


@pytest.mark.parametrize("estimator", [KalmanFilter(), RtsSmoother()], ids=["kalman", "rts"])
def test_estimate_with_its_band(benchmark, note_rate, estimator):
    t = np.arange(1800) / RATE_HZ
    geometric, wrench = MOTION.geometric(t), MOTION.wrench_track(t, Window(0.0, 9.0))
    benchmark(lambda: estimator.estimate(geometric, wrench, MOTION.mass_kg))
    note_rate(1800)
