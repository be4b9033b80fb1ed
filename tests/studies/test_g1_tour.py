"""The tour of the public benchmark: its random streams, course, punches, arms and commands."""

import numpy as np
import pytest

from experiments import tour
from g1_tour import TourRun, summary_lines
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot


@pytest.fixture(scope="module")
def g1() -> Robot:
    return load_robot("g1")


@pytest.mark.parametrize(
    ("run_id", "purpose", "words"),
    [
        (0, 2, (3825457058, 706492411, 2134599173)),
        (7, 3, (351790320, 3488955865, 1077926635)),
        (100000, 4, (748588199, 1708138787, 2127230201)),
    ],
)
def test_streams_are_those_of_the_standard_library(run_id: int, purpose: int, words: tuple[int, ...]) -> None:
    """Words of ``std::mt19937`` seeded with ``std::seed_seq{run_id, purpose}``, as libstdc++ 12 generates them."""
    unit = tour.Stream(run_id, purpose).between(0.0, 1.0, 3)
    assert unit == pytest.approx([(word >> 8) / 2**24 for word in words], abs=0.0)
    assert tour.Stream(run_id, purpose).below(29) == words[0] // (2**32 // 29)


def test_waypoints_fill_the_disc() -> None:
    drawn = np.array([waypoint for run_id in range(60) for waypoint in tour.draw_waypoints(run_id)])
    assert len(drawn) == 60 * 18
    radius_m = np.hypot(drawn[:, 0] - 0.3, drawn[:, 1])
    assert radius_m.max() <= 0.75
    assert np.mean(radius_m < 0.75 / np.sqrt(2.0)) == pytest.approx(0.5, abs=0.05), "evenly by area"
    assert np.abs(drawn[:, 2]).max() <= np.pi
    assert np.mean(drawn[:, 2]) == pytest.approx(0.0, abs=0.2)


def test_punches_become_harder_for_a_minute(g1: Robot) -> None:
    runs = [tour.draw_punches(run_id, g1) for run_id in range(40)]
    sizes_n = np.array([[np.linalg.norm(push.impulse_ns) / 0.08 for push in run] for run in runs])
    ceiling_n = 500.0 * (1.0 / 3.0 + 2.0 / 3.0 * np.minimum(np.arange(18) * 5.0 / 60.0, 1.0))
    assert np.all(sizes_n <= ceiling_n * (1.0 + 1e-9))
    assert np.all(sizes_n >= 0.5 * ceiling_n * (1.0 - 1e-9))
    assert sizes_n[:, 12:].max() > 480.0
    assert [push.time_s for push in runs[0]] == pytest.approx(0.1 + 5.0 * np.arange(18))
    links = {push.link for run in runs for push in run}
    assert len(links) == 29, "every joint is hit"
    assert {"left_knee_link", "torso_link", "right_wrist_yaw_link"} < links
    directions = np.array([push.impulse_ns for run in runs for push in run]) / (0.08 * sizes_n.ravel()[:, None])
    assert np.abs(directions.mean(axis=0)).max() < 0.07


def test_arms_wander_in_front_of_the_body_below_the_head(g1: Robot) -> None:
    walk, before, stayed = tour.ArmWalk(3, g1), None, 0
    for k in range(1, 750):
        walk.advance(k * tour.PERIOD_S)
        left, right = walk.servo.target_rad[:7], walk.servo.target_rad[7:]
        assert right == pytest.approx(tour.MIRROR * left)
        if before is not None:
            assert np.abs(left - before).max() <= 0.06 + 1e-12, "the rate of 25 changes in half a second"
        before = left
        if k % 25 == 24:
            hands_m = np.vstack(walk._hands_m(left))
            assert hands_m[:, 0].min() >= walk._front_m - 1e-9
            assert hands_m[:, 2].max() <= walk._head_m + 1e-9
            stayed += walk._to_rad is walk._from_rad
    assert stayed < 15
    low, high = g1.model.lowerPositionLimit[7:][walk.servo.at], g1.model.upperPositionLimit[7:][walk.servo.at]
    assert np.all((walk.servo.target_rad >= low) & (walk.servo.target_rad <= high))
    assert np.abs(left - tour.ARM_START_RAD).max() > 0.2


def test_commands_lead_to_the_waypoint_in_the_axes_of_the_robot() -> None:
    """Released at (1, 2) facing along y: a waypoint ahead and to the left is at smaller x and larger y."""
    waypoints = [tour.Waypoint(0.5, 0.1, 0.0), tour.Waypoint(0.0, 0.0, np.pi)]
    steering = tour.TourSteering(waypoints, np.array([1.0, 2.0, np.pi / 2.0]), (0.4, 0.2, 0.5))
    assert steering.command(0.0, np.array([1.0, 2.0, np.pi / 2.0])) == pytest.approx((0.4, 0.15, 0.0))
    assert steering.off_m == pytest.approx(np.hypot(0.5, 0.1))
    assert steering.command(0.1, np.array([1.0, 2.0, 0.0])) == pytest.approx((-0.15, 0.2, 0.5))
    assert steering.command(0.2, np.array([0.9, 2.45, np.pi / 2.0])) == (0.0, 0.0, 0.0)
    assert steering.command(0.3, np.array([0.9, 2.35, np.pi / 2.0])) == (0.0, 0.0, 0.0), "reached until 0.2 m away"
    assert steering.command(0.4, np.array([0.9, 2.25, np.pi / 2.0]))[0] == pytest.approx(0.375)
    turn = steering.command(5.0, np.array([1.0, 2.0, np.pi / 2.0]))
    assert turn[:2] == (0.0, 0.0)
    assert abs(turn[2]) == 0.5


def test_the_summary_counts_runs_and_weights_errors_by_waypoints() -> None:
    runs = [
        TourRun(0, 90.0, True, 18, 9, 10.0, 5.0, 0, 100),
        TourRun(1, 12.0, False, 2, 0, 30.0, 15.0, 1, 20, "left_knee_link", 12.0, 0.9, "fell"),
        TourRun(2, 3.0, False, 0, 0, float("nan"), float("nan"), 1, 4, "torso_link", 9.0, 0.9, "fell"),
    ]
    lines = list(summary_lines(runs))
    assert lines[0] == "3 runs: completed 1 (33%; 95 % interval 6% to 79%)"
    assert lines[1] == "mean survival 35.0 s, median 12.0 s"
    assert lines[2] == "waypoints: 9 reached of 20, mean error 12 cm and 6 degrees"
