"""Sample by sample gives what the batch gives."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stridelab.dynamics.wrench import Wrench
from stridelab.estimation.filters import complementary_filters
from stridelab.estimation.online import OnlineComplementaryFilter
from stridelab.estimation.passes import filter_inputs, forward, initial_state
from support.motions import uniform, walk


@pytest.mark.parametrize("rate_hz", [100.0, 200.0, 1000.0])
def test_the_online_step_equals_the_batch_forward_pass(rate_hz):
    rng = np.random.default_rng(1)
    motion, t = walk(), np.arange(int(2 * rate_hz)) / rate_hz
    g = motion.com.at(t) + rng.normal(0, 0.01, (len(t), 3))
    f, nu = motion.force(t) + rng.normal(0, 10, g.shape), motion.moment(t) + rng.normal(0, 10, g.shape)
    f[20:30], nu[20:30] = 0.0, 0.0  # a flight phase
    filters = complementary_filters(0.4, 4.0, rate_hz)
    inputs = filter_inputs(g, Wrench(f, nu), motion.mass_kg)
    start = initial_state(filters, inputs)
    batch = forward(filters, inputs, start)
    online = OnlineComplementaryFilter(filters, motion.mass_kg, start)
    stepped = np.array([online.step(*sample) for sample in zip(g, f, nu, strict=True)])
    assert_allclose(stepped, batch, atol=1e-12, rtol=0)


def test_without_a_start_a_uniform_motion_of_known_velocity_passes_unchanged():
    motion, t = uniform(), np.arange(300) / 100.0
    filters = complementary_filters(0.4, 4.0, 100.0)
    online = OnlineComplementaryFilter(filters, motion.mass_kg, velocity_m_s=motion.com.rate)
    c, f, nu = motion.com.at(t), motion.force(t), motion.moment(t)
    stepped = np.array([online.step(*sample) for sample in zip(c, f, nu, strict=True)])
    assert_allclose(stepped, c, atol=1e-9, rtol=0)


def test_a_wrong_velocity_is_forgotten_within_ten_time_constants():
    motion, t = uniform(), np.arange(300) / 100.0
    filters = complementary_filters(0.4, 4.0, 100.0)
    online = OnlineComplementaryFilter(filters, motion.mass_kg)
    c, f, nu = motion.com.at(t), motion.force(t), motion.moment(t)
    error = np.array([online.step(*sample) for sample in zip(c, f, nu, strict=True)]) - c
    assert np.abs(error[:3]).max() > 0.005
    assert np.abs(error[40:]).max() < 1e-4
