"""Person and robot in one table: a walk beside itself, scaled."""

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest

from stridelab.measures.walk_motion import FootMotion, WalkMotion
from stridelab.pipelines.imitation.comparison import CURVE_POINTS, Walker, compare_walks, compared_curves
from support.recordings.flat_footed import FlatFootedWalk

S = 0.64


def swaying(truth: FlatFootedWalk) -> WalkMotion:
    """The CoM rises and falls twice and sways once per stride."""
    motion = truth.motion
    phase = 2.0 * np.pi * motion.time_s / (truth.swing_s + truth.both_s)
    motion.com_m[:, 1] += 0.02 * np.sin(0.5 * phase)
    motion.com_m[:, 2] -= 0.015 * np.cos(phase)
    return replace(motion, velocity_m_s=np.gradient(motion.com_m, motion.time_s, axis=0))


def scaled(truth: FlatFootedWalk) -> tuple[FlatFootedWalk, WalkMotion]:
    """The same walk of a body ``S`` times as tall at the same Froude number."""
    times = {"swing_s": sqrt(S) * truth.swing_s, "both_s": sqrt(S) * truth.both_s}
    lengths = {"length_m": S * truth.length_m, "width_m": S * truth.width_m, "height_m": S * truth.height_m}
    small, motion = replace(truth, **times, **lengths), swaying(truth)
    feet = {side: FootMotion(S * foot.heel_m, S * foot.outline_m, foot.force_n) for side, foot in motion.feet.items()}
    moved = replace(
        motion,
        time_s=sqrt(S) * motion.time_s,
        com_m=S * motion.com_m,
        velocity_m_s=sqrt(S) * motion.velocity_m_s,
        feet=feet,
    )
    return small, moved


def test_a_robot_that_walks_as_the_person_has_the_scaled_values() -> None:
    truth = FlatFootedWalk(steps=7)
    small, moved = scaled(truth)
    person, robot = Walker.of_motion(swaying(truth), truth.gait_steps), Walker.of_motion(moved, small.gait_steps)
    rows = {row.name: row for row in compare_walks(person, robot, S)}
    for name in (
        "walking_speed",
        "step_length",
        "step_width",
        "com_vertical_excursion",
        "wheel_R",
        "wheel_r",
        "com_height",
    ):
        assert rows[name].robot == pytest.approx(rows[name].scaled, rel=0.02), name
    assert rows["wheel_omega"].robot == pytest.approx(rows["wheel_omega"].scaled, rel=0.05)
    assert rows["walking_speed"].scaled == pytest.approx(sqrt(S) * 1.2, rel=1e-6)
    assert rows["step_length"].person == pytest.approx(truth.length_m)
    assert rows["com_vertical_excursion"].person == pytest.approx(0.03, rel=0.02)
    margin = rows["margin_of_stability_ml_min"]
    assert margin.robot == pytest.approx(margin.scaled, rel=0.05)
    assert rows["step_length"].n_person == len(truth.gait_steps)
    curves = compared_curves(person, robot, S)
    assert len(curves["step_share"]) == CURVE_POINTS
    for column in ("com_height_m", "com_sideways_m", "com_speed_m_s", "margin_m"):
        own, other = curves[f"person_{column}"], curves[f"robot_{column}"]
        assert np.isfinite(own[: CURVE_POINTS // 2]).all()
        np.testing.assert_allclose(other, own, atol=0.004)
    assert np.isnan(curves["person_margin_m"][-1])  # both feet stand


def test_a_flat_path_has_no_wheel() -> None:
    truth = FlatFootedWalk()
    rows = compare_walks(*(Walker.of_motion(truth.motion, truth.gait_steps),) * 2, 1.0)
    assert {row.name: row.n_robot for row in rows}["wheel_r"] in (0, len(truth.gait_steps))
    wheel = next(row for row in rows if row.name == "wheel_r")
    assert wheel.robot is None or wheel.robot < 0.002
