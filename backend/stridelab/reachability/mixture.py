"""Gaussian mixtures of section 4.3: the reduced density ``p_i(c)`` of the CoM in an effector's contact frame."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular
from scipy.special import logsumexp

from stridelab.conventions import Points, Series, Vector3
from stridelab.errors import Fault, InvalidInput

SUM_TOLERANCE: Final = 1e-9
"""By how much the weights may miss 1, and a covariance (relative to its largest entry) its transpose."""
STEP_M: Final = 1e-12
"""The ascent to a mode ends where no start moves farther than this in one step."""
STEPS_MAX: Final = 20_000


@dataclass(frozen=True, eq=False)
class Mixture:
    """``p(c) = sum_j w_j N(c; mu_j, S_j)``: weights ``(k,)``, means ``(k, 3)``, covariances ``(k, 3, 3)``.

    Raises ``InvalidInput`` (``mixture-invalid``) with one fault per field for numbers that are no density.
    """

    weights: Float[np.ndarray, "k"]
    means_m: Float[np.ndarray, "k 3"]
    covariances_m2: Float[np.ndarray, "k 3 3"]

    def __post_init__(self) -> None:
        faults = _faults(self.weights, self.means_m, self.covariances_m2)
        if faults:
            places = "; ".join(f"{fault.where}: {fault.message}" for fault in faults)
            raise InvalidInput("mixture-invalid", f"This is no Gaussian mixture: {places}.", faults)

    def log_density(self, points_m: Points) -> Series:
        """``log p(c)`` (nats, density per m^3) at ``(n, 3)`` points given in the contact frame."""
        return np.asarray(logsumexp(self._terms(points_m), axis=1))

    def gradient(self, points_m: Points) -> Points:
        """``d log p / dc = sum_j gamma_j S_j^-1 (mu_j - c)`` (nats per m), ``gamma`` the responsibilities."""
        pulls = np.einsum("jab,njb->nja", self._precisions(), self.means_m - points_m[:, None])
        return np.asarray(np.einsum("nj,nja->na", self._responsibilities(points_m), pulls))

    def sample(self, n: int, rng: np.random.Generator) -> Points:
        """``n`` independent points ``(n, 3)``."""
        of = rng.choice(len(self.weights), size=n, p=self.weights / self.weights.sum())
        L = np.linalg.cholesky(self.covariances_m2)
        return np.asarray(self.means_m[of] + np.einsum("nab,nb->na", L[of], rng.standard_normal((n, 3))))

    def mode_m(self) -> Vector3:
        """The highest point that is found by ascending from every mean.

        The ascent is the fixed point of EM (Carreira-Perpinan 2000, "Mode-finding for mixtures of Gaussian
        distributions"): ``c <- (sum_j gamma_j S_j^-1)^-1 sum_j gamma_j S_j^-1 mu_j``; it never descends.
        """
        P = self._precisions()
        pulls = np.einsum("jab,jb->ja", P, self.means_m)
        c = self.means_m.copy()
        for _ in range(STEPS_MAX):
            gamma = self._responsibilities(c)
            after = np.linalg.solve(np.einsum("nj,jab->nab", gamma, P), (gamma @ pulls)[..., None])[..., 0]
            moved = np.abs(after - c).max()
            c = after
            if moved < STEP_M:
                break
        return np.asarray(c[np.argmax(self.log_density(c))])

    def _terms(self, points_m: Points) -> Float[np.ndarray, "n k"]:
        """``log w_j N(c; mu_j, S_j)``."""
        terms = np.empty((len(points_m), len(self.weights)))
        for j, (w, mu, S) in enumerate(zip(self.weights, self.means_m, self.covariances_m2, strict=True)):
            L = np.linalg.cholesky(S)
            z = solve_triangular(L, (points_m - mu).T, lower=True)
            terms[:, j] = np.log(w) - 0.5 * (z**2).sum(axis=0) - np.log(np.diag(L)).sum() - 1.5 * np.log(2 * np.pi)
        return terms

    def _responsibilities(self, points_m: Points) -> Float[np.ndarray, "n k"]:
        terms = self._terms(points_m)
        return np.asarray(np.exp(terms - logsumexp(terms, axis=1, keepdims=True)))

    def _precisions(self) -> Float[np.ndarray, "k 3 3"]:
        return np.asarray(np.linalg.inv(self.covariances_m2))


def _faults(
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
