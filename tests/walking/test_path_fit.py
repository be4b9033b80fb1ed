"""The fit (3.3): exact curves, noise with known statistics, and a general solver as oracle."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from numpy.testing import assert_allclose
from scipy.optimize import least_squares
from scipy.stats import t as student

from stridelab.walking.curtate_cycloid import Wheel
from stridelab.walking.path_fit import PathFit, fit_path
from support.recordings.analytic_motions import HUMAN, PERIOD_S, central_differences, parameters, rolled_wheel, walks

NOISE_M = 0.001
FITS = 500


@settings(max_examples=80, deadline=None)
@given(walks(uneven=True))
def test_an_exact_curve_comes_back_wherever_and_however_it_was_walked(case):
    fit = fit_path(case.time_s, case.path_m, case.period_s, case.wheel.branch)
    assert fit.converged
    shape = [1, 2, 3]
    assert_allclose(parameters(fit.wheel)[shape], parameters(case.wheel)[shape], rtol=1e-6)
    assert fit.distance_m.max() < 1e-9
    turns = (fit.theta_rad - case.theta_rad) / (2 * np.pi)
    assert_allclose(turns, round(turns[0]), atol=1e-6)
    assert_allclose(fit.wheel.hub_m(fit.theta_rad), case.wheel.hub_m(case.theta_rad), atol=1e-7)
    assert abs(fit.theta_rad.mean()) <= np.pi + 1e-9


def dense(case_path: np.ndarray, start: PathFit, branch: int):
    """(3.3) as a general problem of 4 + N unknowns."""
    n = len(case_path)

    def residual(u: np.ndarray) -> np.ndarray:
        x0, R, r, z0 = u[:4]
        return np.concatenate(
            [
                x0 + R * u[4:] - branch * r * np.sin(u[4:]) - case_path[:, 0],
                z0 - r * np.cos(u[4:]) - case_path[:, 1],
            ]
        )

    w = start.wheel
    guess = np.concatenate([[w.x0_m, w.R_m * 1.05, w.r_m * 0.9, w.z0_m + 0.002], start.theta_rad + 0.05])
    solution = least_squares(residual, guess, xtol=1e-14, ftol=1e-14, gtol=1e-14, x_scale="jac")
    assert len(solution.fun) == 2 * n
    return residual, solution


@pytest.mark.parametrize("branch", [1, -1])
@pytest.mark.parametrize("disturbed_m", [0.0005, 0.003])
def test_a_general_solver_finds_the_same_wheel_and_covariance(branch, disturbed_m):
    case = rolled_wheel(replace(HUMAN, branch=branch), unevenness=0.1)
    s = np.linspace(0.0, 1.0, len(case.time_s))
    path = case.path_m + disturbed_m * np.column_stack([np.sin(9 * s), np.cos(14 * s)])
    fit = fit_path(case.time_s, path, case.period_s, branch)
    residual, solution = dense(path, fit, branch)
    assert_allclose(parameters(fit.wheel), solution.x[:4], rtol=2e-6)
    assert_allclose(fit.theta_rad, solution.x[4:], atol=2e-5)
    assert np.sum(fit.error_m**2) <= 2 * solution.cost * (1 + 1e-9)
    J = central_differences(residual, np.concatenate([parameters(fit.wheel), fit.theta_rad]))
    noise = np.sum(fit.error_m**2) / (len(path) - 4)
    assert_allclose(fit.covariance_m2, noise * np.linalg.inv(J.T @ J)[:4, :4], rtol=1e-4, atol=1e-12)
    assert_allclose(J.T @ np.concatenate([fit.error_m[:, 0], fit.error_m[:, 1]]), 0.0, atol=1e-6)  # it is a minimum


@pytest.fixture(scope="module", params=[1, -1])
def noisy(request) -> tuple[Wheel, list[PathFit]]:
    """Five hundred steps with 1 mm of white noise ahead and up."""
    rng = np.random.default_rng(5)
    case = rolled_wheel(replace(HUMAN, branch=request.param), unevenness=0.1)
    clean = case.path_m
    return case.wheel, [
        fit_path(case.time_s, clean + NOISE_M * rng.standard_normal(clean.shape), PERIOD_S, request.param)
        for _ in range(FITS)
    ]


def test_with_a_millimetre_of_noise_the_wheel_is_within_three_deviations(noisy):
    wheel, fits = noisy
    truth = parameters(wheel)[1:]
    off = np.array([(parameters(fit.wheel)[1:] - truth) / fit.sd_m[1:] for fit in fits])
    assert all(fit.converged for fit in fits)
    assert ((np.abs(off) < 3).mean(axis=0) >= 0.99).all()
    assert (np.abs(off.mean(axis=0)) < 0.2).all()  # and no bias to speak of


def test_the_95_percent_intervals_cover_95_percent(noisy):
    wheel, fits = noisy
    truth = parameters(wheel)[1:]
    wide = student.ppf(0.975, len(fits[0].theta_rad) - 4)
    inside = np.array([np.abs(parameters(fit.wheel)[1:] - truth) < wide * fit.sd_m[1:] for fit in fits])
    assert ((inside.mean(axis=0) >= 0.93) & (inside.mean(axis=0) <= 0.97)).all()


def test_where_the_hub_is_has_its_own_deviation_whatever_theta_is_called(noisy):
    """x0 of theta = 0 in mid-step: naming the turn otherwise changes x0, and its covariance with R."""
    wheel, fits = noisy
    turns = [round((wheel.x0_m - fit.wheel.x0_m) / (2 * np.pi * wheel.R_m)) for fit in fits]
    assert len(set(turns)) == 1
    truth = wheel.x0_m - 2 * np.pi * turns[0] * wheel.R_m
    off = np.array([(fit.wheel.x0_m - truth) / fit.sd_m[0] for fit in fits])
    assert 0.93 <= (np.abs(off) < 1.96).mean() <= 0.97
    assert np.std(off) == pytest.approx(1.0, abs=0.1)


def test_moving_and_mirroring_the_laboratory_moves_the_wheel_and_nothing_else():
    case = rolled_wheel(unevenness=0.1)
    rng = np.random.default_rng(0)
    path = case.path_m + NOISE_M * rng.standard_normal(case.path_m.shape)
    at_home = fit_path(case.time_s, path, case.period_s)
    away = fit_path(case.time_s + 50.0, path + np.array([-17.0, 0.25]), case.period_s)
    assert_allclose(parameters(away.wheel), parameters(at_home.wheel) + np.array([-17.0, 0, 0, 0.25]), rtol=1e-7)
    assert_allclose(away.covariance_m2, at_home.covariance_m2, rtol=1e-5)
    backwards = fit_path(case.time_s, path * [-1.0, 1.0], case.period_s, branch=-1)
    assert_allclose(parameters(backwards.wheel), parameters(at_home.wheel) * [-1, -1, 1, 1], rtol=1e-7)


def test_the_step_period_serves_the_first_guess_alone():
    case = rolled_wheel(unevenness=0.15)
    path = case.path_m + 0.001 * np.column_stack([np.sin(8 * case.theta_rad), np.cos(5 * case.theta_rad)])
    fits = [fit_path(case.time_s, path, share * case.period_s) for share in (0.8, 0.9, 1.0, 1.1, 1.25)]
    shapes = np.array([parameters(fit.wheel) for fit in fits])
    assert_allclose(shapes, np.broadcast_to(shapes[2], shapes.shape), rtol=1e-6)


def test_a_long_piece_of_a_straight_ramp_is_not_called_arrived():
    """A straight line is a wheel of kilometres: the sum of squares goes down for ever."""
    t = np.arange(55) / 100.0
    fit = fit_path(t, np.column_stack([1.2 * t, 0.9 + 0.2 * t]), 0.55)
    assert not fit.converged
