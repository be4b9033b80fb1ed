"""Speed of the Kalman filter and of the smoother on its model; run by ``make bench`` (skipped otherwise)."""

import jaxtyping
import numpy as np
import pytest

from stridelab.estimation.jerk_record import JerkRecord, Pass
from stridelab.estimation.kalman import KalmanFilter
from stridelab.estimation.kalman_passes import Axis
from stridelab.estimation.rts import RtsSmoother
from stridelab.recordings.recording import Window
from support.motions import walk

RATE_HZ = 200.0
MOTION = walk()


@pytest.fixture(autouse=True)
def as_in_production():
    """The run-time checks of annotations belong to the tests; users do not pay for them."""
    before = jaxtyping.config.jaxtyping_disable
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", before)


def rate(benchmark, samples):
    benchmark.extra_info["samples_per_s"] = round(samples / benchmark.stats.stats.median)


def jerk_record(samples: int) -> JerkRecord:
    t = np.arange(samples) / RATE_HZ
    wrench = MOTION.wrench_track(t, Window(0.0, samples / RATE_HZ))
    return KalmanFilter().record(MOTION.geometric(t), wrench, MOTION.mass_kg)


def three_axes(record: JerkRecord, passed: Pass) -> None:
    i = record.inputs
    for j, axis in enumerate(record.axes):
        y = np.stack([i.geometry_m[:, j], i.acceleration_m_s2[:, j], i.axis_point_m[:, j]], axis=-1)[None]
        passed(axis, y, np.array([[y[0, 0, 0], 0.0, 0.0]]))


@pytest.mark.parametrize("samples", [1800, 200_000])
def test_kalman_filter(benchmark, samples):
    record = jerk_record(samples)
    benchmark(lambda: three_axes(record, Axis.filtered))
    rate(benchmark, samples)


@pytest.mark.parametrize("samples", [1800, 200_000])
def test_rts_smoother(benchmark, samples):
    record = jerk_record(samples)
    benchmark(lambda: three_axes(record, Axis.smoothed))
    rate(benchmark, samples)


@pytest.mark.parametrize("estimator", [KalmanFilter(), RtsSmoother()], ids=["kalman", "rts"])
def test_estimate_with_its_band(benchmark, estimator):
    t = np.arange(1800) / RATE_HZ
    geometric, wrench = MOTION.geometric(t), MOTION.wrench_track(t, Window(0.0, 9.0))
    benchmark(lambda: estimator.estimate(geometric, wrench, MOTION.mass_kg))
    rate(benchmark, 1800)
