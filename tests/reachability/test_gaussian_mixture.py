"""The mixture against scikit-learn, quadrature and finite differences; numbers that are no density are refused."""

import numpy as np
import pytest
from sklearn.mixture import GaussianMixture

from stridelab.errors import InvalidInput
from stridelab.reachability.gaussian_mixture import Mixture


def random_mixture(k: int, seed: int) -> Mixture:
    rng = np.random.default_rng(seed)
    A = 0.12 * rng.standard_normal((k, 3, 3))
    return Mixture(
        rng.dirichlet(np.full(k, 3.0)), 0.3 * rng.standard_normal((k, 3)), A @ A.swapaxes(1, 2) + 0.005 * np.eye(3)
    )


def of_scikit_learn(mixture: Mixture) -> GaussianMixture:
    oracle = GaussianMixture(len(mixture.weights))
    oracle.weights_, oracle.means_, oracle.covariances_ = mixture.weights, mixture.means_m, mixture.covariances_m2
    L = np.linalg.cholesky(mixture.covariances_m2)
    oracle.precisions_cholesky_ = np.linalg.inv(L).swapaxes(1, 2)
    return oracle


@pytest.mark.parametrize("k", [1, 3, 14])
def test_log_density_is_that_of_scikit_learn(k: int) -> None:
    mixture = random_mixture(k, seed=k)
    points = np.random.default_rng(0).uniform(-1.5, 1.5, (500, 3))
    np.testing.assert_allclose(
        mixture.log_density(points), of_scikit_learn(mixture).score_samples(points), rtol=1e-12, atol=1e-10
    )


def test_far_away_it_stays_finite() -> None:
    """Every component underflows there."""
    log_p = random_mixture(5, seed=1).log_density(np.array([[100.0, 0.0, 0.0]]))
    assert np.isfinite(log_p).all()
    assert log_p[0] < -1e4


def test_it_integrates_to_one() -> None:
    """On a grid the sum of a smooth density converges faster than any power of the spacing."""
    mixture = random_mixture(4, seed=2)
    axis = np.linspace(-3.0, 3.0, 121)
    h = axis[1] - axis[0]
    total = sum(
        np.exp(mixture.log_density(np.stack(np.meshgrid([x], axis, axis), axis=-1).reshape(-1, 3))).sum() for x in axis
    )
    assert total * h**3 == pytest.approx(1.0, abs=1e-6)


def test_the_gradient_is_that_of_the_log_density() -> None:
    mixture = random_mixture(6, seed=3)
    points = np.random.default_rng(1).uniform(-0.8, 0.8, (40, 3))
    h = 1e-6
    steps = [(mixture.log_density(points + h * e) - mixture.log_density(points - h * e)) / (2 * h) for e in np.eye(3)]
    np.testing.assert_allclose(mixture.gradient(points), np.column_stack(steps), rtol=1e-6, atol=1e-6)


def test_drawn_points_have_the_moments_of_the_mixture() -> None:
    mixture = random_mixture(4, seed=4)
    n = 40_000
    x = mixture.sample(n, np.random.default_rng(2))
    w, mu = mixture.weights, mixture.means_m
    mean = w @ mu
    second = np.einsum("j,jab->ab", w, mixture.covariances_m2 + np.einsum("ja,jb->jab", mu, mu))
    assert (np.abs(x.mean(axis=0) - mean) < 4 * x.std(axis=0) / np.sqrt(n)).all()
    products = np.einsum("na,nb->nab", x, x)
    assert (np.abs(products.mean(axis=0) - second) < 4 * products.std(axis=0) / np.sqrt(n)).all()


def test_drawing_is_a_function_of_the_generator() -> None:
    mixture = random_mixture(3, seed=5)
    first, second = (mixture.sample(10, np.random.default_rng(6)) for _ in range(2))
    assert (first == second).all()


@pytest.mark.parametrize("seed", range(5))
def test_the_mode_is_a_maximum(seed: int) -> None:
    mixture = random_mixture(7, seed=10 + seed)
    mode = mixture.mode_m()

    def log_p(*at: np.ndarray) -> np.ndarray:
        return mixture.log_density(np.array(at))

    h = 1e-4
    slope = [(log_p(mode + h * e)[0] - log_p(mode - h * e)[0]) / (2 * h) for e in np.eye(3)]
    curvature = np.array(
        [
            [
                np.dot([1, -1, -1, 1], log_p(mode + a + b, mode + a - b, mode - a + b, mode - a - b)) / (4 * h * h)
                for a in h * np.eye(3)
            ]
            for b in h * np.eye(3)
        ]
    )
    assert np.abs(slope).max() < 1e-4
    assert np.linalg.eigvalsh(curvature)[-1] < -1.0
    assert log_p(mode)[0] >= mixture.log_density(mixture.sample(5000, np.random.default_rng(seed))).max()


def test_two_near_components_have_their_mode_between_them() -> None:
    """Nearer than two standard deviations to each other, two equal Gaussians have one mode."""
    mixture = Mixture(
        np.array([0.5, 0.5]), np.array([[0.4, 0.0, 0.1], [0.5, 0.0, 0.1]]), np.tile(0.01 * np.eye(3), (2, 1, 1))
    )
    np.testing.assert_allclose(mixture.mode_m(), [0.45, 0.0, 0.1], atol=1e-9)


@pytest.mark.parametrize(
    ("field", "value", "where"),
    [
        ("weights", np.array([0.5, 0.6]), "weights"),
        ("weights", np.array([1.5, -0.5]), "weights"),
        ("weights", np.array([1.0, 0.0]), "weights"),
        ("weights", np.array([0.5, np.nan]), "weights"),
        ("means_m", np.full((2, 3), np.inf), "means"),
        ("covariances_m2", np.tile(np.diag([1.0, 1.0, 0.0]), (2, 1, 1)), "covariances[0]"),
        ("covariances_m2", np.tile(np.diag([1.0, 1.0, -1.0]), (2, 1, 1)), "covariances[0]"),
        ("covariances_m2", np.stack([np.eye(3), np.eye(3) + np.eye(3, k=1)]), "covariances[1]"),
    ],
)
def test_invalid_densities_are_refused(field: str, value: np.ndarray, where: str) -> None:
    good = random_mixture(2, seed=0)
    fields = {"weights": good.weights, "means_m": good.means_m, "covariances_m2": good.covariances_m2} | {field: value}
    with pytest.raises(InvalidInput) as refusal:
        Mixture(**fields)
    assert refusal.value.code == "mixture-invalid"
    assert where in {fault.where for fault in refusal.value.faults}
