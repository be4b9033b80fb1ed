"""Footholds and times of a recorded walk, against walks whose footholds are known."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.errors import NotEstimable
from stridelab.pipelines.imitation.recorded_walk import walk_of_motion
from stridelab.walking.gait_events import Contact
from support.recordings.flat_footed import FlatFootedWalk, during

HIPS_M = 0.85


def test_footholds_are_the_middles_of_the_feet() -> None:
    truth = FlatFootedWalk()
    walk = walk_of_motion(truth.motion, truth.contacts, truth.gait_steps, HIPS_M)
    assert [hold.side for hold in walk.footholds] == [truth.side(k) for k in range(6)]
    for k, hold in enumerate(walk.footholds):
        assert hold.position_m == pytest.approx(truth.place_m(k), abs=1e-3)
        assert hold.yaw_rad == pytest.approx(truth.yaw_rad(k), abs=1e-9)
    assert walk.step_lengths_m == pytest.approx(np.full(5, truth.length_m), abs=1e-3)
    assert walk.step_widths_m == pytest.approx(np.full(5, truth.width_m), abs=1e-3)
    assert walk.froude_number == pytest.approx((0.6 / 0.5) ** 2 / (9.81 * HIPS_M), rel=1e-3)


def test_swings_that_are_not_recorded_last_as_long_as_the_mean_of_the_others() -> None:
    truth = FlatFootedWalk()
    steps = truth.gait_steps
    walk = walk_of_motion(truth.motion, truth.contacts, steps, HIPS_M)
    assert walk.swing_s == pytest.approx(np.full(6, truth.swing_s))
    assert walk.double_support_s == pytest.approx(np.full(6, truth.both_s))
    uneven = [replace(steps[0], lift_off_s=steps[0].lift_off_s - 0.08), *steps[1:]]
    walk = walk_of_motion(truth.motion, truth.contacts, uneven, HIPS_M)
    assert walk.swing_s[2] == pytest.approx(truth.swing_s + 0.08)
    assert walk.swing_s[:2] == pytest.approx(np.full(2, truth.swing_s + 0.08 / len(uneven)))


def test_a_foot_that_is_only_seen_on_its_ball_has_the_same_middle() -> None:
    """The recording begins 90 ms before the lift-off, while the heel rises about the ball."""
    truth = FlatFootedWalk()
    off_s = truth.contacts[0].end_s
    motion = during(truth.motion, off_s - 0.09, truth.strike_s(5) + 0.1)
    early = motion.time_s <= off_s
    outline = motion.feet["left"].outline_m
    outline[early, :2, 0] += 1.0 * (motion.time_s[early, None] - motion.time_s[0])
    walk = walk_of_motion(motion, truth.contacts, truth.gait_steps, HIPS_M)
    assert len(walk.footholds) == truth.steps + 1
    assert walk.footholds[0].position_m == pytest.approx(truth.place_m(0), abs=0.005)


def test_a_foot_that_is_only_seen_striking_has_the_same_middle() -> None:
    """The recording ends 30 ms after the strike, while the forefoot still moves down."""
    truth = FlatFootedWalk()
    last_s, side = truth.strike_s(truth.steps), truth.side(truth.steps)
    motion = during(truth.motion, 0.0, last_s + 0.03)
    late = motion.time_s >= last_s - 0.05
    outline = motion.feet[side].outline_m
    outline[late, 2:, 0] += 1.0 * (motion.time_s[late, None] - motion.time_s[-1])
    walk = walk_of_motion(motion, truth.contacts, truth.gait_steps, HIPS_M)
    assert len(walk.footholds) == truth.steps + 1
    assert walk.footholds[-1].position_m == pytest.approx(truth.place_m(truth.steps), abs=0.003)


def test_a_hidden_foothold_interrupts_the_run() -> None:
    truth = FlatFootedWalk(steps=6)
    motion = truth.motion
    hidden = (motion.time_s >= truth.strike_s(2) - 0.02) & (motion.time_s <= truth.contacts[2].end_s + 0.02)
    side = truth.side(2)
    outline = motion.feet[side].outline_m.copy()
    outline[hidden] = np.nan
    feet = {**motion.feet, side: replace(motion.feet[side], outline_m=outline)}
    walk = walk_of_motion(replace(motion, feet=feet), truth.contacts, truth.gait_steps, HIPS_M)
    assert [hold.position_m[0] for hold in walk.footholds] == pytest.approx([truth.place_m(k)[0] for k in range(3, 7)])


def test_the_middle_of_a_long_walk_is_taken() -> None:
    truth = FlatFootedWalk(steps=19)
    walk = walk_of_motion(truth.motion, truth.contacts, truth.gait_steps, HIPS_M)
    assert [hold.position_m[0] for hold in walk.footholds] == pytest.approx([truth.place_m(k)[0] for k in range(4, 16)])
    assert len(walk.swing_s) == 12


def test_two_footholds_are_too_few() -> None:
    truth = FlatFootedWalk(steps=3)
    two: tuple[Contact, ...] = truth.contacts[:2]
    with pytest.raises(NotEstimable) as caught:
        walk_of_motion(truth.motion, two, truth.gait_steps, HIPS_M)
    assert caught.value.code == "too-few-footholds"
