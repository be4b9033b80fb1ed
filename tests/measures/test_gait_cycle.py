"""Curves over the gait cycle: of a motion in closed form, and their means by hand."""

import numpy as np
import pytest

from stridelab.conventions import GRAVITY_M_S2
from stridelab.measures.gait_cycle import CURVE_NAMES, N_SAMPLES, cycle_curves, mean_curve
from stridelab.measures.walk_motion import FootMotion, WalkMotion
from stridelab.walking.steps import GaitStep

HEIGHT_M, SPEED_M_S, PERIOD_S = 0.9, 1.2, 1.0


def step(side: str, lift_off_s: float, strike_s: float) -> GaitStep:
    return GaitStep(
        side=side, lift_off_s=lift_off_s, strike_s=strike_s, next_lift_off_s=strike_s + 0.1, period_s=0.5,
        length_m=0.6, speed_m_s=SPEED_M_S, measured=True, source="plates", stance_end_s=lift_off_s + PERIOD_S,
    )  # type: ignore[arg-type]  # fmt: skip


STEPS = (step("right", 0.1, 0.5), step("left", 0.6, 1.0), step("right", 1.1, 1.5), step("left", 1.6, 2.0))


def walk(hidden: slice = slice(0, 0)) -> WalkMotion:
    """Height and sway are sines; each foot's outermost point stands 0.1 m beside the line, at x = 0."""
    time_s = np.arange(0.0, 2.5, 0.01)
    up, sway = 0.02 * np.sin(4 * np.pi * time_s / PERIOD_S), 0.03 * np.sin(2 * np.pi * time_s / PERIOD_S)
    speed_left = 0.03 * 2 * np.pi / PERIOD_S * np.cos(2 * np.pi * time_s / PERIOD_S)
    com = np.column_stack([SPEED_M_S * time_s, sway, HEIGHT_M + up])
    velocity = np.column_stack([np.full_like(time_s, SPEED_M_S), speed_left, np.zeros_like(time_s)])
    feet = {}
    for side, y in (("left", 0.1), ("right", -0.1)):
        outline = np.zeros((len(time_s), 5, 3))
        outline[:, :, 1] = y
        outline[hidden] = np.nan
        feet[side] = FootMotion(outline[:, 0], outline, np.full((len(time_s), 3), np.nan))
    return WalkMotion(
        time_s=time_s, com_m=com, velocity_m_s=velocity, covariance=None, varying_sd_m=0.0, feet=feet,
        momentum_per_kg=np.full_like(com, np.nan), mass_kg=None, stature_m=None,
    )  # type: ignore[arg-type]  # fmt: skip


def test_every_stride_has_four_curves_of_its_side() -> None:
    curves = cycle_curves(walk(), STEPS)
    assert [(curve.name, curve.side) for curve in curves] == [
        (name, side) for side in ("right", "left") for name in CURVE_NAMES
    ]
    assert all(curve.value_m.shape == (N_SAMPLES,) for curve in curves)


def test_positions_of_the_com_are_relative_to_their_mean_and_towards_the_foot() -> None:
    by_name = {(curve.name, curve.side): curve.value_m for curve in cycle_curves(walk(), STEPS)}
    percent = np.linspace(0.0, 1.0, N_SAMPLES)
    height = 0.02 * np.sin(4 * np.pi * (0.5 + percent))
    np.testing.assert_allclose(by_name["com_vertical", "right"], height - height.mean(), atol=1e-6)
    sway = 0.03 * np.sin(2 * np.pi * (0.5 + percent))
    np.testing.assert_allclose(by_name["com_lateral", "right"], -sway + sway.mean(), atol=1e-6)
    np.testing.assert_allclose(by_name["com_lateral", "left"], by_name["com_lateral", "right"], atol=1e-6)


def test_margins_are_those_of_the_extrapolated_com_in_the_stance_alone() -> None:
    motion = walk()
    margin = next(c for c in cycle_curves(motion, STEPS) if (c.name, c.side) == ("margin_of_stability_ml", "left"))
    rate = np.sqrt(GRAVITY_M_S2 / motion.mean_height_m)
    expected = 0.1 - 0.03 * 2 * np.pi / PERIOD_S / rate  # at the strike at 1 s the sway is zero and its speed largest
    assert margin.value_m[0] == pytest.approx(expected, abs=1e-6)
    assert np.isfinite(margin.value_m[:61]).all(), "the left foot leaves at 60 % of its cycle"
    assert np.isnan(margin.value_m[61:]).all()


def test_a_hidden_foot_gives_no_margin_and_never_a_zero() -> None:
    curves = cycle_curves(walk(hidden=slice(None)), STEPS)
    assert {curve.name for curve in curves} == {"com_vertical", "com_lateral"}


def test_strides_outside_the_estimate_have_no_curves() -> None:
    assert cycle_curves(walk(), [step("left", 1.6, 2.0), step("left", 2.6, 3.0)]) == []


def test_mean_and_deviation_are_those_of_the_given_values() -> None:
    first, second, third = np.full(N_SAMPLES, 0.01), np.full(N_SAMPLES, 0.03), np.full(N_SAMPLES, 0.02)
    first[80:], second[80:], third[90:] = np.nan, np.nan, np.nan
    mean = mean_curve([first, second, third])
    assert mean is not None
    assert mean.sd_m is not None
    assert mean.n == 3
    np.testing.assert_allclose(mean.mean_m[:80], 0.02)
    np.testing.assert_allclose(mean.sd_m[:80], 0.01)
    assert np.isnan(mean.mean_m[80:]).all(), "one of three curves is less than half of them"
    assert np.isnan(mean.sd_m[80:]).all()


def test_one_curve_has_no_deviation_and_none_has_no_mean() -> None:
    one = mean_curve([np.zeros(N_SAMPLES)])
    assert one is not None
    assert one.sd_m is None
    assert mean_curve([]) is None
