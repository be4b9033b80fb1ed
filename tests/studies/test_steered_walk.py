"""Figures of a steered walk: velocities in the axes of the robot, and how well commands are followed."""

import numpy as np
import pytest

from steered_walk import random_commands, tracking_lines, velocity_between


@pytest.mark.parametrize("turn_rad_s", [0.0, 0.5, -0.5])
def test_a_circle_has_the_velocity_of_its_command(turn_rad_s: float) -> None:
    """Of an exact walk at 0.4 m/s ahead and 0.2 to the left, across the jump of the heading at pi."""
    time_s = np.linspace(0.0, 0.1, 10001)
    heading = 3.13 + turn_rad_s * time_s
    velocity = np.stack([0.4 * np.cos(heading) - 0.2 * np.sin(heading), 0.4 * np.sin(heading) + 0.2 * np.cos(heading)])
    way_m = np.trapezoid(velocity, time_s, axis=1)
    end = np.append(way_m, np.angle(np.exp(1j * heading[-1])))
    found = velocity_between(np.array([0.0, 0.0, 3.13]), end, 0.1)
    assert found == pytest.approx([0.4, 0.2, turn_rad_s], abs=1e-4)


def test_shares_count_only_what_was_asked() -> None:
    wanted = np.array([[0.4, 0.0, 0.0], [0.2, -0.2, 0.0], [0.0, 0.0, 0.5]])
    done = np.array([[0.3, 0.1, 0.0], [0.15, -0.1, 0.1], [0.0, 0.0, 0.5]])
    assert list(tracking_lines(wanted, done)) == [
        "ahead: 75% of what 2 commands ask; mean error of all 0.050 m/s",
        "left: 50% of what 1 commands ask; mean error of all 0.067 m/s",
        "turning: 100% of what 1 commands ask; mean error of all 0.033 rad/s",
    ]


def test_commands_stay_within_the_limits_and_differ() -> None:
    commands = random_commands(np.random.default_rng(3))
    drawn = [next(commands) for _ in range(200)]
    ahead, left, turn = np.array([(c.ahead_m_s, c.left_m_s, c.turn_rad_s) for c, _ in drawn]).T
    assert ahead.min() >= 0.0
    assert 0.3 < ahead.max() <= 0.4
    assert 0.15 < np.abs(left).max() <= 0.2
    assert 0.4 < np.abs(turn).max() <= 0.5
    assert all(3.0 <= hold_s <= 8.0 for _, hold_s in drawn)
