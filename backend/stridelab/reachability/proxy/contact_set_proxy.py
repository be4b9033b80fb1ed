"""The proxy of a contact set (4.12): the normalised product of the densities of its effectors, again a mixture.

    p(c | M_1 .. M_K) = 1/Z prod_i p_i(c),        Z = int prod_i p_i(c) dc

The product of two normal densities is a scaled normal density, so that mixtures of ``k_1``, ``k_2``, ... components
give ``k_1 k_2 ...`` components, and ``Z`` is the sum of their weights:

    N(c; m_1, S_1) N(c; m_2, S_2) = N(m_1; m_2, S_1 + S_2) N(c; m, S)
    S = S_1 (S_1 + S_2)^-1 S_2,    m = S_2 (S_1 + S_2)^-1 m_1 + S_1 (S_1 + S_2)^-1 m_2

The cost (4.13) is the sum of the logarithms of the factors and does not need ``Z``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize
from scipy.special import logsumexp

from stridelab.conventions import Points, Series, Vector3
from stridelab.dynamics.spatial import Placement
from stridelab.errors import Fault, InvalidInput
from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.proxy.effector_proxy import Proxy

DROPPED_WEIGHT: Final = 1e-6
"""Total weight of the components of a product that are dropped; ``Z`` includes them."""
MODE_STARTS: Final = 12
"""Number of means, those of highest density, from which the mode is searched."""
DRAWS: Final = 20_000


@dataclass(frozen=True, eq=False)
class ContactSet:
    """The factors ``p_i`` in the world, their normalised ``product``, and ``log Z`` (nats, of m^-3 per factor but one).

    ``product`` omits components of total weight ``DROPPED_WEIGHT``; ``log_density`` omits none.
    """

    factors: tuple[Mixture, ...]
    product: Mixture
    log_z: float

    @staticmethod
    def from_placements(
        proxies: Mapping[str, Proxy], contacts: Mapping[str, Placement], heading_rad: float
    ) -> "ContactSet":
        """The proxy for effectors at their ``T_world_contact``, of a robot with trunk heading ``heading_rad``.

        Raises ``InvalidInput`` (``contacts-empty``, ``effector-unknown``).
        """
        if not contacts:
            raise InvalidInput("contacts-empty", "A proxy needs at least one contact.", [Fault("contacts", "empty")])
        if unknown := sorted(contacts.keys() - proxies.keys()):
            faults = [Fault(f"contacts.{name}", "no density has been learned for it") for name in unknown]
            raise InvalidInput("effector-unknown", f"There is no density for {', '.join(unknown)}.", faults)
        return multiply_mixtures(
            [
                transform_mixture(proxies[name].mixture, proxies[name].frame_placement(at, heading_rad))
                for name, at in contacts.items()
            ]
        )

    def log_density(self, com_m: Points) -> Series:
        """``log p(c | M_1 .. M_K)`` (nats, per m^3) at ``(n, 3)`` world positions."""
        return np.asarray(np.sum([factor.log_density(com_m) for factor in self.factors], axis=0) - self.log_z)

    def sample(self, n: int, rng: np.random.Generator) -> Points:
        """``n`` independent world positions ``(n, 3)``."""
        return self.product.sample(n, rng)

    def mode_m(self) -> Vector3:
        """The highest local maximum that BFGS reaches from the means of highest density."""
        means_m = self.product.means_m
        starts = means_m[np.argsort(-self.log_density(means_m))[:MODE_STARTS]]
        maxima = np.array([minimize(self._cost_and_gradient, start, jac=True, method="BFGS").x for start in starts])
        return np.asarray(maxima[np.argmax(self.log_density(maxima))])

    def volumes_m3(self, masses: Sequence[float], seed: int = 0) -> Series:
        """Volume of the smallest set of each of ``masses``: ``E_p[1 / p(c); p(c) >= t_m]`` over ``DRAWS``."""
        log_p = self.log_density(self.sample(DRAWS, np.random.default_rng(seed)))
        thresholds = np.quantile(log_p, 1.0 - np.asarray(masses))
        return np.array([np.exp(-log_p[log_p >= t]).sum() / len(log_p) for t in thresholds])

    def _cost_and_gradient(self, c: Vector3) -> tuple[float, Vector3]:
        """``-sum_i log p_i(c)`` of (4.13) and its gradient."""
        at = c[None]
        value = -sum(float(factor.log_density(at)[0]) for factor in self.factors)
        return value, -np.sum([factor.gradient(at)[0] for factor in self.factors], axis=0)


def transform_mixture(mixture: Mixture, T_world_frame: Placement) -> Mixture:
    """Transform a mixture from a frame to the world."""
    R = T_world_frame.rotation
    S = R @ mixture.covariances_m2 @ R.T
    return Mixture(mixture.weights, T_world_frame.act(mixture.means_m), np.asarray((S + S.swapaxes(1, 2)) / 2))


def multiply_mixtures(factors: Sequence[Mixture]) -> ContactSet:
    """The normalised product of mixtures in the same frame."""
    log_w, mu, S = np.log(factors[0].weights), factors[0].means_m, factors[0].covariances_m2
    for factor in factors[1:]:
        log_w, mu, S = _multiply_components(log_w, mu, S, factor)
    log_z = float(logsumexp(log_w))
    w = np.exp(log_w - log_z)
    rising = np.argsort(w)
    significant = np.sort(rising[np.cumsum(w[rising]) > DROPPED_WEIGHT])
    return ContactSet(
        tuple(factors), Mixture(w[significant] / w[significant].sum(), mu[significant], S[significant]), log_z
    )


def _multiply_components(
    log_w: Float[np.ndarray, "k"], mu: Float[np.ndarray, "k 3"], S: Float[np.ndarray, "k 3 3"], factor: Mixture
) -> tuple[Float[np.ndarray, "kl"], Float[np.ndarray, "kl 3"], Float[np.ndarray, "kl 3 3"]]:
    """Unnormalised log weights, means and covariances of the product with one more mixture."""
    S_1, S_2 = S[:, None], factor.covariances_m2[None]
    L = np.linalg.cholesky(S_1 + S_2)
    W = np.linalg.inv(L)
    between = mu[:, None] - factor.means_m[None]
    e = (W @ between[..., None])[..., 0]
    log_det = np.log(L.diagonal(axis1=-2, axis2=-1)).sum(axis=-1)
    log_overlap = -0.5 * (e**2).sum(axis=-1) - log_det - 1.5 * np.log(2 * np.pi)
    gain = S_1 @ W.swapaxes(-1, -2) @ W
    means = mu[:, None] - (gain @ between[..., None])[..., 0]
    covariances = gain @ S_2
    covariances = (covariances + covariances.swapaxes(-1, -2)) / 2
    log_w = log_w[:, None] + np.log(factor.weights) + log_overlap
    return log_w.ravel(), means.reshape(-1, 3), covariances.reshape(-1, 3, 3)
