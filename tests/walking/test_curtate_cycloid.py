"""The curve (3.1), (3.2): derivatives, both branches, and what a wheel that rolls does."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from stridelab.walking.curtate_cycloid import Wheel, parameter_rows, turn_to_zero
from support.recordings.analytic_motions import HUMAN, central_differences, parameters, walks

THETA = np.linspace(-7.0, 5.0, 41)


def placed(p: np.ndarray, theta: np.ndarray, branch) -> np.ndarray:
    x0, R, r, z0 = p
    return np.column_stack([x0 + R * theta - branch * r * np.sin(theta), z0 - r * np.cos(theta)])


@settings(max_examples=50, deadline=None)
@given(walks(uneven=True))
def test_the_curve_is_that_of_the_equations(case):
    expected = placed(parameters(case.wheel), case.theta_rad, case.wheel.branch)
    assert_allclose(case.path_m, expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("branch", [1, -1])
def test_derivatives_are_those_of_finite_differences(branch):
    wheel = Wheel(R_m=0.1, r_m=0.03, z0_m=0.9, x0_m=-1.2, branch=branch)
    h = 1e-6
    slope = (wheel.position_m(THETA + h) - wheel.position_m(THETA - h)) / (2 * h)
    assert_allclose(wheel.tangent_m(THETA), slope, atol=1e-9)
    ahead, up = parameter_rows(THETA, branch)
    for axis, rows in enumerate((ahead, up)):
        of_parameters = central_differences(lambda p, i=axis: placed(p, THETA, branch)[:, i], parameters(wheel))
        assert_allclose(rows, of_parameters, atol=1e-8)
        assert_allclose(rows @ parameters(wheel), wheel.position_m(THETA)[:, axis], atol=1e-14)


@pytest.mark.parametrize("branch", [1, -1])
def test_the_point_goes_round_the_hub_and_the_rim_does_not_slip(branch):
    wheel = Wheel(R_m=0.1, r_m=0.03, z0_m=0.9, x0_m=4.0, branch=branch)
    spoke = wheel.position_m(THETA) - wheel.hub_m(THETA)
    assert_allclose(np.hypot(spoke[:, 0], spoke[:, 1]), 0.03)
    assert_allclose(np.diff(wheel.hub_m(THETA)[:, 0]), 0.1 * np.diff(THETA))
    rim = Wheel(R_m=0.1, r_m=0.1, z0_m=0.9, x0_m=4.0, branch=branch)
    touching = np.array([0.0 if branch == 1 else np.pi])  # the rim rolls on a line below the hub, or above it
    assert_allclose(rim.tangent_m(touching), 0.0, atol=1e-15)


def test_at_the_lowest_point_one_branch_is_slowest_and_the_other_fastest():
    omega = 11.0
    for branch in (1, -1):
        wheel = Wheel(R_m=0.1, r_m=0.02, z0_m=0.9, x0_m=0.0, branch=branch)
        (speed,) = omega * wheel.tangent_m(np.zeros(1))[:, 0]
        assert speed == pytest.approx(0.1 * omega - branch * 0.02 * omega)


def test_the_branches_are_one_curve_upside_down_and_half_a_turn_later():
    other = Wheel(R_m=HUMAN.R_m, r_m=HUMAN.r_m, z0_m=-HUMAN.z0_m, x0_m=HUMAN.x0_m - np.pi * HUMAN.R_m, branch=-1)
    assert_allclose(HUMAN.position_m(THETA) * [1.0, -1.0], other.position_m(THETA + np.pi), atol=1e-12)


def test_the_convex_part_is_short_on_the_thesis_branch_and_long_on_the_other():
    theta = np.linspace(0.0, 2 * np.pi, 20_001)
    for branch, share in ((1, 0.405), (-1, 0.595)):
        wheel = Wheel(R_m=0.1, r_m=0.015, z0_m=0.95, x0_m=0.0, branch=branch)
        x, z = wheel.position_m(theta).T
        bend = np.gradient(np.gradient(z, x), x)
        assert np.gradient(x)[bend > 0].sum() / (2 * np.pi * 0.1) == pytest.approx(share, abs=0.002)


@pytest.mark.parametrize(("r_m", "inside"), [(0.0, False), (0.03, True), (0.1, False), (0.2, False)])
def test_a_wheel_is_curtate_if_it_never_goes_backwards(r_m, inside):
    wheel = Wheel(R_m=0.1, r_m=r_m, z0_m=0.9, x0_m=0.0)
    assert wheel.is_curtate is inside
    assert (wheel.tangent_m(np.linspace(0.0, 2 * np.pi, 9))[:, 0] > 0).all() == (r_m < 0.1)


@settings(max_examples=60, deadline=None)
@given(st.floats(-40.0, 40.0), st.floats(-0.2, 0.2).filter(lambda r: r != 0.0), st.sampled_from([1, -1]))
def test_a_whole_turn_of_theta_does_not_change_the_curve(middle, r, branch):
    p = np.array([1.3, 0.1, r, 0.9])
    turn = turn_to_zero(middle, r)
    theta = middle + np.linspace(-3.0, 3.0, 13)
    named = turn.change @ p
    assert named[2] > 0
    assert abs(middle - turn.by_rad) <= np.pi + 1e-9
    assert_allclose(placed(named, theta - turn.by_rad, branch), placed(p, theta, branch), atol=1e-12)
