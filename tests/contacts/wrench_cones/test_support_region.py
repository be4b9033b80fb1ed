"""The region in which contacts can hold a CoM, against linear and conic programmes along directions."""

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

from stridelab.contacts.wrench_cones.contact_points import PointContacts
from stridelab.contacts.wrench_cones.support_region import (
    area_m2,
    certified_hull_m,
    com_region_m,
    rest_region_m,
    support_region,
)
from stridelab.contacts.wrench_cones.wrench_feasibility import conic_margin
from stridelab.conventions import g
from stridelab.dynamics.spatial import Placement
from stridelab.reproduction.studies.random_contact_sets import random_contacts

SOLE = (0.1, 0.06)
FLAT = PointContacts.from_placements(
    [(Placement.from_wxyz((0.0, 0.1, 0.0)), SOLE, 0.5), (Placement.from_wxyz((0.4, -0.1, 0.0)), SOLE, 0.5)]
)
STAIR = PointContacts.from_placements(
    [(Placement.from_wxyz((0.0, 0.1, 0.0)), SOLE, 0.5), (Placement.from_wxyz((0.4, -0.1, 0.2)), SOLE, 0.5)]
)
RAIL = (Placement.from_wxyz((0.3, -0.5, 0.95)), None, 0.4)
WALL = (Placement.from_wxyz((-0.4, 0.0, 1.0), (np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0)), None, 0.6)
ON_RAIL = PointContacts.from_placements(
    [(Placement.from_wxyz((0.0, 0.1, 0.0)), SOLE, 0.5), (Placement.from_wxyz((0.4, -0.1, 0.2)), SOLE, 0.5), RAIL]
)
AT_WALL = PointContacts.from_placements([(Placement.from_wxyz((0.0, 0.1, 0.0)), SOLE, 0.5), WALL])


def farthest_m(contacts: PointContacts, rays: np.ndarray, direction: np.ndarray, h: np.ndarray, z: float) -> float:
    """Largest ``direction (x, y)`` over nonnegative sums of rays, by HiGHS."""
    axes = np.cross(np.eye(3), h)
    result = linprog(
        np.concatenate([np.zeros(len(rays)), -direction]),
        A_eq=np.hstack([rays.T, -np.vstack([np.zeros((3, 2)), axes[:2].T])]),
        b_eq=np.concatenate([h, z * axes[2]]),
        bounds=[(0, None)] * len(rays) + [(None, None)] * 2,
    )
    return -float(result.fun)


@pytest.mark.parametrize("acceleration", [(0.0, 0.0, 0.0), (0.8, -0.5, 0.3)])
@pytest.mark.parametrize("contacts", [FLAT, STAIR, ON_RAIL, AT_WALL], ids=["flat", "stair", "rail", "wall"])
def test_supports_along_directions(contacts: PointContacts, acceleration: tuple[float, float, float]) -> None:
    a, z = np.array(acceleration), 0.9
    polygon = com_region_m(contacts, 4, "inside", a, z)
    assert area_m2(polygon) > 0.0
    for angle in np.linspace(0.0, 2.0 * np.pi, 9)[:-1]:
        u = np.array([np.cos(angle), np.sin(angle)])
        assert (polygon @ u).max() == pytest.approx(farthest_m(contacts, contacts.wrench_rays(), u, a - g, z), abs=1e-6)


def test_level_contacts_hold_in_their_hull() -> None:
    hull = ConvexHull(FLAT.position_m[:, :2])
    result = support_region(FLAT)
    for polygon in (result.inside_m, result.around_m):
        assert area_m2(polygon) == pytest.approx(hull.volume, rel=1e-6)


def test_contacts_at_different_heights_hold_outside_their_hull() -> None:
    """Only where one sees the other in its friction cone, and they can push against each other."""
    hull = ConvexHull(STAIR.position_m[:, :2])
    assert area_m2(com_region_m(STAIR)) == pytest.approx(hull.volume, rel=1e-6)
    high = [(Placement.from_wxyz((0.0, 0.1, 0.0)), SOLE, 0.5), (Placement.from_wxyz((0.15, -0.1, 0.9)), SOLE, 0.5)]
    ladder = PointContacts.from_placements(high)
    assert area_m2(com_region_m(ladder)) > 1.2 * ConvexHull(ladder.position_m[:, :2]).volume


def test_a_hand_widens_the_region() -> None:
    feet, more = com_region_m(STAIR), com_region_m(ON_RAIL)
    assert area_m2(more) > 1.2 * area_m2(feet)


def test_circular_cones_lie_between_the_bounds() -> None:
    """Just inside the inner polygon the margin with circular cones is positive, just outside the outer one negative."""
    result = support_region(ON_RAIL)
    middle = result.inside_m.mean(axis=0)
    assert 0.0 < area_m2(result.inside_m) < area_m2(result.around_m) < 1.2 * area_m2(result.inside_m)
    for polygon, factor, sign in ((result.inside_m, 0.999, 1.0), (result.around_m, 1.001, -1.0)):
        for x, y in middle + factor * (polygon - middle):
            assert sign * conic_margin(ON_RAIL, np.array([0.0, 0.0, 1.0, y, -x, 0.0])).margin_n > 0.0


def test_more_rays_tighten_the_bounds() -> None:
    gaps = []
    for n_rays in (4, 8, 16):
        result = support_region(ON_RAIL, n_rays)
        gaps.append(area_m2(result.around_m) / area_m2(result.inside_m) - 1.0)
    assert gaps[0] > gaps[1] > gaps[2]


def test_moving_everything_moves_the_region() -> None:
    shift = np.array([30.0, -20.0, 5.0])
    near, far = com_region_m(ON_RAIL), com_region_m(ON_RAIL.in_frame(shift))
    # by their support functions: a vertex between two others in line may be left out of either
    turns = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
    directions = np.array([np.cos(turns), np.sin(turns)])
    reached_far, reached_near = ((polygon @ directions).max(axis=0) for polygon in (far - shift[:2], near))
    np.testing.assert_allclose(reached_far, reached_near, atol=1e-6)


def test_what_cannot_stand_has_no_region() -> None:
    """A slope steeper than friction holds; a single hand."""
    steep = Placement.from_wxyz((0.0, 0.0, 0.0), (np.cos(0.35), np.sin(0.35), 0.0, 0.0))
    assert len(com_region_m(PointContacts.from_placements([(steep, SOLE, 0.5)]))) == 0
    assert len(com_region_m(PointContacts.from_placements([RAIL]))) == 0


def test_random_sets_are_outlined_counter_clockwise() -> None:
    rng = np.random.default_rng(0)
    for _ in range(6):
        polygon = com_region_m(random_contacts(rng, 3))
        edges = np.roll(polygon, -1, axis=0) - polygon
        turns = edges[:, 0] * np.roll(edges[:, 1], -1) - edges[:, 1] * np.roll(edges[:, 0], -1)
        assert (turns > -1e-9).all()


def bounds(contacts: PointContacts) -> tuple[float, float]:
    result = support_region(contacts, 12)
    return area_m2(result.inside_m), area_m2(result.around_m)


def test_a_certified_hull_is_the_region_of_circular_cones() -> None:
    """Soles on random slopes and heights: where the hull is certified, pyramids around agree that it is all."""
    rng = np.random.default_rng(4)
    certified = 0
    for _ in range(40):
        soles = []
        for k in range(int(rng.integers(1, 4))):
            tilt, angle = rng.uniform(0.0, 0.3), rng.uniform(0.0, 2.0 * np.pi)
            wxyz = (np.cos(tilt / 2), np.sin(tilt / 2) * np.cos(angle), np.sin(tilt / 2) * np.sin(angle), 0.0)
            at = Placement.from_wxyz(
                (0.35 * k + rng.uniform(-0.1, 0.1), rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2)), wxyz
            )
            soles.append((at, SOLE, float(rng.uniform(0.2, 0.8))))
        contacts = PointContacts.from_placements(soles)
        region = rest_region_m(contacts)
        inside, around = bounds(contacts)
        assert area_m2(com_region_m(contacts, 5)) - 1e-7 <= area_m2(region)
        assert area_m2(region) <= around + 1e-6
        hull = certified_hull_m(contacts)
        if hull is not None:
            certified += 1
            np.testing.assert_array_equal(region, hull)
            assert inside <= area_m2(region) + 1e-7
            # an edge between level soles is exact for any pyramid; slopes leave the inner ones a little short
            assert around == pytest.approx(area_m2(region), rel=0.05)
    assert certified >= 15


@pytest.mark.parametrize("contacts", [FLAT, STAIR], ids=["flat", "stair"])
def test_soles_hold_in_their_hull_and_nowhere_else(contacts: PointContacts) -> None:
    """Beyond every edge no forces in the circular cones hold the weight, and just inside they do."""
    polygon = rest_region_m(contacts)
    middle = polygon.mean(axis=0)
    for corner, following in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        for point in (corner, (corner + following) / 2.0):
            for factor, sign in ((0.999, 1.0), (1.001, -1.0)):
                x, y = middle + factor * (point - middle)
                assert sign * conic_margin(contacts, np.array([0.0, 0.0, 1.0, y, -x, 0.0])).margin_n > 0.0


def test_contacts_that_push_against_each_other_are_not_taken_for_their_hull() -> None:
    ladder = [(Placement.from_wxyz((0.0, 0.1, 0.0)), SOLE, 0.5), (Placement.from_wxyz((0.15, -0.1, 0.9)), SOLE, 0.5)]
    for contacts in (PointContacts.from_placements(ladder), ON_RAIL, AT_WALL):
        hull = ConvexHull(contacts.position_m[:, :2]).volume
        assert area_m2(rest_region_m(contacts)) != pytest.approx(hull, rel=1e-3)
        assert area_m2(rest_region_m(contacts)) == pytest.approx(area_m2(com_region_m(contacts, 5)))
