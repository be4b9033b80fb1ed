"""Intervals between strikes, and the scatter of the wheels of one recording, on wheels that are known."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.estimation.estimator import ComEstimate
from stridelab.recordings.recording import Window
from stridelab.walking.step_fit import StepFit, fit_steps
from stridelab.walking.step_variability import step_scatter, strike_to_strike
from stridelab.walking.steps import GaitStep
from support.recordings.analytic_motions import HUMAN, PERIOD_S

AHEAD = np.array([0.0, 1.0, 0.0])
OMEGA = 2 * np.pi / PERIOD_S
WHOLE = Window(0.0, 2.0)


def estimate() -> ComEstimate:
    t = np.arange(201) / 100.0
    path = HUMAN.position_m(OMEGA * t - 3.0)
    com = np.column_stack([np.zeros_like(t), path])
    return ComEstimate("known", t, com, 0 * com, 0 * com, 0 * com + 0.01, WHOLE, ())


def step(start_s: float, prior_strike_s: float | None) -> GaitStep:
    strike_s = start_s + 0.8 * PERIOD_S
    return GaitStep(
        side="left",
        lift_off_s=start_s,
        strike_s=strike_s,
        next_lift_off_s=start_s + PERIOD_S,
        period_s=PERIOD_S,
        length_m=0.6,
        speed_m_s=1.1,
        measured=True,
        source="plates",
        prior_strike_s=prior_strike_s,
    )


STEPS = [step(0.2, None), step(0.2 + PERIOD_S, 0.2 + 0.8 * PERIOD_S)]


def test_the_wheel_between_two_strikes_is_the_wheel() -> None:
    (overlap,) = strike_to_strike(estimate(), STEPS, (WHOLE,), AHEAD)
    assert overlap.start_s == pytest.approx(0.2 + 0.8 * PERIOD_S)
    assert overlap.end_s == pytest.approx(overlap.start_s + PERIOD_S)
    assert overlap.wheel.R_m == pytest.approx(HUMAN.R_m, rel=1e-6)
    assert overlap.wheel.r_m == pytest.approx(HUMAN.r_m, rel=1e-6)
    assert overlap.wheel.z0_m == pytest.approx(HUMAN.z0_m, rel=1e-9)
    assert overlap.omega_rad_s == pytest.approx(OMEGA, rel=1e-6)
    assert overlap.error_mean_m < 1e-9


def test_an_interval_without_force_is_left_out() -> None:
    assert strike_to_strike(estimate(), STEPS, (Window(0.0, 0.9),), AHEAD) == ()
    assert len(strike_to_strike(estimate(), STEPS, (Window(0.65, 1.25),), AHEAD)) == 1
    assert strike_to_strike(estimate(), STEPS[:1], (WHOLE,), AHEAD) == ()


def with_wheel(fit: StepFit, **changed: float) -> StepFit:
    return replace(fit, path=replace(fit.path, wheel=replace(fit.path.wheel, **changed)))


def test_scatter_is_the_deviation_between_steps() -> None:
    first, second = fit_steps(estimate(), STEPS, AHEAD)
    scatter = step_scatter([with_wheel(first, R_m=0.09), with_wheel(second, R_m=0.10)], ())
    assert scatter is not None
    assert scatter.R_m == pytest.approx(0.01 / np.sqrt(2))
    assert scatter.r_m == pytest.approx(0.0, abs=1e-9)
    assert (scatter.n, scatter.between) == (2, "steps")


def test_one_step_is_held_against_what_overlaps_with_it() -> None:
    (first,) = fit_steps(estimate(), STEPS[:1], AHEAD)
    overlaps = strike_to_strike(estimate(), STEPS, (WHOLE,), AHEAD)
    scatter = step_scatter([with_wheel(first, R_m=HUMAN.R_m + 0.01)], overlaps)
    assert scatter is not None
    assert scatter.R_m == pytest.approx(0.01 / np.sqrt(2), rel=1e-4)
    assert scatter.between == "overlapping-steps"
    assert step_scatter([first], ()) is None
