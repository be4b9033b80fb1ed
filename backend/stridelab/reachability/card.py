"""What is kept of learned densities: the mixtures, how they were learned and how good they are."""

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from pydantic import ConfigDict

from stridelab.reachability.mixture import Mixture

_STRICT: Final = ConfigDict(extra="forbid", allow_inf_nan=False)

Measure = Literal["uniform", "conditioned"]
"""How postures are drawn: uniform within the joint limits, as in the thesis, or so given that the robot stands."""
Triple = tuple[float, float, float]
Matrix = tuple[Triple, Triple, Triple]


@dataclass(frozen=True)
class Reach:
    """Box of the 0.5 and 99.5 percentiles of the sampled CoM in the contact frame, and its largest distance.

    The largest distance of samples is a little less than what is possible.
    """

    __pydantic_config__ = _STRICT
    com_low_m: Triple
    com_high_m: Triple
    com_distance_max_m: float


@dataclass(frozen=True)
class SizeTrial:
    """A mixture of another size, fitted to the same samples."""

    __pydantic_config__ = _STRICT
    components: int
    kl_nats: float
    kl_sd_nats: float
    held_out_log_likelihood: float


@dataclass(frozen=True)
class EffectorCard:
    """One effector's mixture (metres, in its contact frame) and its quality.

    ``kl_nats`` is KL(KDE || mixture) with the kernel density of all samples and bandwidth ``bandwidth_m``, estimated
    from ``kl_draws`` draws with standard error ``kl_sd_nats``. ``held_out_log_likelihood`` is the mean log-density
    (nats, per m^3) of the samples that EM did not see, with its standard error. ``sizes`` is the curve over the
    number of components. ``em_converged`` tells whether EM met its tolerance.
    """

    __pydantic_config__ = _STRICT
    weights: tuple[float, ...]
    means: tuple[Triple, ...]
    covariances: tuple[Matrix, ...]
    components: int
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

    def mixture(self) -> Mixture:
        """The density. Raises ``InvalidInput`` (``mixture-invalid``) for a card that ``store`` did not check."""
        return Mixture(np.array(self.weights), np.array(self.means), np.array(self.covariances))


@dataclass(frozen=True)
class PairReach:
    """The largest distance between the contact frames of two effectors over all samples: less than is possible."""

    __pydantic_config__ = _STRICT
    effectors: tuple[str, str]
    distance_max_m: float


@dataclass(frozen=True)
class ReachabilityCard:
    """All that was learned of one robot from one cloud of postures.

    ``samples`` postures were kept of ``tried`` that were checked for self-collision; EM saw the first ``fitted`` of
    them. ``robot_sha256`` identifies the robot's card and description, ``versions`` the packages that computed the
    numbers.
    """

    __pydantic_config__ = _STRICT
    robot: str
    robot_sha256: str
    measure: Measure
    seed: int
    samples: int
    fitted: int
    tried: int
    versions: dict[str, str]
    effectors: dict[str, EffectorCard]
    pairs: tuple[PairReach, ...]
