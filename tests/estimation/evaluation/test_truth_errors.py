"""Errors against a truth that is known in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.estimation.evaluation.truth_errors import error_m, lag_s, truth_error
from stridelab.estimation.markers_only import GeometryOnly
from stridelab.recordings.recording import Window
from support.recordings.analytic_motions import Harmonics, Motion, walk

T = np.arange(600) / 100.0


def estimate_of(motion: Motion, shift_m: np.ndarray, late_s: float = 0.0):  # type: ignore[no-untyped-def]
    given = GeometryOnly().estimate(motion.geometric(T), motion.wrench_track(T, Window(1.0, 5.0)), motion.mass_kg)
    com = motion.com.at(given.time_s - late_s) + shift_m
    return replace(given, com_m=com, sd_m=np.tile([0.01, 0.02, 0.03], (len(com), 1)))


def turned(motion: Motion) -> Motion:
    """The same walk along -y."""
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]).T
    com = motion.com
    waves = tuple((f, turn @ a, phase) for f, a, phase in com.waves)
    return Motion(Harmonics(turn @ com.start, turn @ com.rate, waves), motion.momentum, motion.mass_kg)


def test_horizontal_and_vertical_errors_are_apart() -> None:
    motion = walk()
    error = truth_error(estimate_of(motion, np.array([0.003, -0.004, 0.02])), T, motion.com.at(T))
    assert error.horizontal_m == pytest.approx(0.005)
    assert error.horizontal_95_m == pytest.approx(0.005)
    assert error.vertical_m == pytest.approx(0.02)
    assert error.mean_m == pytest.approx([0.003, -0.004, 0.02], rel=0.01)
    assert error.coverage.tolist() == [1.0, 1.0, 1.0]
    assert truth_error(estimate_of(motion, np.array([0.03, 0.0, 0.0])), T, motion.com.at(T)).coverage[0] == 0.0


def test_the_axes_follow_the_walk() -> None:
    motion = turned(walk())
    error = truth_error(estimate_of(motion, np.array([0.0, -0.006, 0.0])), T, motion.com.at(T))
    assert error.mean_m == pytest.approx([0.006, 0.0, 0.0], abs=1e-4)  # ahead of the truth along -y
    assert error.sd_m == pytest.approx([0.02, 0.01, 0.03], rel=1e-3)


@pytest.mark.parametrize("late_s", [-0.004, 0.011, 0.05])
def test_a_late_estimate_is_late_whatever_its_bias(late_s: float) -> None:
    motion = walk()
    error = truth_error(estimate_of(motion, np.array([0.02, -0.03, 0.01]), late_s), T, motion.com.at(T))
    assert error.lag_s[1:] == pytest.approx([late_s, late_s], abs=3e-4)


def test_uniform_motion_shows_no_lag() -> None:
    line = 1.2 * T
    assert np.isnan(lag_s(line - 0.01, line, 100.0))


def test_the_error_is_taken_at_the_estimates_own_samples() -> None:
    motion = walk()
    estimate = estimate_of(motion, np.array([0.001, 0.002, 0.003]))
    assert error_m(estimate, T, motion.com.at(T)) == pytest.approx(np.tile([0.001, 0.002, 0.003], (401, 1)))
