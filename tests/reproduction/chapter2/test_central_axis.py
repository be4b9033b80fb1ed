"""Figure 2.2: what the moment beside the central axis, the printed (2.8) and the gap on the floor are, by hand."""

import numpy as np
import pytest

from stridelab.conventions import GRAVITY_M_S2
from stridelab.dynamics.wrench import Wrench
from stridelab.reproduction.chapter2 import fig_2_2
from stridelab.simulation.ground_truth import TrueMotion

FORCE_N = np.array([100.0, 100.0, 700.0])
FREE_NM = 3.0
"""Moment along the force: that on the central axis."""


@pytest.fixture
def wrench() -> Wrench:
    """Two samples whose central axis goes through (0.2, 0.1, 0) and (0.5, -0.1, 0)."""
    points = np.array([[0.2, 0.1, 0.0], [0.5, -0.1, 0.0]])
    force_n = np.array([FORCE_N, FORCE_N])
    along = FORCE_N / np.linalg.norm(FORCE_N)
    return Wrench(force_n, np.cross(points, force_n) + FREE_NM * along)


def test_the_least_moment_beside_the_axis_is_in_the_direction_to_which_the_force_leans(wrench: Wrench) -> None:
    """At 1 cm along the floor, of which cos(lean) is across the axis: sqrt(m^2 + (f d)^2) / m, the least of eight."""
    size_n = np.linalg.norm(FORCE_N)
    across_m = 0.01 * FORCE_N[2] / size_n
    expected = np.sqrt(FREE_NM**2 + (size_n * across_m) ** 2) / FREE_NM
    points = np.array([[0.2, 0.1, 0.0], [0.5, -0.1, 0.0]])
    assert fig_2_2._least_moment_ratio(wrench, points) == pytest.approx(expected, rel=1e-9)
    behind = points + np.array([-0.02, -0.02, 0.0])
    assert fig_2_2._least_moment_ratio(wrench, behind) < 1.0, "off the axis a neighbour has less, whichever it is"
    for away in ([0.02, 0.0, 0.0], [-0.02, 0.0, 0.0], [0.0, 0.02, 0.0], [0.0, -0.02, 0.0], [0.02, 0.02, 0.0]):
        assert fig_2_2._least_moment_ratio(wrench, points + np.array(away)) < 0.9


def test_the_gap_on_the_floor_is_that_of_the_free_moment(wrench: Wrench) -> None:
    """From the axis' point on the floor to the point where the moment is vertical: solved as two equations."""
    points = np.array([[0.2, 0.1, 0.0], [0.5, -0.1, 0.0]])
    zmp = []
    for moment, force in zip(wrench.moment_nm, wrench.force_n, strict=True):
        # (p x f) has -y f_x + x f_y about z; about x and y on the floor it is y f_z and -x f_z.
        zmp.append([-moment[1] / force[2], moment[0] / force[2], 0.0])
    by_hand = np.linalg.norm(np.array(zmp) - points, axis=1)
    assert by_hand.min() > 1e-4, "else it says nothing"
    assert fig_2_2._predicted_gap(wrench, np.array(zmp)) == pytest.approx(by_hand, rel=1e-9)


def test_the_printed_2_8_is_wrong_by_the_moments_about_two_axes() -> None:
    """At rest only L' is left: the true ZMP moves by -L'_y and +L'_x over m g, the printed one by L'_z in y."""
    rate_nm = np.array([[4.0, 8.0, 12.0]])
    truth = TrueMotion(
        time_s=np.zeros(1),
        velocity_m_s=np.zeros((1, 3)),
        momentum_nms=np.zeros((1, 3)),
        com_m=np.array([[0.1, 0.2, 0.8]]),
        acceleration_m_s2=np.array([[0.5, -0.25, 0.19]]),
        momentum_rate_nm=rate_nm,
        mass_kg=50.0,
    )
    lift = 0.19 + GRAVITY_M_S2
    x = 0.1 - 0.8 / lift * 0.5 - 8.0 / (50.0 * lift)
    y = 0.2 + 0.8 / lift * 0.25 + 12.0 / (50.0 * lift)
    assert fig_2_2._printed_2_8(truth) == pytest.approx(np.array([[x, y]]), rel=1e-12)


def test_lines_have_the_angle_of_their_directions_whatever_their_sense() -> None:
    u = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 2.0], [1.0, 0.0, 0.0]])
    v = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, -3.0], [0.0, 5.0, 0.0]])
    assert fig_2_2._angle_between(u, v) == pytest.approx(np.radians([45.0, 0.0, 90.0]), abs=1e-15)
    assert fig_2_2._rms_norm(np.array([[3.0, 4.0], [0.0, 0.0]])) == pytest.approx(np.sqrt(12.5))
