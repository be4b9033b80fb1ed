"""Equations of chapter 2 that cannot hold as printed; docs/theory/misprints.md derives what the code uses."""

import numpy as np
from numpy.testing import assert_allclose
from scipy.linalg import expm

from stridelab.conventions import g
from stridelab.dynamics.newton_euler import contact_wrench
from stridelab.estimation.jerk_model import C, JerkModel


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
    dt, E, O = 0.005, np.eye(3), np.zeros((3, 3))
    A = np.block([[O, E, O], [O, O, E], [O, O, O]])
    printed = np.block([[O, dt * E, dt**2 / 2 * E], [O, O, dt * E], [O, O, O]])
    assert_allclose(expm(A * dt), np.eye(9) + printed, atol=1e-15)
    assert_allclose(np.kron(JerkModel(dt, 1.0).A, E), expm(A * dt), atol=1e-15)
    assert_allclose(np.kron(JerkModel(dt, 1.0, printed=True).A, E), printed, atol=1e-15)


def test_2_30_needs_the_acceleration_to_fit_the_three_rows_of_2_31():
    c, v, a = np.random.default_rng(1).normal(size=(3, 3))
    y = np.kron(C, np.eye(3)) @ np.concatenate([c, v, a])
    assert_allclose(y, np.concatenate([c, a, c]))
    assert y.shape != np.concatenate([c, c]).shape  # y of (2.30) as printed
