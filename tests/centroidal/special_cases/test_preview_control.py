"""Preview control against the Riccati equation, against a dense least-squares optimum, and on walks."""

import numpy as np
import pytest

from stridelab.centroidal.special_cases.preview_control import CartTable, PreviewControl
from stridelab.conventions import GRAVITY_M_S2
from stridelab.dynamics.wrench import zmp_linearised
from stridelab.errors import InvalidInput

CONTROL = PreviewControl(height_m=0.83)


def steps(n: int, *, step_s: float = 0.8, step_m: float = 0.25, rest_s: float = 3.0, dt_s: float = 0.005) -> np.ndarray:
    """Zero-moment point that jumps from foot to foot."""
    k = np.clip(np.floor((np.arange(n) * dt_s - rest_s) / step_s) + 1, 0, 8)
    return np.column_stack([step_m * k, np.where((k == 0) | (k == 8), 0.0, np.where(k % 2 == 1, 0.085, -0.085))])


def test_gains_solve_the_discrete_riccati_equation() -> None:
    """K of the gains is a fixed point of the Riccati recursion, which is written out here from its start K = Q."""
    A, B, C = CONTROL.model
    F = np.zeros((4, 4))
    F[0, 0], F[0, 1:], F[1:, 1:] = 1.0, C @ A, A
    G = np.concatenate([[C @ B], B])
    Q = np.diag([1.0, 0.0, 0.0, 0.0])
    K = Q.copy()
    for _ in range(4000):
        gain = G @ K @ F / (1e-6 + G @ K @ G)
        K = Q + F.T @ K @ F - np.outer(F.T @ K @ G, gain)
    gains = CONTROL.gains
    np.testing.assert_allclose(gains.riccati, K, rtol=1e-6)
    np.testing.assert_allclose([gains.integral, *gains.state], gain, rtol=1e-6)
    closed = np.abs(np.linalg.eigvals(F - np.outer(G, gain)))
    assert closed.max() < 1.0, "the closed loop is stable"


def test_the_law_is_the_optimum_of_its_cost() -> None:
    """Against least squares over all steps of the jerk at once, at a coarse rate and over a finite horizon."""
    control = PreviewControl(height_m=0.6, dt_s=0.04, horizon_s=4.0, effort_weight=1e-4)
    n = 250
    reference = steps(n, dt_s=0.04)[:, 0]
    A, B, C = control.model
    response = np.empty(n)
    x = B.copy()
    for k in range(n):
        response[k] = C @ x
        x = A @ x
    to_zmp = np.array([[response[k - 1 - i] if i < k else 0.0 for i in range(n)] for k in range(n)])
    summed = np.tril(np.ones((n, n)))
    system = np.vstack([to_zmp @ summed, np.sqrt(1e-4) * np.eye(n)])
    du, *_ = np.linalg.lstsq(system, np.concatenate([reference, np.zeros(n)]), rcond=None)
    best = to_zmp @ summed @ du
    followed = control.follow(np.column_stack([reference, 0.0 * reference]))
    np.testing.assert_allclose(followed.zmp_m[: n - 60, 0], best[: n - 60], atol=2e-5)


def test_zmp_follows_the_footsteps() -> None:
    """Kajita's figure: within the sole (10 cm x 6 cm) except just around a jump, and exactly where it stays."""
    reference_m = steps(3000)
    cart = CONTROL.follow(reference_m)
    error = np.abs(cart.zmp_m - reference_m)
    jumping = np.abs(np.diff(reference_m, axis=0, prepend=reference_m[:1])).max(axis=1) > 0
    near = np.convolve(jumping, np.ones(61), "same") > 0
    assert error[~near].max() < 0.01
    assert np.median(error[~near]) < 2e-3
    np.testing.assert_allclose(cart.com_m[-1], reference_m[-1], atol=1e-6)
    np.testing.assert_allclose(cart.velocity_m_s[-1], 0.0, atol=1e-6)


def test_the_motion_is_that_of_the_cart_on_the_table() -> None:
    cart = CONTROL.follow(steps(2500))
    com = np.column_stack([cart.com_m, np.full(2500, 0.83)])
    acceleration = np.column_stack([cart.acceleration_m_s2, np.zeros(2500)])
    np.testing.assert_allclose(zmp_linearised(com, acceleration), cart.zmp_m, atol=1e-12)
    jerk = np.diff(cart.acceleration_m_s2, axis=0) / 0.005
    step = 0.005 * cart.acceleration_m_s2[:-1] + 0.005**2 / 2 * jerk
    np.testing.assert_allclose(np.diff(cart.velocity_m_s, axis=0), step, atol=1e-12)


def test_smooth_references_give_the_bounded_pendulum() -> None:
    """c = p * w/2 exp(-w |t|), the bounded solution of c'' = w^2 (c - p): the limit of infinite preview, no effort."""
    control = PreviewControl(height_m=0.83, horizon_s=3.0, effort_weight=1e-10)
    t = np.arange(4000) * 0.005
    p = 0.2 * np.exp(-(((t - 10.0) / 0.8) ** 2))
    w = np.sqrt(GRAVITY_M_S2 / 0.83)
    kernel = w / 2 * np.exp(-w * np.abs(np.arange(-1999, 2000) * 0.005)) * 0.005
    pendulum = np.convolve(p, kernel, "same") / kernel.sum()
    cart = control.follow(np.column_stack([p, -p]))
    np.testing.assert_allclose(cart.com_m[1000:3000, 0], pendulum[1000:3000], atol=2e-5)
    np.testing.assert_allclose(cart.com_m[:, 1], -cart.com_m[:, 0], atol=1e-12)


def test_steady_walking_repeats_every_stride() -> None:
    n = round(0.8 / 0.005)
    k = np.floor(np.arange(40 * n) / n)
    reference_m = np.column_stack([0.25 * k, 0.085 * (-1.0) ** k])
    cart = CONTROL.follow(reference_m)

    def stride(cart: CartTable, which: int) -> np.ndarray:
        part = slice(2 * which * n, 2 * (which + 1) * n)
        return np.column_stack([cart.com_m[part] - [0.5 * which, 0.0], cart.velocity_m_s[part]])

    np.testing.assert_allclose(stride(cart, 10), stride(cart, 14), atol=1e-6)
    assert cart.velocity_m_s[20 * n : 22 * n, 0].mean() == pytest.approx(0.25 / 0.8, rel=1e-4)
    lateral = stride(cart, 10)[:, 1]
    np.testing.assert_allclose(lateral[n:], -lateral[:n], atol=1e-6)


@pytest.mark.parametrize(
    "wrong",
    [{"height_m": 0.0}, {"dt_s": -1.0}, {"effort_weight": 0.0}, {"horizon_s": float("nan")}, {"horizon_s": 1e-3}],
)
def test_numbers_that_make_no_sense_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InvalidInput) as refusal:
        PreviewControl(**{"height_m": 0.83, **wrong})
    assert refusal.value.code == "preview-invalid"
    assert refusal.value.faults[0].where in wrong
