"""Exact optimal prediction for a linear time-invariant model, without a loop over the samples.

    x_{k+1} = F x_k + u_k + w_k,   y_k = H x_k + mu_k,   w ~ (0, W), mu ~ (0, R)

The gain of a Kalman filter converges. The constant gain belongs to the covariance P that solves the discrete Riccati
equation (DARE)

    P = Phi P F' + W,   L = F P H' S^-1,   S = H P H' + R,   Phi = F - L H .

With it the *nominal* filter ``n_{k+1} = Phi n_k + L y_k + u_k`` is a fixed linear recursion, optimal for a start of
covariance P. The true start has P_0 = P + Delta, an additional error r ~ (0, Delta). The nominal innovations
``e_k = y_k - H n_k`` contain that error as ``H Phi^k r`` in white noise S, so it can be estimated from them:

    O_k = sum_{j<k} Phi'^j H' S^-1 H Phi^j,   theta_k = sum_{j<k} Phi'^j H' S^-1 e_j,   M_k = (1 + Delta O_k)^-1 Delta,

    x_k = n_k + Phi^k M_k theta_k,            P_k = P + Phi^k M_k Phi'^k .

This is Lainiotis' partitioning. Sums are cumulative and end where Phi^k has decayed; from there on x_k = n_k. The
result equals that of the textbook recursion with its time-varying gain.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy import linalg

from stridelab.errors import InvalidInput

Square = Float[np.ndarray, "3 3"]
Squares = Float[np.ndarray, "n 3 3"]
Starts = Float[np.ndarray, "sets 3"]
States = Float[np.ndarray, "sets n 3"]
Signals = Float[np.ndarray, "sets n m"]

_NEGLIGIBLE = 1e-20
"""Powers of Phi below this are negligible in double precision."""


@dataclass(frozen=True)
class SteadyModel:
    """F, H, W and R. F and H must be detectable, F and W stabilisable."""

    F: Square
    H: Float[np.ndarray, "m 3"]
    W: Square
    R: Float[np.ndarray, "m m"]

    @cached_property
    def P(self) -> Square:
        """Steady-state covariance of the prediction: the stabilising solution of the DARE.

        Raises ``InvalidInput`` (``filter-not-solvable``) if there is none in double precision.
        """
        try:
            P = linalg.solve_discrete_are(self.F.T, self.H.T, self.W, self.R)
        except (ValueError, linalg.LinAlgError) as error:
            raise InvalidInput(
                "filter-not-solvable",
                "No steady Kalman filter exists in double precision: its standard deviations are too far apart.",
            ) from error
        return np.asarray((P + P.T) / 2)

    @cached_property
    def S(self) -> Float[np.ndarray, "m m"]:
        """Steady-state covariance of the innovations."""
        return np.asarray(self.R + self.H @ self.P @ self.H.T)

    @cached_property
    def L(self) -> Float[np.ndarray, "3 m"]:
        """Steady-state gain of the predictor."""
        return np.asarray(linalg.solve(self.S, self.H @ self.P @ self.F.T, assume_a="pos").T)

    @cached_property
    def Phi(self) -> Square:
        """Error transition of the nominal filter over one step."""
        return np.asarray(self.F - self.L @ self.H)

    def predictor(self, covariance: Square, n: int) -> "Predictor":
        """Optimal predictor over n measurements from an initial state with this covariance."""
        P = self.P
        powers = _decaying_powers(self.Phi, n + 1)
        seen = self.H @ powers[:-1]
        weighted = np.linalg.solve(self.S, seen)
        O = _sums_before(seen.transpose(0, 2, 1) @ weighted)
        Delta = covariance - P
        moved = powers @ np.linalg.solve(np.eye(3) + Delta @ O, np.broadcast_to(Delta, O.shape))
        covariances = np.empty((n + 1, 3, 3))
        covariances[: len(powers)] = P + moved @ powers.transpose(0, 2, 1)
        covariances[len(powers) :] = P
        return Predictor(self, weighted, moved, covariances)


@dataclass(frozen=True)
class Predictor:
    """Gains of one stretch; ``covariance`` holds P_0, ..., P_n.

    ``weighted`` is S^-1 H Phi^k and ``moved`` is Phi^k M_k, both until Phi^k has decayed.
    """

    model: SteadyModel
    weighted: Float[np.ndarray, "alive m 3"]
    moved: Float[np.ndarray, "_ 3 3"]
    covariance: Squares

    def predict_means(self, start: Starts, y: Signals, u: States | None = None) -> Float[np.ndarray, "sets _ 3"]:
        """Predicted means x_0, ..., x_n, each from the measurements before it, for several sets of signals.

        ``u`` is a known input, None for zero.
        """
        drive = y @ self.model.L.T if u is None else y @ self.model.L.T + u
        n = linear_recursion(self.model.Phi, np.concatenate([start[:, None], drive], axis=1))
        alive = len(self.weighted)
        e = y[:, :alive] - n[:, :alive] @ self.model.H.T
        theta = np.cumsum(np.einsum("kmi,skm->ski", self.weighted, e), axis=1)
        n[:, 1 : alive + 1] += np.einsum("kij,skj->ski", self.moved[1:], theta)
        return n


def linear_recursion(Phi: Square, v: States) -> States:
    """``x_k = Phi x_{k-1} + v_k`` with ``x_{-1} = 0``, by log2(n) sums of the array with its shifted self."""
    x, power, shift = v.copy(), Phi, 1
    while shift < x.shape[1] and np.abs(power).max() > _NEGLIGIBLE:
        x[:, shift:] += x[:, :-shift] @ power.T
        power, shift = power @ power, 2 * shift
    return x


def _decaying_powers(Phi: Square, n: int) -> Squares:
    """``Phi^0, Phi^1, ...`` until they are negligible, at most n of them."""
    powers, last = np.eye(3)[None], Phi
    while len(powers) < n and np.abs(last).max() > _NEGLIGIBLE:
        powers = np.concatenate([powers, powers @ last])
        last = last @ last
    return powers[:n]


def _sums_before(terms: Squares) -> Float[np.ndarray, "_ 3 3"]:
    """Exclusive cumulative sums: one more than there are terms; the first is zero."""
    return np.concatenate([np.zeros((1, 3, 3)), np.cumsum(terms, axis=0)])
