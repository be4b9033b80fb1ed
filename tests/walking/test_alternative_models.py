"""Comparison of curves: each wins on its own data, and correlated samples give no curve an advantage."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stridelab.walking.alternative_models import (
    EFFECTIVE_HZ,
    NO_ERROR_M2,
    ModelScore,
    StepData,
    compare_path_models,
    compare_time_models,
)
from stridelab.walking.curtate_cycloid import Wheel
from support.recordings.analytic_motions import PERIOD_S, rolled_wheel

T = np.arange(62) / 100.0
W = 2 * np.pi / PERIOD_S
SINGLE = T < 0.42
NOISE = 2e-4 * np.random.default_rng(3).standard_normal((62, 2))


def step(ahead_m: np.ndarray, up_m: np.ndarray) -> StepData:
    return StepData(T, np.column_stack([ahead_m, up_m]) + NOISE, PERIOD_S, ~SINGLE)


def ranked(contests: tuple[ModelScore, ...]) -> list[str]:
    return [c.model for c in sorted(contests, key=lambda c: c.aic)]


def rolled(branch) -> StepData:
    path = Wheel(R_m=0.1, r_m=0.03, z0_m=0.9, x0_m=1.0, branch=branch).position_m(-4.0 + W * T)
    return step(path[:, 0], path[:, 1])


def test_in_space_every_curve_wins_on_its_own_data():
    x = 1.2 * T
    k = W / 1.2
    two = 0.9 + 0.015 * np.cos(k * x + 0.4) + 0.004 * np.cos(2 * k * x + 2.0)
    apex = np.where(SINGLE, 0.25, 0.57)
    arcs = np.where(SINGLE, 0.93 - 0.5 * (x - apex) ** 2, 0.91 + 2.0 * (x - apex) ** 2)
    won = {
        "sinusoid": step(x, 0.9 + 0.015 * np.cos(k * x + 0.4)),
        "two-harmonics": step(x, two),
        "pendulum-arcs": step(x, arcs),
        "wheel": rolled(1),
        "wheel-reversed": rolled(-1),
    }
    assert {name: ranked(compare_path_models(data))[0] for name, data in won.items()} == {name: name for name in won}


def test_in_time_every_curve_wins_on_its_own_data():
    one = (1.2 * T + 0.007 * np.sin(W * T), 0.9 + 0.015 * np.cos(W * T + 0.3))
    two = (one[0] + 0.003 * np.sin(2 * W * T), one[1] + 0.004 * np.cos(2 * W * T))
    won = {
        "one-harmonic": step(*one),
        "two-harmonics": step(*two),
        "wheel": rolled(1),
        "wheel-reversed": rolled(-1),
    }
    assert {name: ranked(compare_time_models(data))[0] for name, data in won.items()} == {name: name for name in won}


def test_aic_counts_independent_samples_and_every_parameter():
    data = rolled(1)
    contests = {c.model: c for c in compare_path_models(data)}
    assert {name: c.parameters for name, c in contests.items()} == {
        "sinusoid": 4,  # mean, two amplitudes, wave number
        "two-harmonics": 6,
        "pendulum-arcs": 6,  # a parabola in single and one in double support
        "wheel": 4,  # x0, R, r, z0
        "wheel-reversed": 4,
    }
    assert data.effective_samples == pytest.approx(EFFECTIVE_HZ * 0.61)
    for c in contests.values():
        assert c.aic == pytest.approx(data.effective_samples * np.log(c.rms_m**2 + NO_ERROR_M2) + 2 * c.parameters)
    t = np.linspace(0.0, 0.61, 123)
    twice = StepData(t, rolled_wheel().wheel.position_m(W * t - 4.0), PERIOD_S, t > 0.42)
    assert twice.effective_samples == data.effective_samples  # sampling faster is no news


def test_three_support_phases_are_three_arcs():
    double = (T < 0.1) | (T > 0.5)
    contests = {c.model: c for c in compare_path_models(StepData(T, rolled(1).path_m, PERIOD_S, double))}
    assert contests["pendulum-arcs"].parameters == 9


def test_the_held_out_error_is_that_of_samples_which_the_fit_did_not_see():
    """One sample far off: it hurts a fit little, and a prediction of it by all of the offset."""
    data = rolled(1)
    bent = data.path_m.copy()
    bent[30, 1] += 0.02
    for c in compare_path_models(StepData(T, bent, PERIOD_S, data.double_support)):
        if c.model.startswith(("wheel", "sinusoid")):
            assert c.rms_m < c.held_out_rms_m
            assert c.held_out_rms_m >= 0.9 * 0.02 / np.sqrt(len(T))


def test_richer_waves_never_fit_worse():
    rng = np.random.default_rng(1)
    smooth = np.cumsum(np.cumsum(rng.standard_normal((62, 2)), axis=0), axis=0) * 1e-5
    data = StepData(T, rolled(-1).path_m + smooth, PERIOD_S, ~SINGLE)
    for contest, few, many in (
        (compare_path_models, "sinusoid", "two-harmonics"),
        (compare_time_models, "one-harmonic", "two-harmonics"),
    ):
        rms = {c.model: c.rms_m for c in contest(data)}
        assert rms[many] <= rms[few]


def test_the_place_in_the_laboratory_and_the_time_of_day_change_nothing():
    data = rolled(1)
    moved = StepData(T + 40.0, data.path_m + np.array([25.0, 0.0]), PERIOD_S, data.double_support)
    for contest in (compare_path_models, compare_time_models):
        here, there = contest(data), contest(moved)
        assert_allclose([c.rms_m for c in there], [c.rms_m for c in here], rtol=1e-6)
        assert_allclose([c.held_out_rms_m for c in there], [c.held_out_rms_m for c in here], rtol=1e-5)
