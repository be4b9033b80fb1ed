"""How hard a hand presses where the plan asks for less."""

import numpy as np
import pytest

from stridelab.contacts.sequence import Contact
from stridelab.dynamics.placement import Placement
from stridelab.wholebody.grip import Grip

WEIGHT_N = 550.0
GRIP = Grip(least_n=25.0, pressure_m=0.02)
SOLES_M = np.array([0.0, 0.0, 0.1])
TO_THE_LEFT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Axes of a wall at the robot's right: z away from it."""


def hand(position_m: list[float], rotation: np.ndarray) -> Contact:
    place = Placement(np.array(position_m), rotation)
    return Contact("right_hand", place, "surface", 0.5, "point")


@pytest.mark.parametrize(("position_m", "rotation"), [([0.2, -0.7, 0.95], TO_THE_LEFT), ([0.3, -0.4, 0.7], np.eye(3))])
def test_it_moves_the_centre_of_pressure_by_no_more_than_allowed(position_m: list[float], rotation: np.ndarray) -> None:
    """Equilibrium of moments about the soles: those of the hand are those of the weight on a lever of 2 cm."""
    there = hand(position_m, rotation)
    pressed_n = GRIP.pressed_n(0.0, there, SOLES_M, WEIGHT_N)
    moment = np.cross(there.placement.position_m - SOLES_M, pressed_n * rotation[:, 2])
    assert pressed_n < GRIP.least_n
    assert np.hypot(*moment[:2]) == pytest.approx(0.02 * WEIGHT_N)


def test_above_the_soles_a_hand_on_a_wall_presses_less_than_on_a_rail_beside_the_hip() -> None:
    wall, rail = hand([0.1, -0.75, 0.95], TO_THE_LEFT), hand([0.1, -0.45, 0.7], np.eye(3))
    on_wall, on_rail = (GRIP.pressed_n(0.0, there, SOLES_M, WEIGHT_N) for there in (wall, rail))
    assert on_wall == pytest.approx(0.02 * WEIGHT_N / 0.85)
    assert on_wall < on_rail < GRIP.least_n


def test_what_is_planned_is_pressed_and_near_the_soles_the_least_is() -> None:
    assert GRIP.pressed_n(60.0, hand([0.1, -0.75, 0.95], TO_THE_LEFT), SOLES_M, WEIGHT_N) == 60.0
    assert GRIP.pressed_n(0.0, hand([0.05, -0.1, 0.7], np.eye(3)), SOLES_M, WEIGHT_N) == GRIP.least_n
