"""The thesis' rule of 3.3.3: the two passages of the hub's height around the lowest point."""

import numpy as np
import pytest
from hypothesis import given, settings
from numpy.testing import assert_allclose

from stridelab.walking.double_support import crossings_at_lowest, double_support_of_wheel
from stridelab.walking.path_fit import fit_path
from stridelab.walking.timed_fit import fit_in_time
from support.recordings.analytic_motions import PERIOD_S, rolled_wheel, walks

OMEGA = 2 * np.pi / PERIOD_S


def instant(case, angle_rad: float) -> float:
    return float(np.interp(angle_rad, case.theta_rad, case.time_s))


@pytest.mark.parametrize("fit", [fit_path, fit_in_time])
def test_the_rule_is_the_passage_of_the_hub_s_height(fit):
    case = rolled_wheel(theta0_rad=-4.5, turns=1.2)  # to +3.0: both passages lie inside
    start, end = double_support_of_wheel(fit(case.time_s, case.path_m, PERIOD_S), case.time_s)
    assert start == pytest.approx(case.time_s[0] + (4.5 - np.pi / 2) / OMEGA, abs=1e-6)
    assert end == pytest.approx(case.time_s[0] + (4.5 + np.pi / 2) / OMEGA, abs=1e-6)
    height = np.interp([start, end], case.time_s, case.path_m[:, 1])
    assert_allclose(height, case.wheel.z0_m, atol=1e-4)


@settings(max_examples=40, deadline=None)
@given(walks(uneven=False))
def test_the_rule_gives_half_a_turn_for_any_double_support(case):
    fit = fit_in_time(case.time_s, case.path_m, case.period_s, case.wheel.branch)
    lowest = float(case.time_s[np.argmax(np.cos(case.theta_rad))])
    start, end = double_support_of_wheel(fit, case.time_s, near_s=lowest)
    assert start is not None or end is not None  # most of a turn always holds one of them
    for boundary in (start, end):
        assert boundary is None or case.time_s[0] <= boundary <= case.time_s[-1]
    if start is not None and end is not None:
        assert end - start == pytest.approx(np.pi / case.omega_rad_s, rel=1e-5)


def test_a_passage_after_the_last_sample_or_before_the_first_is_not_known():
    t = np.linspace(0.0, 0.5, 51)
    assert crossings_at_lowest(t, np.linspace(-5.0, 1.0, 51), 0.5) == (pytest.approx(0.5 * (5 - np.pi / 2) / 6), None)
    assert crossings_at_lowest(t, np.linspace(-1.0, 5.0, 51), 0.0) == (None, pytest.approx(0.5 * (1 + np.pi / 2) / 6))
    assert crossings_at_lowest(t, np.linspace(2.0, 4.0, 51), 0.2) == (
        None,
        None,
    )  # from one ridge's flank to the other's


def test_of_two_minima_the_requested_one_is_used():
    t = np.linspace(0.0, 1.0, 1001)
    theta = np.linspace(-np.pi, 3 * np.pi, 1001)
    for near, expected in ((0.2, (0.125, 0.375)), (0.3, (0.125, 0.375)), (0.7, (0.625, 0.875)), (0.95, (0.625, 0.875))):
        assert crossings_at_lowest(t, theta, near) == pytest.approx(expected)


def test_by_default_the_minimum_at_the_end_of_the_step_is_used():
    """As fast as people can walk: a step begins just before one lowest point and ends before the next."""
    case = rolled_wheel(theta0_rad=-0.1, turns=0.9)
    fit = fit_path(case.time_s, case.path_m, PERIOD_S)
    start, end = double_support_of_wheel(fit, case.time_s)
    assert start == pytest.approx(case.time_s[0] + (0.1 + 1.5 * np.pi) / OMEGA, abs=1e-6)
    assert end is None
    first = double_support_of_wheel(fit, case.time_s, near_s=float(case.time_s[5]))
    assert first == (None, pytest.approx(case.time_s[0] + (0.1 + 0.5 * np.pi) / OMEGA, abs=1e-6))


def test_a_whole_turn_of_theta_does_not_change_the_passages():
    t = np.linspace(0.0, 0.5, 51)
    theta = np.linspace(-4.0, 2.0, 51)
    assert_allclose(crossings_at_lowest(t, theta, 0.4), crossings_at_lowest(t, theta - 6 * np.pi, 0.4), atol=1e-12)


def test_a_wheel_that_rolls_backwards_has_no_crossings():
    t = np.linspace(0.0, 0.5, 51)
    theta = np.linspace(-4.0, 3.0, 51)
    theta[20] = theta[18]
    assert crossings_at_lowest(t, theta, 0.4) == (None, None)
