"""Gaussian mixtures of section 4.3: the reduced density ``p_i(c)`` of the CoM in an effector's contact frame."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

from stridelab.conventions import Points, Series


@dataclass(frozen=True, eq=False)
class Mixture:
    """``p(c) = sum_j w_j N(c; mu_j, S_j)``: weights ``(k,)``, means ``(k, 3)``, covariances ``(k, 3, 3)``."""

    weights: Float[np.ndarray, "k"]
    means_m: Float[np.ndarray, "k 3"]
    covariances_m2: Float[np.ndarray, "k 3 3"]

    def log_density(self, points_m: Points) -> Series:
        """``log p(c)`` (nats, density per m^3) at ``(n, 3)`` points given in the contact frame."""
        terms = np.empty((len(points_m), len(self.weights)))
        for j, (w, mu, S) in enumerate(zip(self.weights, self.means_m, self.covariances_m2, strict=True)):
            L = np.linalg.cholesky(S)
            z = np.linalg.solve(L, (points_m - mu).T)
            terms[:, j] = np.log(w) - 0.5 * (z**2).sum(axis=0) - np.log(np.diag(L)).sum() - 1.5 * np.log(2 * np.pi)
        return np.asarray(logsumexp(terms, axis=1))
