"""From an estimate and its steps to fits: which samples count, which way is ahead, and the flags."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stridelab.errors import NotEstimable
from stridelab.estimation.estimator import ComEstimate
from stridelab.recordings.recording import Window
from stridelab.walking.curtate_cycloid import Wheel
from stridelab.walking.step_fit import fit_step, fit_steps
from stridelab.walking.steps import GaitStep
from support.recordings.analytic_motions import HUMAN, PERIOD_S

T = np.arange(200) / 100.0
OMEGA = 2 * np.pi / PERIOD_S
AHEAD = np.array([0.6, -0.8, 0.0])


def estimate(wheel: Wheel = HUMAN, seconds: slice = slice(None)) -> ComEstimate:
    """Three turns and a half of a wheel that rolls along ``AHEAD``."""
    path = wheel.position_m(OMEGA * T - 4.0)
    com = np.outer(path[:, 0], AHEAD)
    com[:, 2] = path[:, 1]
    nothing = np.zeros_like(com)
    track = com[seconds], nothing[seconds], nothing[seconds], nothing[seconds]
    t = T[seconds]
    return ComEstimate("given", t, *track, window=Window(float(t[0]), float(t[-1])), references=())


def gait_step(start_s: float, length_m: float | None = 0.6) -> GaitStep:
    return GaitStep(
        side="left",
        lift_off_s=start_s,
        strike_s=start_s + 0.42,
        next_lift_off_s=start_s + PERIOD_S,
        period_s=PERIOD_S,
        length_m=length_m,
        speed_m_s=1.1,
        measured=True,
        source="plates",
    )


def test_a_walk_in_any_direction_gives_its_wheel():
    steps = [gait_step(0.1), gait_step(0.64), gait_step(1.18)]
    fits = fit_steps(estimate(), steps, 3.0 * AHEAD + np.array([0.0, 0.0, 0.7]))
    assert [fit.step for fit in fits] == steps
    for fit in fits:
        assert_allclose([fit.path.wheel.R_m, fit.path.wheel.r_m, fit.path.wheel.z0_m], [0.095, 0.014, 0.93], rtol=1e-6)
        assert fit.omega_rad_s == pytest.approx(OMEGA, rel=1e-6)
        assert fit.theta0_rad == pytest.approx(fit.path.theta_rad[0], abs=1e-6)
        assert fit.theta_off_line_rad < 1e-6
        assert fit.circumference_share == pytest.approx(2 * np.pi * 0.095 / 0.6, rel=1e-6)
        assert fit.flags == ()
        assert fit.reversed_path.distance_m.mean() > 1e-4


def test_only_samples_of_the_step_count():
    (fit,) = fit_steps(estimate(), [gait_step(0.1004)], AHEAD)
    assert fit.time_s[0] == 0.11
    assert fit.time_s[-1] == 0.64
    (exact,) = fit_steps(estimate(), [gait_step(0.1 + 1.5e-8)], AHEAD)  # as single floats in files have it
    assert exact.time_s[0] == 0.1


def test_steps_beyond_the_estimate_are_left_out_and_without_any_it_is_an_error():
    part = estimate(seconds=slice(20, 110))
    steps = [gait_step(0.1), gait_step(0.3), gait_step(0.9)]
    assert [fit.step.start_s for fit in fit_steps(part, steps, AHEAD)] == [0.3]
    for none in ([], steps[::2]):
        with pytest.raises(NotEstimable) as caught:
            fit_steps(part, none, AHEAD)
        assert caught.value.code == "no-whole-step"


def test_a_walk_backwards_is_flagged():
    (fit,) = fit_steps(estimate(), [gait_step(0.1)], -AHEAD)
    assert fit.path.wheel.R_m < 0
    assert "backwards" in fit.flags


@pytest.mark.parametrize(
    ("wheel", "flag"),
    [
        (replace(HUMAN, r_m=0.12, R_m=0.2), "r-too-large"),
        (replace(HUMAN, r_m=0.0004), "r-too-small"),
        (replace(HUMAN, r_m=0.0955), "not-curtate"),
    ],
)
def test_wheels_that_no_walker_has_are_flagged(wheel, flag):
    (fit,) = fit_steps(estimate(wheel), [gait_step(0.1)], AHEAD)
    assert flag in fit.flags


def test_a_part_of_a_step_and_a_path_that_is_no_wheel_are_flagged():
    t = T[:30]
    part = fit_step(gait_step(0.0), t, HUMAN.position_m(OMEGA * t - 3.0))
    assert "part-of-a-turn" in part.flags
    t = T[:55]
    bumps = HUMAN.position_m(OMEGA * t - 4.0) + np.column_stack([0 * t, 0.012 * np.sin(4 * OMEGA * t)])
    assert "far-from-the-wheel" in fit_step(gait_step(0.0), t, bumps).flags
    straight = fit_step(gait_step(0.0), t, np.column_stack([1.2 * t, 0.9 + 0.2 * t]))
    assert "path-not-converged" in straight.flags
    assert "part-of-a-turn" in straight.flags


def test_a_clock_on_its_bound_is_flagged():
    t = T[:55]
    path = replace(HUMAN, branch=-1).position_m(OMEGA * t - 4.0)
    fit = fit_step(gait_step(0.0), t, path)
    assert fit.timed.bounds == ("omega-low",)
    assert "timed-omega-low" in fit.flags
    assert fit.reversed_timed.bounds == ()
    assert fit.reversed_timed.distance_m.max() < 1e-8


def test_the_thesis_rule_is_beside_the_measured_timing():
    (fit,) = fit_steps(estimate(), [gait_step(0.1)], AHEAD)
    start, end = fit.double_support_model_s
    assert start == pytest.approx((4.0 - np.pi / 2) / OMEGA, abs=1e-5)
    assert end == pytest.approx((4.0 + np.pi / 2) / OMEGA, abs=1e-5)
    assert fit.step.double_support_s == (pytest.approx(0.52), pytest.approx(0.64))


@pytest.mark.parametrize("length_m", [None, 0.0])
def test_without_a_step_length_nothing_is_divided(length_m):
    (fit,) = fit_steps(estimate(), [gait_step(0.1, length_m)], AHEAD)
    assert fit.circumference_share is None
