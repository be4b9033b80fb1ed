"""The wheel as a clock (3.4): exact, with noise, against a bounded general solver, and on its bounds."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from numpy.testing import assert_allclose
from scipy.optimize import least_squares

from stridelab.walking.timed_fit import OMEGA_RANGE, TimedFit, fit_in_time
from support.recordings.analytic_motions import HUMAN, PERIOD_S, central_differences, parameters, rolled_wheel, walks

NOISE_M = 0.001


def six(fit: TimedFit) -> np.ndarray:
    return np.array([*parameters(fit.wheel), fit.theta0_rad, fit.omega_rad_s])


def errors(u: np.ndarray, t: np.ndarray, path: np.ndarray, branch: int) -> np.ndarray:
    x0, R, r, z0, theta0, omega = u
    theta = theta0 + omega * (t - t[0])
    x, z = x0 + R * theta - branch * r * np.sin(theta), z0 - r * np.cos(theta)
    return np.concatenate([x - path[:, 0], z - path[:, 1]])


@settings(max_examples=80, deadline=None)
@given(walks(uneven=False))
def test_an_exact_clock_comes_back_wherever_it_was_walked(case):
    fit = fit_in_time(case.time_s, case.path_m, case.period_s, case.wheel.branch)
    assert fit.bounds == ()
    assert_allclose(parameters(fit.wheel)[1:], parameters(case.wheel)[1:], rtol=1e-6)
    assert fit.omega_rad_s == pytest.approx(case.omega_rad_s, rel=1e-6)
    turns = (fit.theta0_rad - case.theta_rad[0]) / (2 * np.pi)
    assert turns == pytest.approx(round(turns), abs=1e-6)
    assert fit.distance_m.max() < 1e-8


@pytest.mark.parametrize("branch", [1, -1])
@pytest.mark.parametrize("unevenness", [-0.15, 0.05, 0.15])
def test_a_bounded_general_solver_finds_nothing_better(branch, unevenness):
    case = rolled_wheel(replace(HUMAN, branch=branch), unevenness=unevenness)
    t, path = case.time_s, case.path_m
    fit = fit_in_time(t, path, PERIOD_S, branch)
    turn = 2 * np.pi / PERIOD_S
    low, high = np.full(6, -np.inf), np.full(6, np.inf)
    low[5], high[5] = (share * turn for share in OMEGA_RANGE)
    costs = []
    for theta0 in np.linspace(-np.pi, np.pi, 5):
        for omega in (0.8, 1.0, 1.25):
            start = np.array([path[0, 0] - 0.1 * theta0, 0.1, 0.01, path[:, 1].mean(), theta0, omega * turn])
            solution = least_squares(
                errors, start, args=(t, path, branch), bounds=(low, high), x_scale="jac", xtol=1e-12
            )
            costs.append(2 * solution.cost)
    assert np.sum(fit.error_m**2) <= min(costs) * (1 + 1e-6)


@pytest.mark.parametrize("branch", [1, -1])
def test_its_covariance_is_that_of_the_finite_differences(branch):
    case = rolled_wheel(replace(HUMAN, branch=branch))
    path = case.path_m + NOISE_M * np.random.default_rng(1).standard_normal(case.path_m.shape)
    fit = fit_in_time(case.time_s, path, PERIOD_S, branch)
    J = central_differences(lambda u: errors(u, case.time_s, path, branch), six(fit))
    noise = np.sum(fit.error_m**2) / (2 * len(path) - 6)
    assert_allclose(fit.covariance, noise * np.linalg.inv(J.T @ J), rtol=1e-4, atol=1e-12)
    left = np.concatenate([fit.error_m[:, 0], fit.error_m[:, 1]])
    assert_allclose(J.T @ left / np.linalg.norm(J, axis=0), 0.0, atol=1e-8)
    fixed = fit_in_time(case.time_s, path, PERIOD_S, branch, one_turn_per_step=True)
    J = J[:, :5]
    assert_allclose(fixed.covariance[5], 0.0)
    assert np.diag(fixed.covariance)[:5].min() > 0
    assert (np.diag(fixed.covariance)[:5] < np.diag(fit.covariance)[:5] * 1.1).all()  # knowing omega is information


@pytest.mark.parametrize("branch", [1, -1])
def test_with_a_millimetre_of_noise_deviations_and_intervals_are_true(branch):
    rng = np.random.default_rng(9)
    case = rolled_wheel(replace(HUMAN, branch=branch))
    truth = parameters(case.wheel)
    off = []
    for _ in range(500):
        path = case.path_m + NOISE_M * rng.standard_normal(case.path_m.shape)
        fit = fit_in_time(case.time_s, path, PERIOD_S, branch)
        sd = np.sqrt(np.diag(fit.covariance))
        off.append([*(parameters(fit.wheel) - truth)[1:] / sd[1:4], (fit.omega_rad_s - case.omega_rad_s) / sd[5]])
    inside = np.abs(np.array(off))
    assert ((inside < 3).mean(axis=0) >= 0.99).all()
    assert (((inside < 1.96).mean(axis=0) >= 0.93) & ((inside < 1.96).mean(axis=0) <= 0.97)).all()


def test_one_turn_per_step_makes_the_circumference_the_step_length():
    case = rolled_wheel(turns=1.0)
    path = case.path_m + 0.002 * np.column_stack([np.sin(2 * case.theta_rad), np.cos(3 * case.theta_rad)])
    fit = fit_in_time(case.time_s, path, PERIOD_S, one_turn_per_step=True)
    assert fit.omega_rad_s == 2 * np.pi / PERIOD_S
    assert fit.bounds == ()
    speed = np.polyfit(case.time_s, path[:, 0], 1)[0]
    assert 2 * np.pi * fit.wheel.R_m == pytest.approx(speed * PERIOD_S, rel=0.05)


@pytest.mark.parametrize(("share", "bound"), [(0.7, "omega-low"), (1.5, "omega-high")])
def test_a_wheel_that_turns_too_slowly_or_too_fast_is_flagged(share, bound):
    """The same even wheel, called a step of another length."""
    case = rolled_wheel(turns=1.3)
    fit = fit_in_time(case.time_s, case.path_m, share * PERIOD_S)
    assert fit.bounds == (bound,)
    assert fit.omega_rad_s == pytest.approx(OMEGA_RANGE[bound == "omega-high"] * 2 * np.pi / (share * PERIOD_S))
    assert fit.covariance[5, 5] == 0.0


def test_the_other_branch_of_a_strong_wave_needs_no_negative_radius():
    """Ahead the wave is larger than up, and against it: the best r of the wrong branch changes sign on the way."""
    t = np.arange(60) / 100.0
    w = 2 * np.pi / PERIOD_S
    path = np.column_stack([1.2 * t + 0.03 * np.sin(w * t), 0.9 - 0.004 * np.cos(w * t)])
    fit = fit_in_time(t, path, PERIOD_S, 1)
    assert fit.wheel.r_m > 0
    around = [errors(six(fit) + d, t, path, 1) for d in 1e-4 * np.vstack([np.eye(6)[:5], -np.eye(6)[:5]])]
    assert all(float(e @ e) >= float(np.sum(fit.error_m**2)) for e in around)


def test_a_straight_even_line_is_fitted_by_no_wheel_at_all():
    t = np.arange(60) / 100.0
    fit = fit_in_time(t, np.column_stack([1.2 * t, np.full(60, 0.9)]), PERIOD_S)
    assert fit.wheel.r_m < 1e-12
    assert np.isfinite(fit.covariance).all()
