"""Numerical validation of the wrench cones of section 4.4 on random contact sets."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from stridelab.contacts.wrench_cones.contact_points import PointContacts, wrench_transform
from stridelab.contacts.wrench_cones.thesis_lorentz_cone import outer_cone
from stridelab.contacts.wrench_cones.wrench_cone import N_RAYS, LinearCone, LorentzCone, Wrenches
from stridelab.contacts.wrench_cones.wrench_feasibility import linear_margin
from stridelab.errors import NotEstimable
from stridelab.reproduction.studies.random_contact_sets import com_m, random_contacts

REFERENCE_SHIFT_M = np.array([3.0, -40.0, 7.0])
MILLIMETRES = 1000.0
FINE_RAYS = 16
"""Rays of the inner pyramids that stand for the circular cones; four rays are not the cone."""
ROUNDING = 1e-9
"""Relative margin below which a boundary point counts as outside."""


@dataclass(frozen=True)
class Timed:
    """Processor time of a computation."""

    time_s: float


@dataclass(frozen=True)
class ConeCheck:
    """Measurements on one contact set.

    ``violation`` is the largest facet violation in closed form, ``least_margin`` the smallest LP margin of the boundary
    points relative to the wrench norm, ``change`` the change of the gauge under another reference point and unit of
    length. ``volume_ratio`` and ``thesis_volume_ratio`` are section volumes of the largest cone and of the thesis' cone
    with alpha = 0.3, relative to the pyramids with four rays; ``alpha_max`` is the largest alpha for which the thesis'
    cone stays inside the circular cones, as pyramids of ``FINE_RAYS`` (NaN if undefined).
    """

    bodies: int
    dimension: int
    facets: int
    violation: float
    least_margin: float
    change: float
    volume_ratio: float
    thesis_volume_ratio: float
    alpha_max: float
    time_s: float


def check_cone(contacts: PointContacts, bodies: int, points: int, rng: np.random.Generator) -> ConeCheck:
    """Check the largest cone of one contact set at ``points`` boundary points by linear programs.

    Half of the points are those closest to a facet, the others random.
    """
    linear = LinearCone.from_contacts(contacts)
    cone, took = timed_cone(lambda: LinearCone.from_contacts(contacts).largest_lorentz())
    nearest = np.argsort(-cone.facet_supports(linear.facets).sum(axis=1) / np.linalg.norm(linear.facets, axis=1))
    worst = cone.nearest_to_facets(linear.facets[nearest[: points // 2]])
    boundary = np.vstack([worst, cone.boundary_wrenches(rng.normal(size=(points - len(worst), cone.dimension)))])
    margins = [linear_margin(contacts, y, N_RAYS).margin_n / np.linalg.norm(y) for y in boundary]
    pyramids = LinearCone.from_contacts(contacts, 4)
    try:
        thesis = thesis_cone(contacts)
        alpha_max = LinearCone.from_contacts(contacts, FINE_RAYS).alpha_max(thesis)
        kept_thesis = pyramids.volume_ratio(thesis.shrink(0.3))
    except NotEstimable:
        alpha_max, kept_thesis = np.nan, np.nan
    return ConeCheck(
        bodies,
        linear.dimension,
        len(linear.normals),
        linear.violation(cone),
        float(min(margins)),
        _gauge_change(contacts, boundary),
        pyramids.volume_ratio(cone),
        kept_thesis,
        alpha_max,
        took.time_s,
    )


def timed_cone(compute: Callable[[], LorentzCone]) -> tuple[LorentzCone, Timed]:
    """Compute a cone and its processor time."""
    start = time.process_time()
    cone = compute()
    return cone, Timed(time.process_time() - start)


def thesis_cone(contacts: PointContacts) -> LorentzCone:
    """The thesis' outer cone, computed about the CoM in N and N m, for wrenches about the origin."""
    there = wrench_transform(-com_m(contacts))
    return outer_cone(contacts.wrench_rays(4) @ there.T).in_frame(there)


def check_cones(sets: int, points: int, seed: int = 0) -> list[ConeCheck]:
    """Check ``sets`` random contact sets with two, three and four bodies alternately."""
    rng = np.random.default_rng(seed)
    return [check_cone(random_contacts(rng, 2 + k % 3), 2 + k % 3, points, rng) for k in range(sets)]


def check_summary(checks: list[ConeCheck]) -> Mapping[str, int | float]:
    """Summary statistics of the checks."""
    ratios = np.array(
        [check.volume_ratio / check.thesis_volume_ratio for check in checks if np.isfinite(check.alpha_max)]
    )
    alphas = np.array([check.alpha_max for check in checks if np.isfinite(check.alpha_max)])
    return {
        "sets": len(checks),
        "facets_violated": sum(check.violation > 0.0 for check in checks),
        "largest_violation": max(check.violation for check in checks),
        "points_outside": sum(check.least_margin < -ROUNDING for check in checks),
        "least_margin": min(check.least_margin for check in checks),
        "largest_change": max(check.change for check in checks),
        "median_kept": float(np.median([check.volume_ratio for check in checks])),
        "median_kept_over_thesis": float(np.median(ratios)),
        "thesis_undefined": len(checks) - len(alphas),
        "share_where_0.2_leaves": float((alphas < 0.2).mean()),
        "share_where_0.3_leaves": float((alphas < 0.3).mean()),
        "least_alpha_max": float(alphas.min()),
        "median_alpha_max": float(np.median(alphas)),
        "median_time_3_bodies_ms": 1e3 * float(np.median([check.time_s for check in checks if check.bodies == 3])),
    }


def _gauge_change(contacts: PointContacts, boundary: Wrenches) -> float:
    there = LinearCone.from_contacts(contacts.in_frame(REFERENCE_SHIFT_M, MILLIMETRES)).largest_lorentz()
    return float(np.abs(there.gauge(boundary @ wrench_transform(REFERENCE_SHIFT_M, MILLIMETRES).T) - 1.0).max())
