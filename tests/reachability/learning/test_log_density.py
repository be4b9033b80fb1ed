"""Log-density, gradient and Hessian in NumPy and in CasADi: the same to 1e-10, and scikit-learn's.

Mixtures are random, with components as narrow as EM's floor beside wide ones, tilted, and with hardly any weight. 1e-10
is relative to what is added up: near a narrow component the Hessian is a difference of numbers of 1e5 nats per m^2.
"""

import casadi as ca
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from sklearn.mixture import GaussianMixture
from sklearn.mixture._gaussian_mixture import _compute_precision_cholesky

from stridelab.centroidal.nlp.stage_functions import likelihood_functions
from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.learning.fit import REGULARISATION_M

TOLERANCE = 1e-10
WIDEST_M = 0.6
SIZES = st.integers(1, 20)
SEEDS = st.integers(0, 2**32 - 1)


def extreme(k: int, seed: int) -> Mixture:
    """Standard deviations from EM's floor to more than any robot needs, weights over nine powers of ten."""
    rng = np.random.default_rng(seed)
    weights = 10.0 ** rng.uniform(-9, 0, k)
    sd = np.exp(rng.uniform(np.log(REGULARISATION_M), np.log(WIDEST_M), (k, 3)))
    R = Rotation.random(k, rng=rng).as_matrix()
    S = np.einsum("jab,jb,jcb->jac", R, sd**2, R)
    return Mixture(weights / weights.sum(), rng.normal(0.0, 0.7, (k, 3)), (S + S.swapaxes(1, 2)) / 2)


def near(mixture: Mixture, seed: int, deviations: float = 10.0) -> np.ndarray:
    """Points some standard deviations off a component, where others compete with it."""
    rng = np.random.default_rng(seed)
    j = rng.integers(len(mixture.weights), size=8)
    L = np.linalg.cholesky(mixture.covariances_m2[j])
    return mixture.means_m[j] + np.einsum("nab,nb->na", L, deviations * rng.normal(size=(8, 3)) * rng.random((8, 1)))


def of_scikit_learn(mixture: Mixture) -> GaussianMixture:
    oracle = GaussianMixture(len(mixture.weights))
    oracle.weights_, oracle.means_, oracle.covariances_ = mixture.weights, mixture.means_m, mixture.covariances_m2
    oracle.precisions_cholesky_ = _compute_precision_cholesky(mixture.covariances_m2, "full")
    return oracle


@settings(max_examples=60, deadline=None)
@given(SIZES, SEEDS)
def test_the_value_is_that_of_scikit_learn_near_and_far(k: int, seed: int) -> None:
    mixture = extreme(k, seed)
    points = np.concatenate([near(mixture, seed), np.random.default_rng(seed).uniform(-50, 50, (4, 3))])
    ours, theirs = mixture.log_density(points), of_scikit_learn(mixture).score_samples(points)
    assert (np.abs(ours - theirs) <= TOLERANCE * (1.0 + np.abs(theirs))).all()


@settings(max_examples=25, deadline=None)
@given(SIZES, SEEDS)
def test_casadi_says_the_same_as_numpy(k: int, seed: int) -> None:
    mixture, origin, axes = extreme(k, seed), np.zeros(3), np.eye(3).ravel()
    functions, points = likelihood_functions(mixture), near(mixture, seed)
    value, gradient, hessian = mixture.log_density(points), mixture.gradient(points), mixture.hessian(points)
    for i, c in enumerate(points):
        assert abs(value[i] + float(functions.value(c, origin, axes))) <= TOLERANCE * (1.0 + abs(value[i]))
        slope = functions.gradient(c, origin, axes).full().ravel()
        assert np.abs(gradient[i] + slope).max() <= TOLERANCE * (1.0 + np.abs(slope).max())
        bend = functions.curvature(c, origin, axes, 1.0).full()
        added = np.abs(functions.curvature(c, origin, axes, 0.0).full()).max() + np.abs(bend).max()
        assert np.abs(hessian[i] + bend).max() <= TOLERANCE * (1.0 + added)
        assert (hessian[i] == hessian[i].T).all()


@settings(max_examples=15, deadline=None)
@given(st.integers(1, 8), SEEDS)
def test_the_derivatives_are_those_of_automatic_differentiation(k: int, seed: int) -> None:
    """CasADi differentiates the value by its own rules."""
    mixture, axes = extreme(k, seed), np.eye(3)
    c = ca.SX.sym("c", 3)
    hessian, gradient = ca.hessian(likelihood_functions(mixture).value(c, np.zeros(3), axes.ravel()), c)
    derived, points = ca.Function("derived", [c], [gradient, hessian]), near(mixture, seed, deviations=4.0)
    ours, ours_2 = mixture.gradient(points), mixture.hessian(points)
    for i, point in enumerate(points):
        slope, bend = (value.full() for value in derived(point))
        added = np.abs(mixture.precisions).max() + np.abs(slope).max() ** 2
        assert np.abs(ours[i] + slope.ravel()).max() <= TOLERANCE * (1.0 + np.abs(slope).max())
        assert np.abs(ours_2[i] + bend).max() <= TOLERANCE * (1.0 + added)


@settings(max_examples=25, deadline=None)
@given(SIZES, SEEDS)
def test_the_hessian_is_that_of_finite_differences(k: int, seed: int) -> None:
    """Of the gradient, with steps far below the narrowest deviation: their own error is about 1e-7."""
    mixture = extreme(k, seed)
    points, h = near(mixture, seed, deviations=3.0), 1e-3 * REGULARISATION_M
    steps = [(mixture.gradient(points + e) - mixture.gradient(points - e)) / (2 * h) for e in h * np.eye(3)]
    bends = np.stack(steps, axis=1)
    scale = 1.0 + np.abs(mixture.precisions).max() + np.abs(mixture.gradient(points)).max() ** 2
    assert np.abs(mixture.hessian(points) - bends).max() <= 1e-5 * scale
