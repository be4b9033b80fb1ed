"""Section 4.3.2.3: a kernel density of sampled CoM positions is reduced to a Gaussian mixture by EM.

EM (Dempster et al. 1977) maximises the likelihood of the samples, not the divergence from the kernel density, so that
the divergence may rise with the number of components; the card keeps the whole curve. Every fifth sample, the last
ones of the cloud, is kept from EM for the held-out likelihood.
"""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from typing import Final

import numpy as np
from jaxtyping import Float
from sklearn.exceptions import ConvergenceWarning
from sklearn.mixture import GaussianMixture

from stridelab.conventions import Points, Vector3
from stridelab.errors import Fault, InvalidInput
from stridelab.reachability.card import EffectorCard, Measure, PairReach, Reach, ReachabilityCard, SizeTrial, Triple
from stridelab.reachability.density import KernelDensity
from stridelab.reachability.divergence import divergences
from stridelab.reachability.mixture import Mixture
from stridelab.reachability.sampling import ComCloud, Progress, require_effectors, sample_com
from stridelab.robots.robot import Robot

COMPONENTS: Final[Mapping[str, int]] = {"surface": 7, "point": 14}
"""Sizes for feet and hands where the thesis sees the divergence stagnate (figure 4.3)."""
SIZES: Final = (1, 2, 3, 4, 5, 7, 10, 14, 20)
"""Sizes of the curve."""
SAMPLES_MIN: Final = 100
"""Fewer samples are no cloud to fit the largest size to."""
KL_DRAWS: Final = 3000
HELD_OUT: Final = 5
"""One in so many samples is held out."""
FLOOR_M: Final = 3e-3
"""Standard deviation that EM adds to every component, so that none collapses."""
STEPS_MAX: Final = 500
SAMPLING_SHARE: Final = 0.6
"""Of the time, at 20 000 samples."""
PERCENTILES: Final = (0.5, 99.5)
PACKAGES: Final = ("stridelab", "numpy", "scipy", "scikit-learn", "pin", "example-robot-data")


@dataclass(frozen=True, eq=False)
class Learned:
    """The card with its mixtures, and the samples they were learned from."""

    card: ReachabilityCard
    cloud: ComCloud


def learn(
    robot: Robot,
    effectors: Sequence[str] | None = None,
    samples: int = 20_000,
    seed: int = 0,
    measure: Measure = "uniform",
    progress: Progress | None = None,
    sizes: Sequence[int] = SIZES,
) -> Learned:
    """Learn the densities of ``effectors`` (all where ``None``), a function of its arguments and the versions.

    Raises ``NotFound`` (``effector-not-found``), ``InvalidInput`` (``too-few-samples``), ``NotEstimable``
    (``measure-unavailable``, ``no-free-configuration``).
    """
    names = tuple(dict.fromkeys(robot.effectors if effectors is None else effectors))
    require_effectors(robot, names)
    if samples < SAMPLES_MIN:
        message = f"{samples} samples are too few to learn from; at least {SAMPLES_MIN} are needed."
        raise InvalidInput("too-few-samples", message, [Fault("samples", f"at least {SAMPLES_MIN}")])
    tell = progress or _silent

    def sampled(fraction: float, message: str) -> None:
        tell(SAMPLING_SHARE * fraction, message)

    cloud = sample_com(robot, names, samples, np.random.default_rng(seed), measure, sampled)
    cards: dict[str, EffectorCard] = {}
    for i, name in enumerate(names):
        tell(SAMPLING_SHARE + (1.0 - SAMPLING_SHARE) * i / len(names), f"fitting {name}")
        cards[name] = fit(cloud.com_m[name], COMPONENTS[robot.effectors[name].kind], seed, sizes)
    card = ReachabilityCard(
        robot=robot.name,
        robot_sha256=robot.sha256,
        measure=measure,
        seed=seed,
        samples=samples,
        fitted=samples - samples // HELD_OUT,
        tried=cloud.tried,
        versions={package: version(package) for package in PACKAGES},
        effectors=cards,
        pairs=tuple(PairReach(pair, distance) for pair, distance in cloud.pair_distance_max_m.items()),
    )
    return Learned(card, cloud)


def fit(com_m: Points, components: int, seed: int, sizes: Sequence[int] = SIZES) -> EffectorCard:
    """The mixture with ``components``, and the curve over ``sizes``, for sampled CoM positions ``(n, 3)``."""
    n = len(com_m) - len(com_m) // HELD_OUT
    seen, held_out = com_m[:n], com_m[n:]
    fitted = {k: expectation_maximisation(seen, k, seed) for k in sorted({*sizes, components})}
    kde = KernelDensity.scott(com_m)
    mixtures = [mixture for mixture, _ in fitted.values()]
    kl = dict(zip(fitted, divergences(kde, mixtures, KL_DRAWS, np.random.default_rng(seed)), strict=True))
    log_p = {k: mixture.log_density(held_out) for k, (mixture, _) in fitted.items()}
    mixture, converged = fitted[components]
    mode = mixture.mode_m()
    return EffectorCard(
        weights=tuple(mixture.weights.tolist()),
        means=tuple(_triple(mu) for mu in mixture.means_m),
        covariances=tuple(_matrix(S) for S in mixture.covariances_m2),
        components=components,
        em_converged=converged,
        bandwidth_m=kde.bandwidth_m,
        kl_nats=kl[components].kl_nats,
        kl_sd_nats=kl[components].kl_sd_nats,
        kl_draws=KL_DRAWS,
        held_out_log_likelihood=float(log_p[components].mean()),
        held_out_log_likelihood_sd=float(log_p[components].std(ddof=1) / np.sqrt(len(held_out))),
        mode_m=_triple(mode),
        mode_log_density=float(mixture.log_density(mode[None])[0]),
        reach=reach_of(com_m),
        sizes=tuple(SizeTrial(k, kl[k].kl_nats, kl[k].kl_sd_nats, float(log_p[k].mean())) for k in fitted),
    )


def expectation_maximisation(com_m: Points, components: int, seed: int) -> tuple[Mixture, bool]:
    """The mixture that EM finds from k-means, and whether it met its tolerance."""
    em = GaussianMixture(components, random_state=seed, reg_covar=FLOOR_M**2, max_iter=STEPS_MAX)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # it is in the answer
        em.fit(com_m)
    S = em.covariances_
    return Mixture(em.weights_ / em.weights_.sum(), em.means_, (S + S.swapaxes(1, 2)) / 2), bool(em.converged_)


def reach_of(com_m: Points) -> Reach:
    """Box and sphere that hold sampled CoM positions."""
    low, high = np.percentile(com_m, PERCENTILES, axis=0)
    return Reach(_triple(low), _triple(high), float(np.linalg.norm(com_m, axis=1).max()))


def _triple(values: Vector3) -> Triple:
    x, y, z = values.tolist()
    return x, y, z


def _matrix(S: Float[np.ndarray, "3 3"]) -> tuple[Triple, Triple, Triple]:
    x, y, z = S
    return _triple(x), _triple(y), _triple(z)


def _silent(_fraction: float, _message: str) -> None:
    """Nobody listens."""
