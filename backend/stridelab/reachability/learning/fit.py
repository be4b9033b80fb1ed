"""Fits Gaussian mixtures to sampled CoM positions by expectation maximisation (section 4.3.2.3).

EM (Dempster et al. 1977) maximises the likelihood of the samples and does not minimise the divergence from the kernel
density, which therefore falls, stagnates and rises with the number of components. The thesis searches by bisection for
the size where it stagnates. Here all sizes are fitted, and the smallest one whose divergence exceeds the minimum by no
more than the standard error of that difference is selected. The last fifth of the samples is held out from EM for the
held-out likelihood.

Each process computes on one thread, so that the numbers do not depend on the number of cores.

Monte Carlo estimate of the Kullback-Leibler divergence (Hershey and Olsen 2007, equation 4).

    KL(p || q) = E_p[log p(x) - log q(x)]  ~  1/n sum_a log p(x_a) - log q(x_a),     x_a drawn from p

which is unbiased; its standard error is that of the mean. The difference between the divergences of two q from the same
draws is E_p[log q'(x) - log q(x)], whose estimate is much more accurate than either, since log p cancels.
"""

import warnings
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from datetime import date
from functools import partial
from importlib.metadata import version
from typing import Final, Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from threadpoolctl import threadpool_limits

from stridelab.conventions import Points, Progress, Series, Vector3
from stridelab.errors import Fault, InvalidInput
from stridelab.machine.parallel import map_in_order, worthwhile_processes
from stridelab.reachability.card import (
    EffectorCard,
    Measure,
    PairReach,
    Reach,
    ReachabilityCard,
    SizeTrial,
    Triple,
)
from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.learning.com_sampling import ComCloud, require_effectors, sample_com
from stridelab.reachability.learning.kde import KernelDensity
from stridelab.reachability.proxy.effector_proxy import Frame
from stridelab.robots.robot import Robot


@runtime_checkable
class Density(Protocol):
    """A density that can be evaluated."""

    def log_density(self, points_m: Points, /) -> Series:
        """``log p`` at ``(n, 3)`` points."""
        ...


@runtime_checkable
class SampledDensity(Density, Protocol):
    """A density that can also be sampled."""

    def sample(self, n: int, rng: np.random.Generator, /) -> Points:
        """``n`` independent points."""
        ...


@dataclass(frozen=True)
class Divergence:
    """``KL(p || q)`` and the standard error of its estimate, in nats.

    ``excess_sd_nats`` is the standard error of its difference from the smallest one of the same call.
    """

    kl_nats: float
    kl_sd_nats: float
    excess_sd_nats: float


def kl_divergences(p: SampledDensity, qs: Sequence[Density], draws: int, rng: np.random.Generator) -> list[Divergence]:
    """``KL(p || q)`` of every ``q``, all from the same draws."""
    if not qs:
        return []
    x = p.sample(draws, rng)
    log_q = np.array([q.log_density(x) for q in qs])
    ratio = p.log_density(x) - log_q
    kl = ratio.mean(axis=1)
    excess = log_q[kl.argmin()] - log_q
    kl_sd, excess_sd = (values.std(axis=1, ddof=1) / np.sqrt(draws) for values in (ratio, excess))
    return [Divergence(*numbers) for numbers in zip(kl.tolist(), kl_sd.tolist(), excess_sd.tolist(), strict=True)]


THESIS_COMPONENTS: Final[Mapping[str, int]] = {"surface": 7, "point": 14}
"""Sizes for feet and hands at which the divergence stagnates in the thesis (figure 4.3)."""
SIZES: Final = range(1, 21)
"""Numbers of components that are fitted."""
SAMPLES_MIN: Final = 100
"""Minimum number of samples to fit the largest size."""
KL_DRAWS: Final = 10_000
HELD_OUT_RECIPROCAL: Final = 5
"""Reciprocal of the share of samples that is held out."""
REGULARISATION_M: Final = 3e-3
"""Standard deviation of the regularisation of every component in EM."""
STEPS_MAX: Final = 500
SAMPLING_SHARE: Final = 0.5
"""Share of the time spent on sampling, at 20 000 samples."""
SAMPLES_PER_S: Final = 5000
"""Approximate number of samples of one effector fitted per second."""
PERCENTILES: Final = (0.5, 99.5)
PACKAGES: Final = ("stridelab", "numpy", "scipy", "scikit-learn", "pin", "example-robot-data")


@dataclass(frozen=True, eq=False)
class LearnedDensities:
    """The card with its mixtures, and the samples it was learned from."""

    card: ReachabilityCard
    cloud: ComCloud


def learn_densities(
    robot: Robot,
    learned_on: date,
    effectors: Sequence[str] | None = None,
    samples: int = 20_000,
    seed: int = 0,
    measure: Measure = "uniform",
    progress: Progress | None = None,
    processes: int | None = None,
) -> LearnedDensities:
    """Learn the densities of ``effectors`` (None: all) with ``processes`` processes (None: all cores).

    On one machine the result depends only on the other arguments and the package versions, bit for bit.

    Raises ``NotFound`` (``effector-not-found``), ``InvalidInput`` (``too-few-samples``), ``NotEstimable``
    (``measure-unavailable``, ``no-free-configuration``).
    """
    names = tuple(dict.fromkeys(robot.effectors if effectors is None else effectors))
    require_effectors(robot, names)
    if samples < SAMPLES_MIN:
        message = f"{samples} samples are too few; at least {SAMPLES_MIN} are needed."
        raise InvalidInput("too-few-samples", message, [Fault("samples", f"at least {SAMPLES_MIN}")])
    report = progress or _ignore_progress

    def report_sampling(fraction: float, message: str) -> None:
        report(SAMPLING_SHARE * fraction, message)

    cloud = sample_com(robot, names, samples, seed, measure, report_sampling, processes)
    work = partial(_fit_numbered_effector, cloud, tuple(robot.effectors[name].kind for name in names), seed)
    cards: dict[str, EffectorCard] = {}
    n_processes = processes or worthwhile_processes(len(names) * samples // SAMPLES_PER_S)
    prepare_fits()
    with closing(map_in_order(work, len(names), n_processes)) as fitted:
        for name, effector in zip(names, fitted, strict=True):
            cards[name] = effector
            report(SAMPLING_SHARE + (1.0 - SAMPLING_SHARE) * len(cards) / len(names), f"{name} is fitted")
    card = ReachabilityCard(
        robot=robot.name,
        robot_sha256=robot.sha256,
        measure=measure,
        seed=seed,
        learned_on=learned_on.isoformat(),
        samples=samples,
        fitted=samples - samples // HELD_OUT_RECIPROCAL,
        tried=cloud.tried,
        rejected_share=1.0 - samples / cloud.tried,
        versions={package: version(package) for package in PACKAGES},
        effectors=cards,
        pairs=tuple(PairReach(pair, distance) for pair, distance in cloud.pair_distance_max_m.items()),
    )
    return LearnedDensities(card, cloud)


def fit(com_m: Points, kind: Literal["surface", "point"], frame: Frame, seed: int) -> EffectorCard:
    """Fit all ``SIZES`` to sampled CoM positions ``(n, 3)`` of an effector and select one mixture."""
    n = len(com_m) - len(com_m) // HELD_OUT_RECIPROCAL
    training, held_out = com_m[:n], com_m[n:]
    fitted = {k: expectation_maximisation(training, k, seed) for k in SIZES}
    kde = KernelDensity.with_scott_bandwidth(com_m)
    mixtures = [mixture for mixture, _ in fitted.values()]
    kl = dict(zip(SIZES, kl_divergences(kde, mixtures, KL_DRAWS, np.random.default_rng(seed)), strict=True))
    log_p = {k: mixture.log_density(held_out) for k, (mixture, _) in fitted.items()}
    k = select_size(kl)
    mixture, converged = fitted[k]
    mode = mixture.mode_m()
    return EffectorCard(
        frame=frame,
        weights=tuple(mixture.weights.tolist()),
        means=tuple(_to_triple(mu) for mu in mixture.means_m),
        covariances=tuple(_to_matrix(S) for S in mixture.covariances_m2),
        components=k,
        thesis_components=THESIS_COMPONENTS[kind],
        em_converged=converged,
        bandwidth_m=kde.bandwidth_m,
        kl_nats=kl[k].kl_nats,
        kl_sd_nats=kl[k].kl_sd_nats,
        kl_draws=KL_DRAWS,
        held_out_log_likelihood=float(log_p[k].mean()),
        held_out_log_likelihood_sd=float(log_p[k].std(ddof=1) / np.sqrt(len(held_out))),
        mode_m=_to_triple(mode),
        mode_log_density=float(mixture.log_density(mode[None])[0]),
        reach=reach_of(com_m),
        sizes=tuple(
            SizeTrial(size, d.kl_nats, d.kl_sd_nats, d.excess_sd_nats, float(log_p[size].mean()))
            for size, d in kl.items()
        ),
    )


def select_size(kl: Mapping[int, Divergence]) -> int:
    """The smallest size whose divergence exceeds the minimum by at most the standard error of the difference."""
    least = min(d.kl_nats for d in kl.values())
    return min(size for size, d in kl.items() if d.kl_nats - least <= d.excess_sd_nats)


def expectation_maximisation(com_m: Points, components: int, seed: int) -> tuple[Mixture, bool]:
    """Fit a mixture by EM, initialised by k-means; return it and whether EM converged."""
    from sklearn.exceptions import ConvergenceWarning  # 24 MB that only learning needs
    from sklearn.mixture import GaussianMixture

    em = GaussianMixture(components, random_state=seed, reg_covar=REGULARISATION_M**2, max_iter=STEPS_MAX)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # returned instead
        em.fit(com_m)
    S = em.covariances_
    return Mixture(em.weights_ / em.weights_.sum(), em.means_, (S + S.swapaxes(1, 2)) / 2), bool(em.converged_)


def prepare_fits() -> None:
    """Load scikit-learn and let it look up its libraries once, for processes that are forked from this one.

    It reads ``/proc/self/maps`` for this at its first fit, which a process forked inside the sandbox of a job must not.
    """
    with threadpool_limits(1):  # no thread, with which this process could no longer be forked
        expectation_maximisation(np.vstack([np.zeros(3), np.eye(3)]), 1, 0)


def reach_of(com_m: Points) -> Reach:
    """Box and sphere that contain sampled CoM positions."""
    low, high = np.percentile(com_m, PERCENTILES, axis=0)
    return Reach(_to_triple(low), _to_triple(high), float(np.linalg.norm(com_m, axis=1).max()))


def _fit_numbered_effector(
    cloud: ComCloud, kinds: tuple[Literal["surface", "point"], ...], seed: int, effector_index: int
) -> EffectorCard:
    """Fit the effector with index ``effector_index`` in the cloud."""
    name = list(cloud.com_m)[effector_index]
    return fit(cloud.com_m[name], kinds[effector_index], cloud.frames[name], seed)


def _to_triple(values: Vector3) -> Triple:
    x, y, z = values.tolist()
    return x, y, z


def _to_matrix(S: Float[np.ndarray, "3 3"]) -> tuple[Triple, Triple, Triple]:
    x, y, z = S
    return _to_triple(x), _to_triple(y), _to_triple(z)


def _ignore_progress(_fraction: float, _message: str) -> None:
    """Progress callback that does nothing."""
