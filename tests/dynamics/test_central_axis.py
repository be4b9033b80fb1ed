"""The central axis (2.10), the projection (2.12) and theorem 1."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose

from stridelab.dynamics.wrench import Wrench, central_axis, contact_wrench, transport, zmp_of_wrench

WEIGHT = np.array([0.0, 0.0, 700.0])
metres = st.floats(-5, 5)
points = arrays(float, (3, 3), elements=metres)
point = arrays(float, 3, elements=metres)
moments = arrays(float, (3, 3), elements=st.floats(-2000, 2000))
# mostly upward, never below the threshold
forces = arrays(float, (3, 3), elements=st.floats(-300, 300)).map(lambda f: f + WEIGHT)


@given(forces, moments, points)
def test_projection_is_idempotent_and_lies_on_the_axis(f, nu, c):
    axis = central_axis(Wrench(f, nu))
    p = axis.project(c)
    assert_allclose(axis.project(p), p, atol=1e-9)
    about_p = transport(Wrench(f, nu), p).moment_nm
    assert_allclose(np.cross(about_p, f), 0.0, atol=1e-4)  # moment along the force: on the axis
    assert_allclose(np.einsum("ij,ij->i", p - c, f), 0.0, atol=1e-6)  # orthogonal


@given(forces, moments, points, point)
def test_projection_does_not_depend_on_the_origin(f, nu, c, o):
    here = central_axis(Wrench(f, nu)).project(c)
    there = central_axis(transport(Wrench(f, nu), o)).project(c - o) + o
    assert_allclose(there, here, atol=1e-9)


@given(points, points)
def test_without_angular_momentum_the_com_is_its_own_projection(c, a):
    """(2.11)."""
    wrench = contact_wrench(c, a, np.zeros((3, 3)), 70.0)
    axis = central_axis(wrench, threshold_n=1.0)
    assert_allclose(axis.project(c)[axis.defined], c[axis.defined], atol=1e-6)


@given(points, moments, st.floats(-300, 300))
def test_angular_momentum_moves_the_projection_by_f_cross_l_over_f_squared(c, l_dot, push):
    a = np.tile([push / 70, 0.0, 0.0], (3, 1))
    wrench = contact_wrench(c, a, l_dot, 70.0)
    f = wrench.force_n
    expected = np.cross(f, l_dot) / np.sum(f**2, axis=1, keepdims=True)
    assert_allclose(central_axis(wrench).project(c) - c, expected, atol=1e-9)


@given(forces, moments)
def test_the_moment_on_the_axis_is_the_smallest(f, nu):
    """(2.14)."""
    axis = central_axis(Wrench(f, nu))
    on_axis = transport(Wrench(f, nu), axis.point_m).moment_nm
    assert_allclose(np.linalg.norm(on_axis, axis=1), np.abs(axis.pitch_moment_nm), atol=1e-6)
    beside = transport(Wrench(f, nu), axis.point_m + np.array([0.3, -0.2, 0.1])).moment_nm
    assert (np.linalg.norm(beside, axis=1) >= np.linalg.norm(on_axis, axis=1) - 1e-6).all()


def test_where_the_force_is_too_small_there_is_no_axis():
    f = np.array([[0.0, 0.0, 100.0], [0.0, 0.0, 101.0], [0.0, 0.0, 0.0]])
    axis = central_axis(Wrench(f, np.ones((3, 3))))
    assert axis.defined.tolist() == [False, True, False]
    p = axis.project(np.ones((3, 3)))
    assert np.isnan(p[[0, 2]]).all()
    assert np.isfinite(p[1]).all()


def distance_between_parallel_lines(p, q, direction):
    n = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    return np.linalg.norm(np.cross(q - p, n), axis=1)


@given(forces, moments)
def test_theorem_1_the_zmp_axis_is_the_central_axis_only_if_force_is_vertical_or_moment_orthogonal(f, nu):
    """(2.13) and (2.14) are one moment only there."""
    n = np.array([0.0, 0.0, 1.0])

    def gap(force, moment):
        w = Wrench(force, moment)
        return distance_between_parallel_lines(zmp_of_wrench(w, np.zeros(3), n), central_axis(w).point_m, force)

    vertical = f * [0.0, 0.0, 1.0]
    assert_allclose(gap(vertical, nu), 0.0, atol=1e-9)  # (ii-a)
    orthogonal = nu - np.sum(nu * f, axis=1, keepdims=True) / np.sum(f**2, axis=1, keepdims=True) * f
    assert_allclose(gap(f, orthogonal), 0.0, atol=1e-9)  # (ii-b)
    # the converse, with its size: the axes are |nu . f| |f_xy| / (|f|^2 |f_z|) apart
    norm = np.linalg.norm(f, axis=1)
    expected = np.abs(np.sum(nu * f, axis=1)) * np.linalg.norm(f[:, :2], axis=1) / (norm**2 * np.abs(f[:, 2]))
    assert_allclose(gap(f, nu), expected, atol=1e-9)
