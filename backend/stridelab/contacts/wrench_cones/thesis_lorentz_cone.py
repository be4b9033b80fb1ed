"""The thesis' four steps to a Lorentz cone around the rays (4.4.2), to be shrunk by alpha into them (4.4.3).

    (i)    d: the point nearest to the mean of the unit rays with  Lambda^T d > 0          (4.18)
    (ii)   the smallest ellipsoid around the rays' points in  d y = 1                      (4.19)
    (iii)  d*: the axis about which that cone is centred, the eigenvector of its quadratic form with eigenvalue < 0
    (iv)   the smallest ellipsoid about d* around the rays' points in  d* y = 1

It works in the Euclidean geometry of R^6, that is in newtons beside newton metres about one point: other units, or
another point, give another cone. Step (iv) fixes the centre, and with it goes the guarantee of 4.4.3 that a fifth of
the ellipsoid lies inside, which is John's theorem for the ellipsoid of step (ii).
"""

from typing import Final

import numpy as np
from scipy.optimize import nnls

from stridelab.contacts.barrier_method import Vector
from stridelab.contacts.wrench_cones.contact_points import Rays
from stridelab.contacts.wrench_cones.ellipsoids import smallest_around
from stridelab.contacts.wrench_cones.wrench_cone import FLAT, LorentzCone
from stridelab.errors import NotEstimable

ROOM: Final = 1e-3
"""Least ``Lambda^T d`` of unit rays in (4.18b)."""


def outer_cone(rays: Rays) -> LorentzCone:
    """The thesis' cone of alpha = 1 around all rays (4.17b), about the point and in the units that one chooses.

    Raises ``NotEstimable`` (``thesis-cone-undefined``) where the rays do not span six dimensions, where no half-space
    holds them, and where the axis of step (iii) leaves some ray behind.
    """
    unit = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    if np.linalg.svd(unit, compute_uv=False)[-1] < FLAT:
        raise NotEstimable("thesis-cone-undefined", "the rays span less than six dimensions")
    first = _around(unit, _first_direction(unit), centred=False)
    M = first.to_standard
    quadratic = M[:5].T @ M[:5] - np.outer(M[5], M[5])
    axis = np.linalg.eigh(quadratic)[1][:, 0]
    axis = axis * np.sign(axis @ unit.mean(axis=0))
    if (unit @ axis).min() <= 0.0:
        raise NotEstimable("thesis-cone-undefined", "the axis of step (iii) leaves a ray behind")
    return _around(unit, axis, centred=True)


def _first_direction(unit: Rays) -> Vector:
    """(4.18) as a least-distance programme (Lawson & Hanson, 23.4)."""
    mean = unit.mean(axis=0)
    lacking = ROOM - unit @ mean
    if lacking.max() <= 0.0:
        return np.asarray(mean / np.linalg.norm(mean))
    rows = np.vstack([unit.T, lacking])
    target = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    weights, missed = nnls(rows, target)
    if missed < FLAT:
        raise NotEstimable("thesis-cone-undefined", "no half-space holds all rays")
    residual = rows @ weights - target
    d = mean - residual[:6] / residual[6]
    return np.asarray(d / np.linalg.norm(d))


def _around(unit: Rays, d: Vector, *, centred: bool) -> LorentzCone:
    """The cone over the smallest ellipsoid around the rays' points in ``d y = 1``."""
    basis = np.linalg.svd(d[np.newaxis])[2][1:]
    points = unit / (unit @ d)[:, np.newaxis] @ basis.T
    around = smallest_around(points, centred=centred)
    return LorentzCone(
        np.vstack([np.linalg.solve(around.axes, basis - np.outer(around.center, d)), d]),
        5,
    )
