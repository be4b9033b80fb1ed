"""The outer Lorentz cone of the thesis around the rays (4.4.2), which alpha shrinks to an inner one (4.4.3).

    (i)    d: the point nearest to the mean of the unit rays with  Lambda^T d > 0          (4.18)
    (ii)   the smallest ellipsoid around the rays' points in  d y = 1                      (4.19)
    (iii)  d*: the axis about which that cone is centred, the eigenvector of its quadratic form with eigenvalue < 0
    (iv)   the smallest ellipsoid about d* around the rays' points in  d* y = 1

The steps use the Euclidean geometry of R^6, which mixes newtons and newton metres about one point: other units, or
another point, give another cone. Step (iv) fixes the centre, which invalidates the guarantee of 4.4.3 that a fifth of
the ellipsoid lies inside: it is John's theorem for the ellipsoid of step (ii).
"""

from typing import Final

import numpy as np
from scipy.optimize import nnls

from stridelab.contacts.barrier_method import Vector
from stridelab.contacts.wrench_cones.contact_points import Rays
from stridelab.contacts.wrench_cones.ellipsoids import smallest_around
from stridelab.contacts.wrench_cones.wrench_cone import RANK_TOLERANCE, LorentzCone
from stridelab.errors import NotEstimable

MIN_PROJECTION: Final = 1e-3
"""Minimum ``Lambda^T d`` of unit rays in (4.18b)."""


def outer_cone(rays: Rays) -> LorentzCone:
    """The thesis' cone with alpha = 1 around all rays (4.17b), in the units and about the point of the rays.

    Raises ``NotEstimable`` (``thesis-cone-undefined``) if the rays do not span six dimensions, if no half-space
    contains them, or if the axis of step (iii) excludes a ray.
    """
    unit = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    if np.linalg.svd(unit, compute_uv=False)[-1] < RANK_TOLERANCE:
        raise NotEstimable("thesis-cone-undefined", "the rays span fewer than six dimensions")
    first = _cone_around(unit, _first_direction(unit), centred=False)
    M = first.to_standard
    quadratic = M[:5].T @ M[:5] - np.outer(M[5], M[5])
    axis = np.linalg.eigh(quadratic)[1][:, 0]
    axis = axis * np.sign(axis @ unit.mean(axis=0))
    if (unit @ axis).min() <= 0.0:
        raise NotEstimable("thesis-cone-undefined", "the axis of step (iii) excludes a ray")
    return _cone_around(unit, axis, centred=True)


def _first_direction(unit: Rays) -> Vector:
    """Solve (4.18) as a least distance problem (Lawson & Hanson, 23.4)."""
    mean = unit.mean(axis=0)
    lacking = MIN_PROJECTION - unit @ mean
    if lacking.max() <= 0.0:
        return np.asarray(mean / np.linalg.norm(mean))
    rows = np.vstack([unit.T, lacking])
    target = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    weights, missed = nnls(rows, target)
    if missed < RANK_TOLERANCE:
        raise NotEstimable("thesis-cone-undefined", "no half-space contains all rays")
    residual = rows @ weights - target
    d = mean - residual[:6] / residual[6]
    return np.asarray(d / np.linalg.norm(d))


def _cone_around(unit: Rays, d: Vector, *, centred: bool) -> LorentzCone:
    """The cone over the smallest ellipsoid around the points of the rays in ``d y = 1``."""
    basis = np.linalg.svd(d[np.newaxis])[2][1:]
    points = unit / (unit @ d)[:, np.newaxis] @ basis.T
    around = smallest_around(points, centred=centred)
    return LorentzCone(
        np.vstack([np.linalg.solve(around.axes, basis - np.outer(around.center, d)), d]),
        5,
    )
