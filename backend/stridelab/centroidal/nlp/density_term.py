"""The log-density term of (4.20a) for one effector, in CasADi: value, gradient and two curvatures.

With y = R^T (c - p) the CoM in the contact frame, the responsibilities gamma_j and the scores d_j of the components

    p(y) = sum_j w_j N(y; mu_j, S_j),    gamma_j = w_j N_j / p,    d_j = S_j^-1 (y - mu_j)
    -d/dy log p = sum_j gamma_j d_j
    -d2/dy2 log p = sum_j gamma_j S_j^-1 - theta Cov_gamma(d)

theta = 1 is the second derivative, indefinite between and beyond the components; theta = 0 leaves the EM majoriser, an
upper bound that is always positive definite but gives short steps between components of similar weight. Which solver
uses which, with measurements, is described in docs/theory/centroidal-problem.md.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from stridelab.reachability.gaussian_mixture import Mixture


@dataclass(frozen=True, eq=False)
class LikelihoodFunctions:
    """CasADi functions of ``(c, p, vec R)``, world coordinates: ``-log p``, gradient ``(3)``.

    ``curvature`` ``(3, 3)`` takes theta as a fourth argument.
    """

    value: ca.Function
    gradient: ca.Function
    curvature: ca.Function


def likelihood_functions(mixture: Mixture) -> LikelihoodFunctions:
    """Build the functions for one effector's mixture."""
    c, p, R, theta = ca.SX.sym("c", 3), ca.SX.sym("p", 3), ca.SX.sym("R", 3, 3), ca.SX.sym("theta")
    y = R.T @ (c - p)
    exponents, scores = [], []
    for w, mu, W in zip(mixture.weights, mixture.means_m, mixture.inverse_cholesky, strict=True):
        W_low = ca.sparsify(ca.DM(W))  # lower triangular
        whitened = W_low @ (y - ca.DM(mu))
        constant = np.log(w) + np.log(np.diag(W)).sum() - 1.5 * np.log(2 * np.pi)
        exponents.append(constant - 0.5 * ca.sumsqr(whitened))
        scores.append(W_low.T @ whitened)
    max_exponent = exponents[0]
    for e in exponents[1:]:
        max_exponent = ca.fmax(max_exponent, e)
    logp = max_exponent + ca.log(sum(ca.exp(e - max_exponent) for e in exponents))
    gamma = [ca.exp(e - logp) for e in exponents]
    mean = sum(s * d for s, d in zip(gamma, scores, strict=True))
    majoriser = sum(s * ca.DM(P) for s, P in zip(gamma, mixture.precisions, strict=True))
    covariance = sum(s * (d - mean) @ (d - mean).T for s, d in zip(gamma, scores, strict=True))
    inputs = [c, p, ca.vec(R)]
    return LikelihoodFunctions(
        value=ca.Function("value", inputs, [-logp]),
        gradient=ca.Function("gradient", inputs, [R @ mean]),
        curvature=ca.Function("curvature", [*inputs, theta], [R @ (majoriser - theta * covariance) @ R.T]),
    )
