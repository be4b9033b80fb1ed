"""Support regions: the CoM positions at which the contacts can hold or accelerate the robot, by exact projection.

A CoM at ``c = (x, y, z)`` with acceleration ``a`` and constant angular momentum requires the wrench

    w = m (h, c x h),   h = a - g

which is affine in ``(x, y)``. It is feasible if ``A w <= 0`` for all facets of the wrench cone: half-planes, whose
intersection is the region, for contacts at any heights and slopes, including hands. At rest neither ``z`` nor the mass
matters. With inscribed pyramids the polygon is a subset of the region of the circular cones, with circumscribed ones a
superset. For level soles it is their horizontal convex hull, unless one is so far above another that they lie in each
other's friction cones; hands and slopes change it. (Bretl & Lall 2008 project by linear programs, and so do the tests.)

At rest the region contains the hull of the points that could support the weight alone. A certificate decides without
projection whether the hull is the whole region for circular cones: for the edge from ``p_1`` to ``p_2`` with outward
unit vector ``d`` and ``nu = -(z_2 - z_1) / |p_2 - p_1|`` (horizontal length), no CoM beyond the edge is feasible if

    a_i f <= 0  for all f in the cone of point i,   a_i = (nu (p_i - p_1)^perp - (z_i - z_1) d,  d (p_i - p_1)).

Then ``d c - d p_1 = sum a_i f_i`` up to terms that vanish by the balance of forces and of the vertical moment. By
linear duality, the condition is also necessary for an edge between two soles.
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
"""Half edge of the square about the mean of the contacts that bounds every region."""
CUT_TOLERANCE_M: Final = 1e-7
"""Half-planes that would cut off less than this are ignored."""
ZERO_ACCELERATION: Final = np.zeros(3)
ZERO_ACCELERATION.flags.writeable = False

Vector2 = Float[np.ndarray, "2"]
Outline = Float[np.ndarray, "_ 2"]
"""Counter-clockwise vertices; no rows for an empty area."""


@dataclass(frozen=True, eq=False)
class SupportRegion:
    """Inner and outer polygons (``inside_m``, ``around_m``) of the region of the circular cones."""

    inside_m: Outline
    around_m: Outline


def support_region(
    contacts: PointContacts, n_rays: int = 8, acceleration_m_s2: Vector3 = ZERO_ACCELERATION, height_m: float = 0.0
) -> SupportRegion:
    """Inner and outer bound; ``height_m`` is the z of the CoM, which matters for horizontal accelerations.

    Raises ``NotEstimable`` (``wrench-cone-not-pointed``) if contacts can squeeze each other.
    """
    inside, around = (
        com_region_m(contacts, n_rays, side, acceleration_m_s2, height_m) for side in ("inside", "around")
    )
    return SupportRegion(inside, around)


def rest_region_m(contacts: PointContacts) -> Outline:
    """Support region at rest: exact if the hull is certified, otherwise from inscribed pyramids.

    Raises as ``support_region``.
    """
    hull = certified_hull_m(contacts)
    return com_region_m(contacts, N_RAYS) if hull is None else hull


def com_region_m(
    contacts: PointContacts,
    n_rays: int = 4,
    side: Side = "inside",
    acceleration_m_s2: Vector3 = ZERO_ACCELERATION,
    height_m: float = 0.0,
) -> Outline:
    """The exact region for pyramids of ``n_rays``. Raises as ``support_region``."""
    cone = LinearCone.from_contacts(contacts, n_rays, side)
    if cone.dimension < 5:
        return np.zeros((0, 2))  # two hands: the region has no area
    h = acceleration_m_s2 - g
    about = contacts.position_m.mean(axis=0)
    axes = np.cross(np.eye(3), h)
    start = np.concatenate([h, np.cross([about[0], about[1], height_m], h)])
    lines = cone.facets[:, 3:] @ axes[:2].T
    offsets = -cone.facets @ start
    return np.asarray(intersect_half_planes(lines, offsets, FAR_M) + about[:2])


def intersect_half_planes(
    normals: Float[np.ndarray, "n 2"], offsets: Float[np.ndarray, "n"], half_edge_m: float
) -> Outline:
    """The polygon ``normals x <= offsets`` in a square of half edge ``half_edge_m``; cuts the worst violation first."""
    length = np.linalg.norm(normals, axis=1)
    nonzero = length > 0.0
    if (offsets[~nonzero] < 0.0).any():
        return np.zeros((0, 2))
    normals, offsets = normals[nonzero] / length[nonzero, np.newaxis], offsets[nonzero] / length[nonzero]
    polygon = half_edge_m * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    while len(polygon) > 2:
        beyond = polygon @ normals.T - offsets
        worst = int(beyond.max(axis=0).argmax())
        if beyond[:, worst].max() <= CUT_TOLERANCE_M:
            return polygon
        polygon = _cut_polygon(polygon, beyond[:, worst])
    return np.zeros((0, 2))


def certified_hull_m(contacts: PointContacts) -> Outline | None:
    """The hull of the points that could support the weight alone; None if the certificate (see above) fails."""
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
    perpendicular = np.stack([-away[..., 1], away[..., 0]], axis=2)
    across = (-edge[:, 2] / length)[:, np.newaxis, np.newaxis] * perpendicular - away[..., 2:] * d[:, np.newaxis]
    a = np.concatenate([across, np.einsum("enk,ek->en", away[..., :2], d)[..., np.newaxis]], axis=2)
    local = np.einsum("enk,nkj->enj", a, contacts.rotation)
    most = local[..., 2] + contacts.friction * np.hypot(local[..., 0], local[..., 1])
    return first[:, :2] if most.max() <= CUT_TOLERANCE_M else None


def area_m2(polygon: Outline) -> float:
    """Area by the shoelace formula."""
    x, y = polygon.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2.0


def _cut_polygon(polygon: Outline, beyond: Float[np.ndarray, "_"]) -> Outline:
    """Clip a convex polygon at a line; ``beyond`` is the signed distance of every vertex."""
    vertices: list[Vector2] = []
    for k, (vertex, d) in enumerate(zip(polygon, beyond, strict=True)):
        following, e = polygon[(k + 1) % len(polygon)], beyond[(k + 1) % len(polygon)]
        if d <= 0.0:
            vertices.append(vertex)
        if d * e < 0.0:
            vertices.append(vertex + d / (d - e) * (following - vertex))
    return np.array(vertices).reshape(-1, 2)
