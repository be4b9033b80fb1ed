"""Speed of the estimators; run by ``make bench`` (skipped otherwise). Samples per second are printed as extra info."""

import jaxtyping
import numpy as np
import pytest

from stridelab.dynamics.central_axis import central_axis
from stridelab.dynamics.wrench import Wrench
from stridelab.estimation.complementary import ComplementaryFilter
from stridelab.estimation.filters import complementary_filters
from stridelab.estimation.passes import filter_inputs, forward_backward
from support.motions import walk

RATE_HZ = 200.0
FILTERS = complementary_filters(0.2, 1.0, RATE_HZ)
MOTION = walk()


@pytest.fixture(autouse=True)
def as_in_production():
    """The run-time checks of annotations belong to the tests; users do not pay for them."""
    before = jaxtyping.config.jaxtyping_disable
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", before)


def recording(samples):
    t = np.arange(samples) / RATE_HZ
    return MOTION.com.at(t), Wrench(MOTION.force(t), MOTION.moment(t))


def rate(benchmark, samples):
    benchmark.extra_info["samples_per_s"] = round(samples / benchmark.stats.stats.median)


@pytest.mark.parametrize("samples", [1800, 200_000])
def test_complementary_filter_forward_backward(benchmark, samples):
    c, wrench = recording(samples)
    benchmark(lambda: forward_backward(FILTERS, filter_inputs(c, wrench, MOTION.mass_kg)))
    rate(benchmark, samples)


def test_axis_projection(benchmark):
    c, wrench = recording(200_000)
    benchmark(lambda: central_axis(wrench).project(c))
    rate(benchmark, 200_000)


def test_online_step(benchmark):
    """Position, velocity and band, one sample at a time."""
    c, wrench = recording(1000)
    t = (np.arange(1000) / RATE_HZ).tolist()
    samples = list(zip(t, c, wrench.force_n, wrench.moment_nm, strict=True))

    def second():
        online = ComplementaryFilter().causal(MOTION.mass_kg, (0.009, 0.009, 0.02))
        for sample in samples:
            online.step(*sample)

    benchmark(second)
    rate(benchmark, 1000)


@pytest.mark.parametrize("samples", [1800])
def test_center_of_mass_package_for_comparison(benchmark, samples):
    estimator = pytest.importorskip("center_of_mass.estimator", reason="the comparison needs the dev dependency")
    c, wrench = recording(samples)
    a = wrench.force_n / MOTION.mass_kg - np.array([0.0, 0.0, 9.81])
    l1, l2 = estimator.estimator_gains(2.0, 0.002, RATE_HZ, MOTION.mass_kg)
    benchmark(lambda: estimator.estimator_backandforth(a.T, c.T, l1, l2, RATE_HZ))
    rate(benchmark, samples)
