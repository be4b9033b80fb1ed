"""Contact wrench: one sign of gravity, transport as a group action, any number of contacts."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose

from stridelab.conventions import g
from stridelab.dynamics.wrench import (
    Wrench,
    com_acceleration,
    contact_force,
    contact_wrench,
    momentum_rate,
    total_wrench,
    transport,
)

metres = st.floats(-10, 10)
points = arrays(float, (4, 3), elements=metres)
point = arrays(float, 3, elements=metres)
forces = arrays(float, (4, 3), elements=st.floats(-2000, 2000))
contacts = arrays(float, (3, 4, 3), elements=st.floats(-100, 100))


def test_standing_still_the_ground_pushes_up_with_the_weight():
    """(2.3)."""
    f = contact_force(np.zeros((1, 3)), 70.0)
    assert_allclose(f, [[0.0, 0.0, 70.0 * 9.81]])
    assert_allclose(f, [-70.0 * g])
    assert_allclose(com_acceleration(f, 70.0), [[0.0, 0.0, 0.0]], atol=1e-12)


def test_free_fall_needs_no_contact_wrench():
    rng = np.random.default_rng(0)
    wrench = contact_wrench(rng.normal(size=(5, 3)), np.tile(g, (5, 1)), np.zeros((5, 3)), 70.0)
    assert_allclose(wrench.force_n, 0.0, atol=1e-12)
    assert_allclose(wrench.moment_nm, 0.0, atol=1e-12)


def test_contacts_add_their_forces_levers_and_moments_of_their_own():
    at = np.array([[[1.0, 0.0, 0.0]], [[0.0, 2.0, 0.0]]])
    f = np.array([[[0.0, 0.0, 10.0]], [[0.0, 0.0, 20.0]]])
    nu = np.array([[[1.0, 2.0, 3.0]], [[0.5, 0.0, -7.0]]])
    wrench = total_wrench(at, f, nu)
    assert_allclose(wrench.force_n, [[0.0, 0.0, 30.0]])
    assert_allclose(wrench.moment_nm, [[40.0 + 1.5, -10.0 + 2.0, -4.0]])


def test_no_contact_at_all_is_the_zero_wrench():
    none = np.zeros((0, 4, 3))
    wrench = total_wrench(none, none, none)
    assert_allclose(wrench.force_n, np.zeros((4, 3)))
    assert_allclose(wrench.moment_nm, np.zeros((4, 3)))


@given(forces, forces, point, point)
def test_transport_is_a_group_action(f, nu, p, q):
    w = Wrench(f, nu)
    there = transport(transport(w, p), q)
    assert_allclose(there.moment_nm, transport(w, p + q).moment_nm, atol=1e-9)
    assert_allclose(transport(there, -(p + q)).moment_nm, nu, atol=1e-9)
    assert_allclose(transport(w, np.zeros(3)).moment_nm, nu)


@given(contacts, contacts, contacts, point)
def test_summing_and_transporting_commute(at, f, nu, p):
    """(2.5)."""
    moved = total_wrench(at - p, f, nu)
    assert_allclose(moved.moment_nm, transport(total_wrench(at, f, nu), p).moment_nm, atol=1e-8)


@given(forces, forces, point)
def test_the_power_of_a_wrench_does_not_depend_on_the_point(f, nu, p):
    """f . v_P + nu_P . omega is the same number for every point P of a rigid body."""
    v, omega = np.array([0.3, -1.0, 0.7]), np.array([1.1, 0.2, -0.4])
    moved = transport(Wrench(f, nu), p)
    assert_allclose(moved.force_n @ (v + np.cross(omega, p)) + moved.moment_nm @ omega, f @ v + nu @ omega, atol=1e-8)


@given(points, points, points)
def test_newton_euler_is_its_own_inverse(c, a, l_dot):
    """(2.3), (2.4) undo (2.6)."""
    wrench = contact_wrench(c, a, l_dot, 70.0)
    assert_allclose(momentum_rate(c, wrench), l_dot, atol=1e-8)
    assert_allclose(com_acceleration(wrench.force_n, 70.0), a, atol=1e-10)


def test_the_wrench_of_point_masses_is_that_of_their_sum():
    """Three particles with given accelerations: sum of m_i (a_i - g) and of p_i x m_i (a_i - g) is (2.6)."""
    rng = np.random.default_rng(1)
    m, p, v, a = rng.uniform(1, 30, 3), *rng.normal(size=(3, 3, 1, 3))
    total = m.sum()
    c, v_c, a_c = (np.tensordot(m, x, 1) / total for x in (p, v, a))
    l_dot = sum(m[i] * np.cross(p[i] - c, a[i] - a_c) for i in range(3))
    each = m[:, None, None] * (a - g)
    expected = total_wrench(p, each, np.zeros_like(each))
    wrench = contact_wrench(c, a_c, l_dot, float(total))
    assert_allclose(wrench.force_n, expected.force_n, atol=1e-9)
    assert_allclose(wrench.moment_nm, expected.moment_nm, atol=1e-9)
    assert np.abs(v_c).max() > 0  # the velocities cancel from L_c': d/dt sum m (p-c) x (v-v_c) has no v x v term
