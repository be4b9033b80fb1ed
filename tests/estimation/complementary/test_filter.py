"""The complementary filter on motions whose truth is known in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal

from stridelab.dynamics.wrench import Wrench
from stridelab.errors import InvalidInput, NotEstimable
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.estimation.complementary.forward_backward import (
    filter_inputs,
    forward_backward,
    forward_pass,
    initial_state,
    joined_passes,
)
from stridelab.estimation.complementary.transfer_functions import complementary_filters
from stridelab.estimation.evaluation.physics_residuals import bias_m, force_residual_n
from stridelab.recordings.recording import Window
from support.recordings.analytic_motions import sinusoid, uniform, walk

RATES_HZ = (100.0, 200.0, 1000.0)


def exact_inputs(motion, t):
    return filter_inputs(motion.com.at(t), Wrench(motion.force(t), motion.moment(t)), motion.mass_kg)


@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize("cutoffs", [(0.4, 4.0), (0.2, 1.0)])
def test_uniform_motion_passes_unchanged_from_the_first_sample_on(rate_hz: float, cutoffs: tuple[float, float]) -> None:
    t = np.arange(int(3 * rate_hz)) / rate_hz
    inputs = exact_inputs(uniform(), t)
    filters = complementary_filters(*cutoffs, rate_hz)
    truth = uniform().com.at(t)
    assert_allclose(forward_pass(filters, inputs, initial_state(filters, inputs)), truth, atol=1e-9, rtol=0)
    assert_allclose(forward_backward(filters, inputs), truth, atol=1e-9, rtol=0)


def test_the_pass_begins_with_the_smallest_correction_over_ten_time_constants():
    """f_1 = 4 Hz at 100 Hz: 39 samples. Any other start of H2 makes ``H2 a - s^2 H2 g`` larger there."""
    filters, rng = complementary_filters(0.4, 4.0, 100.0), np.random.default_rng(6)
    exact = exact_inputs(walk(), np.arange(200) / 100.0)
    inputs = replace(exact, geometry_m=exact.geometry_m + rng.normal(0, 0.01, (200, 3)))
    state = initial_state(filters, inputs)

    def size(h2):
        high = signal.lfilter(filters.h2.b, filters.h2.a, inputs.acceleration_m_s2, axis=0, zi=h2)[0]
        low = signal.lfilter(filters.s2_h2.b, filters.s2_h2.a, inputs.geometry_m, axis=0, zi=state.s2_h2)[0]
        return ((high - low)[:39] ** 2).sum()

    gradient = [(size(state.h2 + step) - size(state.h2 - step)) / 2e-6 for step in 1e-6 * np.eye(6).reshape(6, 2, 3)]
    assert np.abs(gradient).max() < 1e-6
    assert size(state.h2 + 0.01) > size(state.h2)


def test_over_many_seconds_it_does_not_matter_how_the_passes_begin():
    """(2.6.3): states that bring both passes together; in the middle both have forgotten them. A coast shows none."""
    filters = complementary_filters(0.4, 4.0, 100.0)
    t = np.arange(1600) / 100.0
    assert_allclose(joined_passes(filters, exact_inputs(uniform(), t)), uniform().com.at(t), atol=1e-8, rtol=0)
    inputs = exact_inputs(walk(), t)
    joined, solved = joined_passes(filters, inputs), forward_backward(filters, inputs)
    assert_allclose(joined[700:900], solved[700:900], atol=1e-6, rtol=0)
    assert np.abs(joined - solved).max() > 1e-4


@pytest.mark.parametrize("cutoffs", [(0.4, 4.0), (0.2, 1.0)])
def test_one_hertz_passes_to_two_parts_in_a_hundred_thousand(cutoffs: tuple[float, float]) -> None:
    t = np.arange(600) / 200.0
    motion = sinusoid(1.0)
    filters = complementary_filters(*cutoffs, 200.0)
    error = forward_backward(filters, exact_inputs(motion, t)) - motion.com.at(t)
    assert np.abs(error).max() < 2e-8


def test_one_hertz_passes_forward_to_two_parts_in_a_hundred_thousand():
    t = np.arange(600) / 200.0
    motion = sinusoid(1.0)
    filters = complementary_filters(0.4, 4.0, 200.0)
    inputs = exact_inputs(motion, t)
    error = forward_pass(filters, inputs, initial_state(filters, inputs)) - motion.com.at(t)
    assert np.abs(error).max() < 2e-5


@pytest.mark.parametrize("estimator", [ComplementaryFilter(), ComplementaryFilter.thesis()])
def test_the_estimator_passes_exact_motions_over_a_full_window(estimator):
    t = np.arange(600) / 200.0
    for motion, tolerance in ((uniform(), 1e-9), (sinusoid(1.0), 2e-5)):
        wrench = motion.wrench_track(t, Window(0.0, 3.0))
        estimate = estimator.estimate(motion.geometric(t), wrench, motion.mass_kg)
        assert_allclose(estimate.com_m, motion.com.at(t), atol=tolerance, rtol=0)


@pytest.mark.parametrize("window", [Window(0.0, 1.0), Window(0.5, 1.5), Window(1.0, 2.0)])
def test_uniform_motion_passes_through_a_window_anywhere(window):
    t = np.arange(200) / 100.0
    motion = uniform()
    estimate = ComplementaryFilter().estimate(motion.geometric(t), motion.wrench_track(t, window), motion.mass_kg)
    assert_allclose(estimate.com_m, motion.com.at(estimate.time_s), atol=1e-9, rtol=0)
    assert_allclose(estimate.velocity_m_s, np.tile(motion.com.rate, (len(estimate.time_s), 1)), atol=1e-5)
    assert_allclose(estimate.acceleration_m_s2, 0.0, atol=1e-3)


def test_a_constant_bias_of_the_table_is_removed_at_once_where_the_axis_can_see_it():
    motion, t = uniform((1.2, 0.0, 0.0)), np.arange(300) / 100.0
    bias = np.array([0.02, -0.015, 0.03])
    estimate = ComplementaryFilter.thesis().estimate(
        motion.geometric(t, bias), motion.wrench_track(t, Window(0.0, 2.99)), motion.mass_kg
    )
    error = estimate.com_m - motion.com.at(t)
    assert_allclose(error[:, :2], 0.0, atol=1e-9)
    assert_allclose(error[:, 2], bias[2], atol=1e-9)  # the height is along the force: nothing can see it


@pytest.mark.parametrize("beyond", ["cut", "geometry"])
def test_a_walk_is_reconstructed_inside_its_window_only(beyond):
    motion, t = walk(), np.arange(200) / 100.0
    window = Window(0.5, 1.5)
    estimate = ComplementaryFilter(beyond_window=beyond).estimate(
        motion.geometric(t), motion.wrench_track(t, window), motion.mass_kg
    )
    assert estimate.time_s[0] == pytest.approx(0.5)
    assert estimate.time_s[-1] == pytest.approx(1.5)
    error = estimate.com_m - motion.com.at(estimate.time_s)
    assert np.abs(error).max() < 0.02
    assert np.abs(estimate.velocity_m_s - motion.com.at(estimate.time_s, 1)).mean() < 0.03


def test_flight_takes_the_geometry_where_no_axis_exists():
    t = np.arange(100) / 100.0
    g = uniform().com.at(t)
    inputs = filter_inputs(g, Wrench(np.zeros((100, 3)), np.zeros((100, 3))), 70.0)
    assert_allclose(inputs.axis_point_m, g)
    assert_allclose(inputs.acceleration_m_s2, np.tile([0, 0, -9.81], (100, 1)))


def test_residual_and_bias_of_a_perfect_estimate_vanish():
    motion, t = walk(), np.arange(300) / 100.0
    wrench = motion.wrench_track(t, Window(0.0, 2.99))
    geometric = motion.geometric(t, np.array([0.01, 0.0, 0.0]))
    estimate = ComplementaryFilter.thesis().estimate(motion.geometric(t), wrench, motion.mass_kg)
    assert force_residual_n(estimate, wrench, motion.mass_kg).max() < 10
    assert_allclose(bias_m(estimate, geometric)[0], -0.01, atol=0.005)


def test_what_cannot_be_estimated_is_refused_by_name():
    motion, t = walk(), np.arange(200) / 100.0
    estimator = ComplementaryFilter()

    def code(geometric, window, mass_kg=70.0):
        wrench = motion.wrench_track(t, window) if window else motion.wrench_track(t, Window(0.0, 2.0))
        if window is None:
            wrench = type(wrench)(wrench.time_s, wrench.force_n, wrench.moment_nm, wrench.complete, ())
        with pytest.raises((NotEstimable, InvalidInput)) as error:
            estimator.estimate(geometric, wrench, mass_kg)
        return error.value.code

    g = motion.geometric(t)
    assert code(g, None) == "no-window"
    assert code(g, Window(0.5, 0.8)) == "window-too-short"
    assert code(g, Window(0.5, 1.5), mass_kg=-3.0) == "mass-out-of-range"
    holes = np.zeros((200, 3))
    holes[100:110] = np.nan
    assert code(motion.geometric(t, noise_m=holes), Window(0.5, 1.5)) == "geometry-gaps"
    assert code(motion.geometric(t[:150]), Window(0.5, 1.5)) == "clock-mismatch"
