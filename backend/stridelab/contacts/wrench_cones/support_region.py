"""Where the CoM can be while the contacts hold the robot still, or accelerate it: the exact projection.

A CoM at ``c = (x, y, z)`` that accelerates by ``a``, its angular momentum constant, asks for the wrench

    w = m (h, c x h),   h = a - g

which is affine in ``(x, y)``. It can be held if ``A w <= 0`` for all facets of the cone of wrenches: half-planes, whose
intersection is the region, for contacts at any heights and slopes, hands included. At rest neither ``z`` nor the mass
matters. With pyramids inside the friction cones the polygon lies in the region of the circular ones, with pyramids
around them it holds it. Of level soles it is the hull seen from above, unless one is so far above another that
they lie in each other's friction cones; hands and slopes change it. (Bretl & Lall 2008 project by
linear programmes; the tests do.)

At rest the hull of the points that could bear the weight alone always lies in the region. Whether it is all of it,
with circular cones, a certificate decides without projecting: for the edge from ``p_1`` to ``p_2`` with the unit vector
``d`` outwards and ``nu = -(z_2 - z_1) / |p_2 - p_1|`` (seen from above), no CoM is held beyond the edge if

    a_i f <= 0  for all f in the cone of point i,   a_i = (nu (p_i - p_1)^perp - (z_i - z_1) d,  d (p_i - p_1)).

For then ``d c - d p_1 = sum a_i f_i`` minus terms that the balance of forces and of the moment about the vertical make
zero. It is all that linear duality allows for an edge between two soles, so nothing is given away.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull, QhullError

from stridelab.contacts.wrench_cones.contact_points import PointContacts, Side
from stridelab.contacts.wrench_cones.wrench_cone import N_RAYS, LinearCone
from stridelab.conventions import Vector3, g

FAR_M: Final = 10.0
"""A region that reaches farther than this from the middle of the contacts is cut there."""
SHARP_M: Final = 1e-7
"""Half-planes that cut off less than this leave the polygon as it is."""
REST: Final = np.zeros(3)
REST.flags.writeable = False

Vector2 = Float[np.ndarray, "2"]
Outline = Float[np.ndarray, "_ 2"]
"""Vertices counter-clockwise; no rows where there is no area."""


@dataclass(frozen=True, eq=False)
class SupportRegion:
    """The region of the circular cones between two polygons: ``inside_m`` lies in it, ``around_m`` holds it."""

    inside_m: Outline
    around_m: Outline


def support_region(
    contacts: PointContacts, n_rays: int = 8, acceleration_m_s2: Vector3 = REST, height_m: float = 0.0
) -> SupportRegion:
    """Both bounds; ``height_m`` is the CoM's z, which matters where it accelerates sideways.

    Raises ``NotEstimable`` (``wrench-cone-not-pointed``) where contacts can squeeze each other.
    """
    inside, around = (
        com_region_m(contacts, n_rays, side, acceleration_m_s2, height_m) for side in ("inside", "around")
    )
    return SupportRegion(inside, around)


def rest_region_m(contacts: PointContacts) -> Outline:
    """Where the CoM can rest: exact where the hull is certified, else from pyramids inside the friction cones.

    Raises as ``support_region``.
    """
    hull = certified_hull_m(contacts)
    return com_region_m(contacts, N_RAYS) if hull is None else hull


def com_region_m(
    contacts: PointContacts,
    n_rays: int = 4,
    side: Side = "inside",
    acceleration_m_s2: Vector3 = REST,
    height_m: float = 0.0,
) -> Outline:
    """The polygon for pyramids of ``n_rays``; exact for them. Raises as ``support_region``."""
    cone = LinearCone.of(contacts, n_rays, side)
    if cone.dimension < 5:
        return np.zeros((0, 2))  # two hands: the CoM is held above a line at most
    h = acceleration_m_s2 - g
    about = contacts.position_m.mean(axis=0)
    axes = np.cross(np.eye(3), h)
    start = np.concatenate([h, np.cross([about[0], about[1], height_m], h)])
    lines = cone.facets[:, 3:] @ axes[:2].T
    offsets = -cone.facets @ start
    return np.asarray(intersection(lines, offsets, FAR_M) + about[:2])


def intersection(normals: Float[np.ndarray, "n 2"], offsets: Float[np.ndarray, "n"], far: float) -> Outline:
    """The polygon ``normals x <= offsets`` in a square of half edge ``far``, cut where it sticks out most."""
    length = np.linalg.norm(normals, axis=1)
    turned = length > 0.0
    if (offsets[~turned] < 0.0).any():
        return np.zeros((0, 2))
    normals, offsets = normals[turned] / length[turned, np.newaxis], offsets[turned] / length[turned]
    polygon = far * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    while len(polygon) > 2:
        beyond = polygon @ normals.T - offsets
        worst = int(beyond.max(axis=0).argmax())
        if beyond[:, worst].max() <= SHARP_M:
            return polygon
        polygon = _cut(polygon, beyond[:, worst])
    return np.zeros((0, 2))


def certified_hull_m(contacts: PointContacts) -> Outline | None:
    """The hull of the points that could bear the weight alone, None where more might be held (see above)."""
    p, normals = contacts.position_m, contacts.rotation[:, :, 2]
    bearing = p[np.hypot(normals[:, 0], normals[:, 1]) <= contacts.friction * normals[:, 2]]
    if len(bearing) < 3:
        return None
    try:
        hull = ConvexHull(bearing[:, :2])
    except QhullError:
        return None
    first = bearing[hull.vertices]
    edge = np.roll(first, -1, axis=0) - first
    length = np.hypot(edge[:, 0], edge[:, 1])
    d = np.stack([edge[:, 1], -edge[:, 0]], axis=1) / length[:, np.newaxis]
    away = p - first[:, np.newaxis]  # (edges, points, 3)
    turned = np.stack([-away[..., 1], away[..., 0]], axis=2)
    across = (-edge[:, 2] / length)[:, np.newaxis, np.newaxis] * turned - away[..., 2:] * d[:, np.newaxis]
    a = np.concatenate([across, np.einsum("enk,ek->en", away[..., :2], d)[..., np.newaxis]], axis=2)
    local = np.einsum("enk,nkj->enj", a, contacts.rotation)
    most = local[..., 2] + contacts.friction * np.hypot(local[..., 0], local[..., 1])
    return first[:, :2] if most.max() <= SHARP_M else None


def area_m2(polygon: Outline) -> float:
    """The shoelace formula."""
    x, y = polygon.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2.0


def _cut(polygon: Outline, beyond: Float[np.ndarray, "_"]) -> Outline:
    """What of a convex polygon is not beyond a line."""
    kept: list[Vector2] = []
    for k, (vertex, d) in enumerate(zip(polygon, beyond, strict=True)):
        following, e = polygon[(k + 1) % len(polygon)], beyond[(k + 1) % len(polygon)]
        if d <= 0.0:
            kept.append(vertex)
        if d * e < 0.0:
            kept.append(vertex + d / (d - e) * (following - vertex))
    return np.array(kept).reshape(-1, 2)
