"""Speed of the estimators; run by ``make bench`` (skipped otherwise). Samples per second are printed as extra info."""

import numpy as np
import pytest
from center_of_mass import estimator

from stridelab.dynamics.wrench import Wrench, central_axis
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.estimation.complementary.forward_backward import filter_inputs, forward_backward
from stridelab.estimation.complementary.transfer_functions import complementary_filters
from support.recordings.analytic_motions import walk

RATE_HZ = 200.0
FILTERS = complementary_filters(0.2, 1.0, RATE_HZ)
MOTION = walk()


def recording(samples):
    t = np.arange(samples) / RATE_HZ
    return MOTION.com.at(t), Wrench(MOTION.force(t), MOTION.moment(t))


@pytest.mark.parametrize("samples", [1800, 200_000])
def test_complementary_filter_forward_backward(benchmark, note_rate, samples):
    c, wrench = recording(samples)
    benchmark(lambda: forward_backward(FILTERS, filter_inputs(c, wrench, MOTION.mass_kg)))
    note_rate(samples)


def test_axis_projection(benchmark, note_rate):
    c, wrench = recording(200_000)
    benchmark(lambda: central_axis(wrench).project(c))
    note_rate(200_000)


def test_1000_online_steps(benchmark):
    """Position, velocity and band, one sample at a time."""
    c, wrench = recording(1000)
    t = (np.arange(1000) / RATE_HZ).tolist()
    samples = list(zip(t, c, wrench.force_n, wrench.moment_nm, strict=True))

    def second():
        online = ComplementaryFilter().causal(MOTION.mass_kg, (0.009, 0.009, 0.02))
        for sample in samples:
            online.step(*sample)

    benchmark(second)
    benchmark.extra_info["us_per_step"] = round(1e6 * benchmark.stats.stats.median / 1000, 2)


@pytest.mark.parametrize("samples", [1800])
def test_center_of_mass_package_for_comparison(benchmark, note_rate, samples):
    c, wrench = recording(samples)
    a = wrench.force_n / MOTION.mass_kg - np.array([0.0, 0.0, 9.81])
    l1, l2 = estimator.estimator_gains(2.0, 0.002, RATE_HZ, MOTION.mass_kg)
    benchmark(lambda: estimator.estimator_backandforth(a.T, c.T, l1, l2, RATE_HZ))
    note_rate(samples)
