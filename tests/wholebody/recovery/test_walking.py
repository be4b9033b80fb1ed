"""The capture point of a periodic walk, against an integration of the pendulum; steps of a sideways walk."""

import numpy as np
import pytest

from stridelab.wholebody.recovery.side_steps import WayCorrection, side_steps_m
from stridelab.wholebody.recovery.walking import WalkCommand, periodic_offsets_m


@pytest.mark.parametrize(
    ("first_m", "second_m"),
    [((0.3, 0.17), (0.3, -0.17)), ((0.0, 0.47), (0.0, -0.17)), ((-0.1, 0.17), (-0.12, -0.19))],
)
def test_the_capture_point_of_a_walk_is_periodic(first_m: tuple[float, float], second_m: tuple[float, float]) -> None:
    """Integrated over two steps, with the pressure in the standing sole and then moving to the next one."""
    w, swing_s, both_s, dt_s = 3.4, 0.6, 0.16, 1e-5
    steps = [np.array(first_m), np.array(second_m)]
    start_m, landing_m = periodic_offsets_m(steps[0], steps[1], w, swing_s, both_s)
    stance_m, xi = np.zeros(2), start_m.copy()
    for k, step_m in enumerate(steps):
        for _ in range(round(swing_s / dt_s)):
            xi = xi + dt_s * w * (xi - stance_m)
        landed_m = stance_m + step_m
        if k == 0:
            assert xi - landed_m == pytest.approx(landing_m, abs=1e-4)
        n = round(both_s / dt_s)
        for i in range(n):
            pressure_m = stance_m + (i + 0.5) / n * step_m
            xi = xi + dt_s * w * (xi - pressure_m)
        stance_m = landed_m
    assert xi - stance_m == pytest.approx(start_m, abs=2e-3)


def test_small_commands_are_rest() -> None:
    assert WalkCommand().is_rest
    assert WalkCommand(0.01, -0.01, 0.01).is_rest
    assert not WalkCommand(turn_rad_s=-0.1).is_rest


@pytest.mark.parametrize("way_m", [0.0, 0.05, 0.12, 0.2, 0.25])
def test_two_side_steps_do_their_way_as_far_as_soles_and_leg_allow(way_m: float) -> None:
    leading_m, trailing_m = side_steps_m(way_m, usual_m=0.24, nearest_m=0.12, widest_m=0.36)
    assert leading_m - trailing_m == pytest.approx(min(way_m, 0.24))
    assert 0.12 <= trailing_m <= 0.24 <= leading_m <= 0.36
    assert trailing_m == pytest.approx(0.24) or leading_m == pytest.approx(0.36), "the leading step is used first"


@pytest.mark.parametrize("heading_rad", [0.0, 2.0])
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_the_way_of_side_steps_approaches_the_commanded_one(heading_rad: float, direction: float) -> None:
    """A robot whose steps do 0.7 of the way at which they aim."""
    left = np.array([-np.sin(heading_rad), np.cos(heading_rad)])
    way, commanded_m, middle_m = WayCorrection(0.2, (0.8, 1.7), 0.04), 0.0, np.zeros(2)
    for _ in range(60):
        commanded_m += direction * 0.1
        middle_m = middle_m + direction * 0.1 * 0.7 * way.factor * left
        way.add_landing(commanded_m, middle_m, left)
    assert way.factor == pytest.approx(1.0 / 0.7, rel=1e-3)


def test_the_way_is_corrected_within_limits_and_not_by_small_ways() -> None:
    left, way = np.array([0.0, 1.0]), WayCorrection(0.2, (0.8, 1.7), 0.04)
    for k in range(10):
        way.add_landing(0.01 * k, np.zeros(2), left)
    assert way.factor == 1.0
    for k in range(40):
        way.add_landing(0.1 * k, np.zeros(2), left)
    assert way.factor == 1.7, "a robot that does not move at all"
    before = way.factor
    way.begin_walk()
    for k in range(3):
        way.add_landing(0.1 * k, 0.2 * k * left, left)
    assert way.factor == before, "steps of two walks are not compared"
