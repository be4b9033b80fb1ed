"""Facets of the linear wrench cone of a contact set, and Lorentz cones inside it.

Section. With a functional ``d`` that is positive on all rays, the cone is the cone over the polytope of the points
``x = X y / (d y)``. ``d`` is the vertical force (the mean force direction if some ray does not point up). It depends
only on forces, neither on the reference point nor on the unit of length, so that the section in another frame is an
affine image of this one: ratios of volumes and the largest ellipsoid are invariant.

A Lorentz cone (4.16) is the image of the standard one (4.14), ``{y : M y = (tau, eta, 0), |tau| <= eta}`` with ``M``
square and invertible; where the rays span less than six dimensions the last rows of ``M`` vanish on them. It lies in
the half-space ``a y <= 0`` if, with ``a M^-1 = (r, s, .)``,

    |r| + s <= 0,    and shrunk by alpha (tau <= alpha eta) as far as   alpha_max = min -s / |r|.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.optimize import nnls
from scipy.spatial import ConvexHull, QhullError

from stridelab.contacts.barrier_method import Matrix, Vector
from stridelab.contacts.wrench_cones.contact_points import PointContacts, Rays, Side, wrench_transform
from stridelab.contacts.wrench_cones.ellipsoids import Cloud, Ellipsoid, largest_inside
from stridelab.conventions import Vector3
from stridelab.errors import NotEstimable

N_RAYS: Final = 5
"""Rays per pyramid; five cover 0.76 of the circular cone, four 0.64 and six 0.83."""
RANK_TOLERANCE: Final = 1e-9
"""Singular values below this share of the largest count as zero."""
JOGGLE: Final = 1e-8
"""Upper bound of the shift of a facet of a whitened section by qhull's joggle (observed: 2e-10 to 4e-10)."""
MIN_PROJECTION: Final = 0.02
"""Minimum projection of every unit force onto the normal of the section."""

Facets = Float[np.ndarray, "facets 6"]
Square = Float[np.ndarray, "6 6"]
Wrenches = Float[np.ndarray, "n 6"]


@dataclass(frozen=True, eq=False)
class LorentzCone:
    """``{y : to_standard y = (tau, eta, 0), |tau| <= eta}`` with ``tau`` of ``dimension`` entries."""

    to_standard: Square
    dimension: int

    def shrink(self, alpha: float) -> "LorentzCone":
        """``|tau| <= alpha eta``: the thesis' inner cones (4.4.3)."""
        scaled = self.to_standard.copy()
        scaled[: self.dimension] /= alpha
        return LorentzCone(scaled, self.dimension)

    def in_frame(self, change: Square) -> "LorentzCone":
        """The same cone in the coordinates that ``change`` maps to those of this one."""
        return LorentzCone(self.to_standard @ change, self.dimension)

    def gauge(self, wrenches: Wrenches) -> Float[np.ndarray, "n"]:
        """``|tau| / eta``: at most 1 inside, infinite where ``eta <= 0``."""
        y = wrenches @ self.to_standard.T
        k = self.dimension
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(y[:, k] > 0.0, np.linalg.norm(y[:, :k], axis=1) / y[:, k], np.inf)

    def boundary_wrenches(self, directions: Float[np.ndarray, "n d"]) -> Wrenches:
        """Wrenches on the boundary with ``eta = 1``, in the directions ``tau``."""
        unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        y = np.zeros((len(unit), 6))
        y[:, : self.dimension], y[:, self.dimension] = unit, 1.0
        return np.asarray(np.linalg.solve(self.to_standard, y.T).T)

    def section_ellipsoid(self, lift: Float[np.ndarray, "6 k_plus_1"]) -> Ellipsoid | None:
        """The ellipsoid of points ``x`` with ``lift (x, 1)`` in the cone; None if empty or unbounded."""
        rows, d = self.to_standard @ lift, self.dimension
        P, q, r, s = rows[:d, :-1], rows[:d, -1], rows[d, :-1], rows[d, -1]
        H, h = P.T @ P - np.outer(r, r), P.T @ q - s * r
        if np.linalg.eigvalsh(H)[0] <= 0.0:
            return None
        center = -np.linalg.solve(H, h)
        level = float(s * s - q @ q - h @ center)
        if level <= 0.0:
            return None
        return Ellipsoid(center, math.sqrt(level) * np.linalg.inv(np.linalg.cholesky(H)).T)

    def nearest_to_facets(self, facets: Facets) -> Wrenches:
        """The boundary wrench (``eta = 1``) closest to leaving each half-space."""
        return self.boundary_wrenches(np.linalg.solve(self.to_standard.T, facets.T).T[:, : self.dimension])

    def facet_supports(self, facets: Facets) -> Float[np.ndarray, "facets 2"]:
        """``(|r|, s)`` of every facet; the maximum of ``a y`` on ``eta = 1`` is ``|r| + s``."""
        rows = np.linalg.solve(self.to_standard.T, facets.T).T
        k = self.dimension
        return np.stack([np.linalg.norm(rows[:, :k], axis=1), rows[:, k]], axis=1)


@dataclass(frozen=True, eq=False)
class LinearCone:
    """The cone (4.7) over rays, with its whitened section ``d y = 1``.

    ``to_section`` ``(6, 6)`` maps a wrench to ``(x d y, d y, 0)``; ``normals x <= offsets`` are the facets of the
    polytope, ``volume`` its volume in these coordinates (only ratios are meaningful).
    """

    rays: Rays
    to_section: Square
    dimension: int
    normals: Float[np.ndarray, "facets d"]
    offsets: Float[np.ndarray, "facets"]
    volume: float

    @staticmethod
    def from_contacts(contacts: PointContacts, n_rays: int = N_RAYS, side: Side = "inside") -> "LinearCone":
        """Create from the pyramids of the contacts; facets by qhull.

        Raises ``NotEstimable``: ``wrench-cone-not-pointed`` if contact forces can cancel each other (a grip from
        opposite sides), so that no section is bounded; ``wrench-cone-flat`` if friction or distances are so small that
        the section is degenerate.
        """
        center = contacts.position_m.mean(axis=0)
        spread = float(np.sqrt(((contacts.position_m - center) ** 2).sum(axis=1).mean()))
        own = wrench_transform(
            -center, 1.0 / spread if spread > RANK_TOLERANCE * (1.0 + np.linalg.norm(center)) else 1.0
        )
        rays = contacts.wrench_rays(n_rays, side)
        own_rays = rays @ own.T
        d = np.concatenate([_section_normal(own_rays[:, :3]), np.zeros(3)])
        points = own_rays / (own_rays @ d)[:, np.newaxis]
        middle = points.mean(axis=0)
        _, spreads, axes = np.linalg.svd(points - middle)
        k = int((spreads > RANK_TOLERANCE * spreads[0]).sum())
        if k < 2 or spreads[0] < RANK_TOLERANCE:
            raise _flat_cone_error()
        whiten = axes[:k] * (math.sqrt(len(points)) / spreads[:k, np.newaxis])
        x = (points - middle) @ whiten.T
        normals, offsets, volume = _hull_facets(x)
        to_section = (
            np.vstack([whiten - np.outer(whiten @ middle, d), d, _orthogonal_functionals(whiten, middle)]) @ own
        )
        return LinearCone(rays, to_section, k, normals, offsets, volume)

    @cached_property
    def facets(self) -> Facets:
        """Rows ``a`` with ``a y <= 0`` on the cone, wrenches about the world origin."""
        k = self.dimension
        return np.asarray(np.hstack([self.normals, -self.offsets[:, np.newaxis]]) @ self.to_section[: k + 1])

    def lorentz_cone_over(self, ellipsoid: Ellipsoid) -> LorentzCone:
        """The cone over an ellipsoid in the section (4.15)."""
        M, k = self.to_section.copy(), self.dimension
        M[:k] = np.linalg.solve(ellipsoid.axes, M[:k] - np.outer(ellipsoid.center, M[k]))
        return LorentzCone(M, k)

    def largest_lorentz(self) -> LorentzCone:
        """The Lorentz cone inside whose section has the largest volume."""
        return self.lorentz_cone_over(largest_inside(self.normals, self.offsets))

    def alpha_max(self, cone: LorentzCone) -> float:
        """Largest alpha with ``cone.shrink(alpha)`` inside this cone; 0 if the axis of ``cone`` is outside."""
        r, s = cone.facet_supports(self.facets).T
        return float(max(0.0, (-s / r).min()))

    def violation(self, cone: LorentzCone) -> float:
        """Maximum of ``(|r| + s) / |s|`` over all facets; not positive if ``cone`` is inside."""
        r, s = cone.facet_supports(self.facets).T
        return float(((r + s) / np.abs(s)).max())

    def volume_ratio(self, cone: LorentzCone) -> float:
        """Ratio of the volume of the section of ``cone`` to that of this cone; infinite if unbounded."""
        k = self.dimension
        section = cone.section_ellipsoid(np.linalg.inv(self.to_section)[:, : k + 1])
        if section is None:
            return math.inf
        ball = math.pi ** (k / 2) / math.gamma(k / 2 + 1)
        return float(ball * abs(np.linalg.det(section.axes)) / self.volume)


def _section_normal(forces: Float[np.ndarray, "rays 3"]) -> Vector3:
    """A direction with a positive projection of every force: up, or the point of the unit forces' hull nearest to 0."""
    unit = forces / np.linalg.norm(forces, axis=1, keepdims=True)
    if unit[:, 2].min() > MIN_PROJECTION:
        return np.array([0.0, 0.0, 1.0])
    weights, _ = nnls(np.vstack([unit.T, np.ones(len(unit))]), np.array([0.0, 0.0, 0.0, 1.0]))
    mean = weights @ unit
    direction = mean / max(float(np.linalg.norm(mean)), RANK_TOLERANCE)
    if (unit @ direction).min() < MIN_PROJECTION:
        raise NotEstimable("wrench-cone-not-pointed", "forces of these contacts can cancel: their cone is not pointed")
    return np.asarray(direction)


def _hull_facets(points: Cloud) -> tuple[Matrix, Vector, float]:
    """Normals, offsets and volume of a hull; simplices of the same facet are merged.

    The rays of a sole form parallelograms in the section. If rounding prevents qhull from merging their simplices, it
    runs again with joggled input, and the facets are moved inwards by more than the joggle.
    """
    try:
        hull, digits, inwards = ConvexHull(points, qhull_options="Qt Qx" if points.shape[1] > 4 else "Qt"), 9, 0.0
    except QhullError:
        try:
            hull, digits, inwards = ConvexHull(points, qhull_options="QJ"), 7, JOGGLE
        except QhullError as error:
            raise _flat_cone_error() from error
    equations = hull.equations[np.unique(hull.equations.round(digits), axis=0, return_index=True)[1]]
    return equations[:, :-1].copy(), -equations[:, -1] - inwards, float(hull.volume)


def _flat_cone_error() -> NotEstimable:
    return NotEstimable("wrench-cone-flat", "the wrenches of these contacts are numerically indistinguishable")


def _orthogonal_functionals(
    whiten: Float[np.ndarray, "d 6"], middle: Float[np.ndarray, "6"]
) -> Float[np.ndarray, "rest 6"]:
    """Linear functionals that vanish on all rays."""
    spanned = np.vstack([whiten / np.linalg.norm(whiten, axis=1, keepdims=True), middle / np.linalg.norm(middle)])
    return np.asarray(np.linalg.svd(spanned)[2][len(spanned) :])
