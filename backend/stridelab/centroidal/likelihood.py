"""The log-density term of (4.20a) for one effector, in CasADi: value, gradient and a positive definite curvature.

With y = R^T (c - p) the CoM in the contact frame, the responsibilities gamma_j and the pulls of the components

    p(y) = sum_j w_j N(y; mu_j, S_j),    gamma_j = w_j N_j / p,    d_j = S_j^-1 (y - mu_j)
    -d/dy log p = sum_j gamma_j d_j
    -d2/dy2 log p = sum_j gamma_j S_j^-1 - Cov_gamma(d)

the first part of the curvature is the EM majoriser: always positive definite, and a bound from above. Alone it makes
short steps; so as much of the covariance is taken off as leaves the rest positive definite by a margin
(docs/theory/centroidal-problem.md).
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from stridelab.reachability.mixture import Mixture

SHARES = (0.25, 0.5, 0.75, 1.0)
"""Shares of the covariance that may be taken off the majoriser."""
CURVATURE_MIN = 2.0
"""Smallest curvature (nats per m^2) that must be left."""


@dataclass(frozen=True, eq=False)
class Likelihood:
    """CasADi functions of ``(c, p, vec R)``, world coordinates: ``-log p``, gradient ``(3)``, curvature ``(3, 3)``."""

    value: ca.Function
    gradient: ca.Function
    curvature: ca.Function


def likelihood(mixture: Mixture) -> Likelihood:
    """The functions for one effector's mixture."""
    c, p, R = ca.SX.sym("c", 3), ca.SX.sym("p", 3), ca.SX.sym("R", 3, 3)
    y = R.T @ (c - p)
    precisions = np.linalg.inv(mixture.covariances_m2)
    exponents, pulls = [], []
    for w, mu, S, P in zip(mixture.weights, mixture.means_m, mixture.covariances_m2, precisions, strict=True):
        d = ca.DM(P) @ (y - ca.DM(mu))
        constant = np.log(w) - 0.5 * np.linalg.slogdet(2 * np.pi * S)[1]
        exponents.append(constant - 0.5 * ca.dot(y - ca.DM(mu), d))
        pulls.append(d)
    top = exponents[0]
    for e in exponents[1:]:
        top = ca.fmax(top, e)
    logp = top + ca.log(sum(ca.exp(e - top) for e in exponents))
    gamma = [ca.exp(e - logp) for e in exponents]
    mean = sum(s * d for s, d in zip(gamma, pulls, strict=True))
    majoriser = sum(s * ca.DM(P) for s, P in zip(gamma, precisions, strict=True))
    covariance = sum(s * (d - mean) @ (d - mean).T for s, d in zip(gamma, pulls, strict=True))
    curvature = majoriser
    for theta in SHARES:
        reduced = majoriser - theta * covariance
        curvature = ca.if_else(_definite(reduced - CURVATURE_MIN * ca.SX.eye(3)), reduced, curvature)
    inputs = [c, p, ca.vec(R)]
    return Likelihood(
        value=ca.Function("value", inputs, [-logp]),
        gradient=ca.Function("gradient", inputs, [R @ mean]),
        curvature=ca.Function("curvature", inputs, [R @ curvature @ R.T]),
    )


def _definite(M: ca.SX) -> ca.SX:
    """Whether a symmetric 3x3 matrix is positive definite, by Sylvester's minors."""
    first, second = M[0, 0], M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0]
    return ca.logic_and(first > 0, ca.logic_and(second > 0, ca.det(M) > 0))
