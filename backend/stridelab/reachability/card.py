"""Reachability cards: learned mixtures with their provenance and quality."""

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from pydantic import ConfigDict

from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.proxy.effector_proxy import Frame, Proxy

_STRICT: Final = ConfigDict(extra="forbid", allow_inf_nan=False)

Measure = Literal["uniform", "conditioned"]
"""Distribution of the postures: uniform within the joint limits, as in the thesis, or conditioned on standing."""
Triple = tuple[float, float, float]
Matrix = tuple[Triple, Triple, Triple]


@dataclass(frozen=True)
class Reach:
    """Box of the 0.5 and 99.5 percentiles of the sampled CoM in the effector's frame, and its largest distance.

    The largest sampled distance slightly underestimates the possible one.
    """

    __pydantic_config__ = _STRICT
    com_low_m: Triple
    com_high_m: Triple
    com_distance_max_m: float


@dataclass(frozen=True)
class SizeTrial:
    """The mixture of one size, fitted to the same samples: a point of figure 4.3.

    ``excess_sd_nats`` is the standard error of the difference between its KL and the smallest one of all sizes,
    estimated from the same draws; 0 for the smallest one itself.
    """

    __pydantic_config__ = _STRICT
    components: int
    kl_nats: float
    kl_sd_nats: float
    excess_sd_nats: float
    held_out_log_likelihood: float


@dataclass(frozen=True)
class EffectorCard:
    """One effector's mixture (metres, in ``frame``) and its quality.

    ``components`` is the size selected from the curve ``sizes``, ``thesis_components`` the size that the thesis uses.
    ``kl_nats`` is KL(KDE || mixture) with the kernel density of all samples and bandwidth ``bandwidth_m``, estimated
    from ``kl_draws`` draws with standard error ``kl_sd_nats``. ``held_out_log_likelihood`` is the mean log-density
    (nats, per m^3) of the held-out samples, with its standard error. ``em_converged`` is whether EM met its tolerance.
    """

    __pydantic_config__ = _STRICT
    frame: Frame
    weights: tuple[float, ...]
    means: tuple[Triple, ...]
    covariances: tuple[Matrix, ...]
    components: int
    thesis_components: int
    em_converged: bool
    bandwidth_m: float
    kl_nats: float
    kl_sd_nats: float
    kl_draws: int
    held_out_log_likelihood: float
    held_out_log_likelihood_sd: float
    mode_m: Triple
    mode_log_density: float
    reach: Reach
    sizes: tuple[SizeTrial, ...]

    def to_mixture(self) -> Mixture:
        """The density. Raises ``InvalidInput`` (``mixture-invalid``) for an invalid card; ``store`` validates cards."""
        return Mixture(np.array(self.weights), np.array(self.means), np.array(self.covariances))

    def to_proxy(self) -> Proxy:
        """The density in its frame. Raises as ``to_mixture``."""
        return Proxy(self.to_mixture(), self.frame)


@dataclass(frozen=True)
class PairReach:
    """The largest sampled distance between the contact points of two effectors; underestimates the possible one."""

    __pydantic_config__ = _STRICT
    effectors: tuple[str, str]
    distance_max_m: float


@dataclass(frozen=True)
class ReachabilityCard:
    """The densities of one robot learned from one set of sampled postures.

    Of ``tried`` postures, a share ``rejected_share`` was in self-collision and ``samples`` were accepted; EM used the
    first ``fitted`` of them. ``robot_sha256`` identifies the robot, ``versions`` the packages that computed the
    numbers, ``learned_on`` the date (ISO 8601).
    """

    __pydantic_config__ = _STRICT
    robot: str
    robot_sha256: str
    measure: Measure
    seed: int
    learned_on: str
    samples: int
    fitted: int
    tried: int
    rejected_share: float
    versions: dict[str, str]
    effectors: dict[str, EffectorCard]
    pairs: tuple[PairReach, ...]
