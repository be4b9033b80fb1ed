"""ZMP from the wrench and from the motion; the corrected (2.8) against the wrench, the printed one fails."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose

from stridelab.conventions import GRAVITY_M_S2
from stridelab.dynamics.wrench import (
    Wrench,
    contact_wrench,
    total_wrench,
    transport,
    zmp_linearised,
    zmp_of_motion,
    zmp_of_wrench,
)

UP = np.array([0.0, 0.0, 1.0])
points = arrays(float, (3, 3), elements=st.floats(-3, 3))
moments = arrays(float, (3, 3), elements=st.floats(-100, 100))


@given(points, points, moments, st.floats(-1, 1))
def test_the_corrected_2_8_is_the_zmp_of_the_wrench(c, a, l_dot, height_m):
    wrench = contact_wrench(c, a, l_dot, 70.0)
    plane = np.array([0.3, -0.2, height_m])
    expected = zmp_of_wrench(wrench, plane, UP)
    assert_allclose(zmp_of_motion(c, a, l_dot, 70.0, height_m), expected[:, :2], atol=1e-9)
    assert_allclose(expected[:, 2], height_m, atol=1e-12)


def test_2_8_as_printed_is_not_the_zmp_of_the_wrench():
    c, a, l_dot = np.array([[0.0, 0.0, 0.9]]), np.zeros((1, 3)), np.array([[20.0, 0.0, 0.0]])
    truth = zmp_of_wrench(contact_wrench(c, a, l_dot, 70.0), np.zeros(3), UP)[0, :2]
    printed = c[0, :2] + np.array([-l_dot[0, 1], l_dot[0, 2]]) / (70 * GRAVITY_M_S2)
    assert truth[1] == pytest.approx(20 / (70 * 9.81))
    assert np.abs(printed - truth).max() > 0.02


@given(points, moments, arrays(float, 3, elements=st.floats(-1, 1)))
def test_on_any_plane_the_moment_about_the_zmp_is_along_the_normal(c, nu, tilt):
    """(2.7) for any plane, by what defines it, (2.13)."""
    n = UP + 0.5 * tilt
    wrench = Wrench(np.tile([30.0, -20.0, 700.0], (3, 1)), nu)
    q = c[0]
    z = zmp_of_wrench(wrench, q, n)
    assert_allclose((z - q) @ n, 0.0, atol=1e-8)
    assert_allclose(np.cross(transport(wrench, z).moment_nm, n), 0.0, atol=1e-8)


def test_for_one_point_force_the_zmp_is_its_point():
    p = np.array([[[0.4, -0.3, 0.1]]])
    wrench = total_wrench(p, np.array([[[10.0, 5.0, 600.0]]]), np.zeros((1, 1, 3)))
    assert_allclose(zmp_of_wrench(wrench, np.array([0.0, 0.0, 0.1]), UP), p[0], atol=1e-12)


def test_the_cart_table_model_is_exact_for_constant_height_without_angular_momentum():
    """(2.9) against (2.8)."""
    c = np.array([[0.1, 0.2, 0.8]] * 3)
    a = np.array([[1.0, -0.5, 0.0], [0.0, 0.0, 0.0], [-2.0, 1.0, 0.0]])
    full = zmp_of_motion(c, a, np.zeros((3, 3)), 70.0)
    assert_allclose(zmp_linearised(c, a), full, atol=1e-12)
    assert_allclose(zmp_linearised(c, a, 0.5), zmp_of_motion(c, a, np.zeros((3, 3)), 70.0, 0.3), atol=1e-12)


def test_without_load_there_is_no_zmp():
    z = zmp_of_wrench(Wrench(np.array([[0.0, 0.0, 5.0]]), np.zeros((1, 3))), np.zeros(3), UP)
    assert np.isnan(z).all()
    falling = zmp_of_motion(np.ones((1, 3)), np.array([[0.0, 0.0, -9.81]]), np.zeros((1, 3)), 70.0)
    assert np.isnan(falling).all()


@pytest.mark.parametrize("length", [0.1, 1.0, 3.0])
def test_twenty_newton_along_the_normal_are_too_little_whatever_its_length(length):
    """A foot with hardly any load has no ZMP."""
    f = np.array([[0.0, 0.0, 20.0], [0.0, 0.0, 20.5], [0.0, 0.0, 60.0]])
    z = zmp_of_wrench(Wrench(f, np.zeros((3, 3))), np.zeros(3), length * UP)
    assert np.isnan(z[:, 0]).tolist() == [True, False, False]


def test_shortly_before_free_fall_the_motion_still_has_a_zmp():
    c, a = np.array([[0.1, 0.2, 0.9]]), np.array([[0.2, -0.1, 0.4 - GRAVITY_M_S2]])
    wrench = contact_wrench(c, a, np.zeros((1, 3)), 70.0)
    assert_allclose(
        zmp_of_motion(c, a, np.zeros((1, 3)), 70.0), zmp_of_wrench(wrench, np.zeros(3), UP)[:, :2], atol=1e-9
    )
