"""Equations of chapter 2 that cannot hold as printed; docs/theory/misprints.md derives what the code uses."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import expm

from stridelab.conventions import GRAVITY_M_S2, g
from stridelab.dynamics.wrench import (
    Wrench,
    central_axis,
    com_acceleration,
    contact_force,
    contact_wrench,
    total_wrench,
    transport,
    zmp_of_motion,
    zmp_of_wrench,
)
from stridelab.estimation.kalman.jerk_model import C, JerkModel

UP = np.array([0.0, 0.0, 1.0])


def particles(t: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Masses and positions of four particles on analytic paths."""
    rng = np.random.default_rng(seed)
    m, p, v, amplitude = rng.uniform(2, 30, 4), *rng.normal(size=(3, 4, 3))
    return m, p + v * t + amplitude * np.sin(3 * t)


def com_and_momentum(t: float) -> tuple[np.ndarray, np.ndarray]:
    """CoM and angular momentum about it, velocities by central differences."""
    h = 1e-5
    m, p = particles(t)
    v = (particles(t + h)[1] - particles(t - h)[1]) / (2 * h)
    c, c_dot = m @ p / m.sum(), m @ v / m.sum()
    return c, (m[:, None] * np.cross(p - c, v - c_dot)).sum(axis=0)


def test_2_6_holds_with_the_derivative_of_the_angular_momentum_and_not_without():
    """(2.6) against particles."""
    t, h = 0.7, 1e-4
    m, p = particles(t)
    a = (particles(t + h)[1] - 2 * p + particles(t - h)[1]) / h**2
    c, L = com_and_momentum(t)
    L_dot = (com_and_momentum(t + h)[1] - com_and_momentum(t - h)[1]) / (2 * h)
    truth = np.cross(p, m[:, None] * (a - g)).sum(axis=0)  # moment that the particles need, from Newton alone
    c_ddot = (m @ a / m.sum())[None]
    ours = contact_wrench(c[None], c_ddot, L_dot[None], float(m.sum())).moment_nm[0]
    printed = contact_wrench(c[None], c_ddot, L[None], float(m.sum())).moment_nm[0]
    assert_allclose(ours, truth, atol=1e-3)
    assert np.abs(printed - truth).max() > 10


def test_2_29_lacks_the_identity():
    """(2.29) against the matrix exponential of (2.15), (2.16)."""
    dt, E, O = 0.005, np.eye(3), np.zeros((3, 3))
    A = np.block([[O, E, O], [O, O, E], [O, O, O]])
    printed = np.block([[O, dt * E, dt**2 / 2 * E], [O, O, dt * E], [O, O, O]])
    assert_allclose(expm(A * dt), np.eye(9) + printed, atol=1e-15)
    assert_allclose(np.kron(JerkModel(dt, 1.0).A, E), expm(A * dt), atol=1e-15)
    assert_allclose(np.kron(JerkModel(dt, 1.0, printed=True).A, E), printed, atol=1e-15)


def test_2_30_needs_the_acceleration_to_fit_the_three_rows_of_2_31():
    """(2.30), (2.31)."""
    c, v, a = np.random.default_rng(1).normal(size=(3, 3))
    y = np.kron(C, np.eye(3)) @ np.concatenate([c, v, a])
    assert_allclose(y, np.concatenate([c, a, c]))
    assert y.shape != np.concatenate([c, c]).shape  # y of (2.30) as printed


def test_gravity_has_one_sign_and_standing_still_the_ground_pushes_up():
    standing = contact_force(np.zeros((1, 3)), 70.0)
    assert_allclose(standing, [[0.0, 0.0, 70 * 9.81]])
    assert_allclose(com_acceleration(standing, 70.0), 0.0, atol=1e-12)
    with_g_of_4_2_in_2_3 = 70 * g  # p' = f - m g = 0 with g = (0, 0, -9.81): a ground that pulls
    assert with_g_of_4_2_in_2_3[2] == pytest.approx(-686.7)


def test_2_7_needs_the_height_of_the_plate():
    """(2.7)."""
    top = np.array([[[0.4, -0.1, 0.584]]])  # the highest plate of the stairs among the recordings at hand
    wrench = total_wrench(top, np.array([[[150.0, -40.0, 700.0]]]), np.zeros((1, 1, 3)))
    printed = np.array([-wrench.moment_nm[0, 1], wrench.moment_nm[0, 0], 0.0]) / wrench.force_n[0, 2]
    assert_allclose(printed - top[0, 0], [-0.584 * 150 / 700, 0.584 * 40 / 700, -0.584], atol=1e-12)
    assert abs(printed - top[0, 0])[0] > 0.12  # 125 mm along the walk
    assert_allclose(zmp_of_wrench(wrench, np.array([0.0, 0.0, 0.584]), UP), top[0], atol=1e-12)


def test_2_8_second_row_needs_the_derivative_about_x():
    """Both rows against the moment balance about the floor, and the printed second row. (2.8)."""
    m, h, rng = 70.0, 0.2, np.random.default_rng(3)
    c, a, L_dot = rng.uniform(0.5, 1.5, (5, 3)), rng.normal(size=(5, 3)), 20 * rng.normal(size=(5, 3))
    f = m * (a + GRAVITY_M_S2 * UP)
    nu = np.cross(c - h * UP, f) + L_dot  # about the point of the floor below the origin
    from_moment = np.column_stack([-nu[:, 1], nu[:, 0]]) / f[:, 2:]
    assert_allclose(zmp_of_motion(c, a, L_dot, m, h), from_moment, atol=1e-12)
    printed = zmp_of_motion(c, a, L_dot[:, [2, 1, 2]], m, h)  # L' about z in the place of L' about x
    assert_allclose(printed[:, 0], from_moment[:, 0], atol=1e-12)
    assert np.abs(printed[:, 1] - from_moment[:, 1]).max() > 0.02
    assert 20.0 / (m * GRAVITY_M_S2) == pytest.approx(0.029, abs=5e-4)  # 29 mm for 20 Nm


def test_2_11_says_more_than_that_force_and_moment_are_orthogonal():
    """Orthogonality holds for every L' that is orthogonal to f; the CoM is then beside the axis all the same (2.11)."""
    c, f, L_dot = np.array([[1.0, 0.5, 0.9]]), np.array([[0.0, 0.0, 700.0]]), np.array([[0.0, 20.0, 0.0]])
    wrench = Wrench(f, np.cross(c, f) + L_dot)
    assert_allclose(np.sum(wrench.force_n * wrench.moment_nm), 0.0, atol=1e-9)
    assert np.linalg.norm(central_axis(wrench).project(c) - c) == pytest.approx(20 / 700)


def test_2_12_mixes_no_origins():
    """(2.12)."""
    c, f = np.array([[2.0, 0.3, 0.9]]), np.array([[60.0, -20.0, 700.0]])
    plate = np.array([1.8, 0.2, 0.0])
    about_world = Wrench(f, np.cross(c, f))
    about_plate = transport(about_world, plate)
    assert_allclose(central_axis(about_world).project(c), c, atol=1e-12)
    assert_allclose(central_axis(about_plate).project(c - plate) + plate, c, atol=1e-12)
    mixed = central_axis(about_plate).project(c) - c
    assert np.linalg.norm(mixed) > 1.5  # the distance of the plate from the origin


def test_whether_l_is_negligible_does_not_depend_on_its_size_against_the_moment():
    """|c_p - c| = |f x L'| / f^2 is the same wherever the laboratory begins; nu grows with the distance."""
    f, L_dot = np.array([[0.0, 0.0, 700.0]]), np.array([[0.0, 20.0, 0.0]])
    shares, offsets = [], []
    for away in (0.0, 1.0, 100.0):
        c = np.array([[away, 0.0, 0.9]])
        nu = np.cross(c, f) + L_dot
        shares.append(float(np.linalg.norm(L_dot) / np.linalg.norm(nu)))
        offsets.append(float(np.linalg.norm(central_axis(Wrench(f, nu)).project(c) - c)))
    assert_allclose(offsets, 20 / 700, rtol=1e-9)
    assert shares[0] == pytest.approx(1.0)
    assert shares[2] < 3e-4


def test_2_3_1_what_is_orthogonal_to_the_force_is_observable_only_without_l_and_without_jerk():
    m, t = 70.0, np.linspace(0.0, 1.0, 101)[:, None]
    c0, v0, a0, u = (
        np.array([0.2, 0.1, 0.9]),
        np.array([1.2, 0.0, 0.1]),
        np.array([0.5, -0.3, 0.2]),
        np.array([10.0, 0, 0]),
    )

    def signals(shift_s2: float, L_dot: np.ndarray, jerk: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Force, moment and velocity of a motion of constant jerk, moved by ``shift_s2 (c'' - g)`` at every instant."""
        a = a0 + jerk * t
        c = c0 + v0 * t + a0 * t**2 / 2 + jerk * t**3 / 6 + shift_s2 * (a - g)
        f = m * (a - g)
        return f, np.cross(c, f) + L_dot, v0 + a0 * t + jerk * t**2 / 2 + shift_s2 * jerk

    none = np.zeros(3)
    f, nu, v = signals(0.0, none, u)
    f_moved, nu_moved, v_moved = signals(0.05, none, u)
    assert_allclose(f_moved, f, atol=1e-9)
    assert_allclose(nu_moved, nu, atol=1e-9)
    along = f / np.linalg.norm(f, axis=1, keepdims=True)
    hidden = v_moved - v
    across = hidden - np.sum(hidden * along, axis=1, keepdims=True) * along
    assert np.linalg.norm(across, axis=1).min() > 0.3  # m/s that no wrench shows, orthogonal to the force

    f, nu, _ = signals(0.0, np.array([0.0, 20.0, 0.0]), none)  # with L', the same wrench belongs to another CoM
    c_p = central_axis(Wrench(f, nu)).project(c0 + v0 * t + a0 * t**2 / 2)
    assert_allclose(
        np.cross(c_p, f) - nu, -np.sum(nu * f, axis=1, keepdims=True) * f / np.sum(f**2, axis=1)[:, None], atol=1e-9
    )
    assert np.linalg.norm(c_p - (c0 + v0 * t + a0 * t**2 / 2), axis=1).min() > 0.025
