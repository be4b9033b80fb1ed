"""Speed of learning where the CoM can be (section 4.3); run by ``make bench`` (skipped otherwise).

What scikit-learn can do too is timed in the same run: its kernel density answers from a tree, exactly.
"""

import numpy as np
import pytest
from sklearn.mixture import GaussianMixture
from sklearn.neighbors import KernelDensity as TreeDensity
from threadpoolctl import threadpool_limits

from stridelab.centroidal.nlp.stage_functions import likelihood_functions
from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.learning.com_sampling import BLOCK, sample_com
from stridelab.reachability.learning.fit import KL_DRAWS, SIZES, expectation_maximisation, kl_divergences
from stridelab.reachability.learning.kde import KernelDensity
from stridelab.reachability.store import load_card, load_cloud
from stridelab.robots.loader import load_robot

ROBOTS = ("talos", "hrp2", "g1")
EFFECTORS = ("left_foot", "left_hand")


@pytest.fixture(autouse=True)
def one_thread():
    """As in a job."""
    with threadpool_limits(1):
        yield


def cloud_m(effector: str) -> np.ndarray:
    """20 000 samples: those of the package, each four times, two millimetres off."""
    points = load_cloud("talos", "uniform")[effector]
    return np.tile(points, (4, 1)) + np.random.default_rng(0).normal(0.0, 0.002, (4 * len(points), 3))


@pytest.mark.parametrize("measure", ["uniform", "conditioned"])
@pytest.mark.parametrize("robot", ROBOTS)
def test_sampling(benchmark, robot, measure):
    """A block of 500 accepted postures, all four effectors, on one core; 20 000 take 40 of them."""
    loaded = load_robot(robot)
    names = tuple(loaded.effectors)
    cloud = benchmark.pedantic(lambda: sample_com(loaded, names, BLOCK, 0, measure, processes=1), rounds=3)
    benchmark.extra_info["samples_per_s"] = round(BLOCK / benchmark.stats.stats.median)
    benchmark.extra_info["rejected"] = round(1 - BLOCK / cloud.tried, 3)


@pytest.mark.parametrize("effector", EFFECTORS)
def test_fits_of_all_sizes(benchmark, effector):
    """EM for 1 to 20 components on 16 000 samples."""
    x = cloud_m(effector)[:16_000]
    benchmark.pedantic(lambda: [expectation_maximisation(x, k, 0) for k in SIZES], rounds=3)


@pytest.mark.parametrize("effector", EFFECTORS)
def test_divergence_of_all_sizes(benchmark, effector):
    """10 000 draws from 20 000 kernels, against 20 mixtures."""
    kernels, card = (
        KernelDensity.with_scott_bandwidth(cloud_m(effector)),
        load_card("talos", "uniform").effectors[effector],
    )
    mixtures = [card.to_mixture()] * len(SIZES)
    benchmark.pedantic(lambda: kl_divergences(kernels, mixtures, KL_DRAWS, np.random.default_rng(0)), rounds=3)


@pytest.mark.parametrize("by", ["ours", "scikit-learn"])
def test_kernel_density(benchmark, by):
    """20 000 kernels at 1000 points."""
    x = cloud_m("left_foot")
    kernels, points = KernelDensity.with_scott_bandwidth(x), x[:1000] + 0.05
    tree = TreeDensity(bandwidth=kernels.bandwidth_m).fit(x)
    evaluate = kernels.log_density if by == "ours" else tree.score_samples
    benchmark.pedantic(lambda: evaluate(points), rounds=3)


@pytest.mark.parametrize("by", ["ours", "scikit-learn"])
def test_mixture_density(benchmark, by):
    """The bundled mixture of a foot at 10 000 points."""
    mixture = load_card("talos", "uniform").effectors["left_foot"].to_mixture()
    points = cloud_m("left_foot")[:10_000]
    evaluate = mixture.log_density if by == "ours" else of_scikit_learn(mixture).score_samples
    benchmark(lambda: evaluate(points))
    np.testing.assert_allclose(mixture.log_density(points), of_scikit_learn(mixture).score_samples(points), atol=1e-10)


@pytest.mark.parametrize("what", ["value", "gradient", "hessian"])
@pytest.mark.parametrize("by", ["numpy", "casadi"])
def test_one_point(benchmark, by, what):
    """What a solver asks for at one node; CasADi's functions as they are called from Python."""
    mixture = load_card("talos", "uniform").effectors["left_foot"].to_mixture()
    c, functions = np.array([[0.0, -0.1, 0.8]]), likelihood_functions(mixture)
    if by == "numpy":
        evaluate = {"value": mixture.log_density, "gradient": mixture.gradient, "hessian": mixture.hessian}[what]
        benchmark(lambda: evaluate(c))
        return
    at, axes = np.zeros(3), np.eye(3).ravel()
    call = {"value": functions.value, "gradient": functions.gradient, "hessian": functions.curvature}[what]
    more = (1.0,) if what == "hessian" else ()
    benchmark(lambda: call(c[0], at, axes, *more))


def of_scikit_learn(mixture: Mixture) -> GaussianMixture:
    """The same mixture as scikit-learn keeps it."""
    oracle = GaussianMixture(len(mixture.weights))
    oracle.weights_, oracle.means_, oracle.covariances_ = mixture.weights, mixture.means_m, mixture.covariances_m2
    oracle.precisions_cholesky_ = mixture.inverse_cholesky.swapaxes(1, 2)
    return oracle
