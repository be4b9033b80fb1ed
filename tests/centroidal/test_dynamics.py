"""The exact step of the linear form against the nonlinear equations (4.2), integrated numerically."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from stridelab.centroidal.contact_wrench import discrete_step, skew
from stridelab.conventions import g

M_G = 9.81


def newton_euler(t: float, x: np.ndarray, force: np.ndarray, moment: np.ndarray) -> np.ndarray:
    """(4.2) per unit of mass with L_c as the state; force and moment about the origin."""
    c, v = x[0:3], x[3:6]
    return np.concatenate([v, force + g, moment - np.cross(c, force)])


@given(seed=st.integers(0, 2**32 - 1), h=st.floats(0.01, 0.3))
def test_a_step_is_the_exact_integral_of_newton_and_euler(seed: int, h: float) -> None:
    """(4.8) with the wrench (4.5) of whatever forces."""
    rng = np.random.default_rng(seed)
    c, v, L = rng.normal(size=(3, 3))
    F, T = rng.normal(size=(2, 3))
    K = (L + np.cross(c, v)) / M_G
    s = discrete_step(h)
    x = s.A @ np.concatenate([c, v, K]) + s.B @ np.concatenate([F, T]) + s.b
    truth = solve_ivp(
        newton_euler, (0.0, h), np.concatenate([c, v, L]), args=(M_G * F, M_G * T), rtol=1e-12, atol=1e-12
    ).y[:, -1]
    assert x[0:6] == pytest.approx(truth[0:6], abs=1e-10)
    assert M_G * x[6:9] - np.cross(x[0:3], x[3:6]) == pytest.approx(truth[6:9], abs=1e-10)


def test_two_half_steps_are_one_step() -> None:
    half, whole = discrete_step(0.05), discrete_step(0.1)
    twice_A, twice_B, twice_b = half.A @ half.A, half.A @ half.B + half.B, half.A @ half.b + half.b
    assert twice_A == pytest.approx(whole.A, abs=1e-14)
    assert twice_B == pytest.approx(whole.B, abs=1e-14)
    assert twice_b == pytest.approx(whole.b, abs=1e-14)


def test_skew_is_the_cross_product() -> None:
    a, b = np.array([1.0, -2.0, 3.0]), np.array([0.3, 0.5, -0.7])
    assert skew(a) @ b == pytest.approx(np.cross(a, b))
