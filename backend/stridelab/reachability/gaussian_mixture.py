"""Gaussian mixtures of section 4.3: the reduced density ``p_i(c)`` of the CoM in an effector's contact frame."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular
from scipy.special import logsumexp

from stridelab.conventions import Points, Series, Vector3
from stridelab.errors import Fault, InvalidInput

SUM_TOLERANCE: Final = 1e-9
"""Tolerance of the sum of the weights, and of the symmetry of a covariance relative to its largest entry."""
STEP_M: Final = 1e-12
"""Step below which the ascent to a mode ends."""
STEPS_MAX: Final = 20_000


@dataclass(frozen=True, eq=False)
class Mixture:
    """``p(c) = sum_j w_j N(c; mu_j, S_j)``: weights ``(k,)``, means ``(k, 3)``, covariances ``(k, 3, 3)``.

    Raises ``InvalidInput`` (``mixture-invalid``) with one fault per invalid field.
    """

    weights: Float[np.ndarray, "k"]
    means_m: Float[np.ndarray, "k 3"]
    covariances_m2: Float[np.ndarray, "k 3 3"]

    def __post_init__(self) -> None:
        faults = _mixture_faults(self.weights, self.means_m, self.covariances_m2)
        if faults:
            places = "; ".join(f"{fault.where}: {fault.message}" for fault in faults)
            raise InvalidInput("mixture-invalid", f"Invalid Gaussian mixture: {places}.", faults)

    def log_density(self, points_m: Points) -> Series:
        """``log p(c)`` (nats, density per m^3) at ``(n, 3)`` points given in the contact frame."""
        return np.asarray(logsumexp(self._log_weighted_densities(points_m), axis=1))

    def gradient(self, points_m: Points) -> Points:
        """``d log p / dc = sum_j gamma_j d_j`` (nats per m), with the pulls ``d_j = S_j^-1 (mu_j - c)``.

        ``gamma_j = w_j N(c; mu_j, S_j) / p(c)`` are the responsibilities.
        """
        gamma, pulls = self._responsibilities(points_m), self._precision_weighted_offsets(points_m)
        return np.asarray(np.einsum("nj,nja->na", gamma, pulls))

    def hessian(self, points_m: Points) -> Float[np.ndarray, "n 3 3"]:
        """``d2 log p / dc2 = Cov_gamma(d) - sum_j gamma_j S_j^-1`` (nats per m^2), symmetric."""
        gamma, pulls = self._responsibilities(points_m), self._precision_weighted_offsets(points_m)
        about_mean = np.sqrt(gamma)[..., None] * (pulls - np.einsum("nj,nja->na", gamma, pulls)[:, None])
        covariance = np.einsum("nja,njb->nab", about_mean, about_mean)
        return np.asarray(covariance - np.einsum("nj,jab->nab", gamma, self.precisions))

    @cached_property
    def inverse_cholesky(self) -> Float[np.ndarray, "k 3 3"]:
        """Lower triangular ``W_j`` with ``S_j^-1 = W_j^T W_j``: the inverse Cholesky factors.

        For a narrow covariance they lose half as many digits as its inverse.
        """
        L = np.linalg.cholesky(self.covariances_m2)
        return np.array([solve_triangular(L_j, np.eye(3), lower=True) for L_j in L])

    @cached_property
    def precisions(self) -> Float[np.ndarray, "k 3 3"]:
        """``S_j^-1``, symmetric to the last bit."""
        W = self.inverse_cholesky
        return np.asarray(np.einsum("jca,jcb->jab", W, W))

    def sample(self, n: int, rng: np.random.Generator) -> Points:
        """``n`` independent points ``(n, 3)``."""
        of = rng.choice(len(self.weights), size=n, p=self.weights / self.weights.sum())
        L = np.linalg.cholesky(self.covariances_m2)
        return np.asarray(self.means_m[of] + np.einsum("nab,nb->na", L[of], rng.standard_normal((n, 3))))

    def mode_m(self) -> Vector3:
        """The highest local maximum that an ascent from the means reaches.

        The ascent is the fixed point of EM (Carreira-Perpinan 2000, "Mode-finding for mixtures of Gaussian
        distributions"): ``c <- (sum_j gamma_j S_j^-1)^-1 sum_j gamma_j S_j^-1 mu_j``; it never descends.
        """
        P = self.precisions
        pulls = np.einsum("jab,jb->ja", P, self.means_m)
        c = self.means_m.copy()
        for _ in range(STEPS_MAX):
            gamma = self._responsibilities(c)
            after = np.linalg.solve(np.einsum("nj,jab->nab", gamma, P), (gamma @ pulls)[..., None])[..., 0]
            step_m = np.abs(after - c).max()
            c = after
            if step_m < STEP_M:
                break
        return np.asarray(c[np.argmax(self.log_density(c))])

    def _log_weighted_densities(self, points_m: Points) -> Float[np.ndarray, "n k"]:
        """``log w_j N(c; mu_j, S_j) = log w_j + log det W_j - |W_j (c - mu_j)|^2 / 2 - 3/2 log 2 pi``."""
        W = self.inverse_cholesky
        terms = np.empty((len(points_m), len(self.weights)))
        for j, (W_j, mu) in enumerate(zip(W, self.means_m, strict=True)):
            terms[:, j] = -0.5 * (((points_m - mu) @ W_j.T) ** 2).sum(axis=1)
        log_det = np.log(W.diagonal(axis1=1, axis2=2)).sum(axis=1)
        return np.asarray(terms + np.log(self.weights) + log_det - 1.5 * np.log(2 * np.pi))

    def _precision_weighted_offsets(self, points_m: Points) -> Float[np.ndarray, "n k 3"]:
        W = self.inverse_cholesky
        whitened = np.einsum("jab,njb->nja", W, self.means_m - points_m[:, None])
        return np.asarray(np.einsum("jba,njb->nja", W, whitened))

    def _responsibilities(self, points_m: Points) -> Float[np.ndarray, "n k"]:
        terms = self._log_weighted_densities(points_m)
        return np.asarray(np.exp(terms - logsumexp(terms, axis=1, keepdims=True)))


def _mixture_faults(
    w: Float[np.ndarray, "k"], mu: Float[np.ndarray, "k 3"], S: Float[np.ndarray, "k 3 3"]
) -> tuple[Fault, ...]:
    faults = [
        Fault(name, "not all numbers are finite")
        for name, values in (("weights", w), ("means", mu), ("covariances", S))
        if not np.isfinite(values).all()
    ]
    if faults:
        return tuple(faults)
    if not (w > 0.0).all() or abs(w.sum() - 1.0) > SUM_TOLERANCE:
        faults.append(Fault("weights", f"they must be positive with sum 1; the sum is {w.sum():.12g}"))
    for j, S_j in enumerate(S):
        if np.abs(S_j - S_j.T).max() > SUM_TOLERANCE * np.abs(S_j).max():
            faults.append(Fault(f"covariances[{j}]", "it is not symmetric"))
        elif np.linalg.eigvalsh(S_j)[0] <= 0.0:
            faults.append(Fault(f"covariances[{j}]", "it is not positive definite"))
    return tuple(faults)
