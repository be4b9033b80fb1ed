"""The cone of wrenches by its facets, and the largest Lorentz cone inside."""

import numpy as np
import pytest

from stridelab.centroidal.point_forces import pyramid_rays as pyramid
from stridelab.contacts.wrench_cones.contact_points import PointContacts, wrench_transform
from stridelab.contacts.wrench_cones.thesis_lorentz_cone import outer_cone
from stridelab.contacts.wrench_cones.wrench_cone import N_RAYS, LinearCone
from stridelab.contacts.wrench_cones.wrench_feasibility import linear_margin
from stridelab.dynamics.spatial import Placement
from stridelab.errors import InvalidInput, NotEstimable
from stridelab.reproduction.studies.random_contact_sets import com_m, random_contacts

LEVEL = Placement.identity()
SIDE = Placement.from_wxyz((0.0, 0.0, 0.0), (np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0))  # z axis along world x
OTHER_SIDE = Placement.from_wxyz((0.3, 0.0, 0.0), (np.sqrt(0.5), 0.0, -np.sqrt(0.5), 0.0))


def some_sets(count: int, seed: int = 0) -> list[PointContacts]:
    rng = np.random.default_rng(seed)
    return [random_contacts(rng, 2 + k % 3) for k in range(count)]


@pytest.mark.parametrize("n_rays", [3, 4, 8, 32])
def test_pyramids_lie_inside_and_around_the_circle(n_rays: int) -> None:
    hand = PointContacts.from_placements([(Placement.from_wxyz((1.0, 2.0, 3.0), (0.9, 0.1, 0.2, 0.3)), None, 0.6)])
    R = hand.rotation[0]
    inside, around = (hand.pyramid_edges(n_rays, side)[0] @ R for side in ("inside", "around"))
    np.testing.assert_allclose(np.hypot(*inside[:, :2].T), 0.6)
    middles = (around[:, :2] + np.roll(around[:, :2], 1, axis=0)) / 2
    np.testing.assert_allclose(np.hypot(*middles.T), 0.6)
    np.testing.assert_allclose(
        hand.wrench_rays(n_rays)[:, 3:], np.cross(hand.position_m, hand.wrench_rays(n_rays)[:, :3])
    )


def test_four_rays_are_those_of_the_solver() -> None:
    ours = PointContacts.from_placements([(LEVEL, None, 0.7)]).pyramid_edges()[0]
    theirs = pyramid(0.7, 4).T
    assert {tuple(row) for row in ours.round(12)} == {tuple(row) for row in theirs.round(12)}


def test_facets_and_rays_describe_the_same_cone() -> None:
    """No ray violates a facet, every facet holds five rays, and a wrench is inside by facets iff it is by LP. (4.7)."""
    rng = np.random.default_rng(1)
    for contacts in some_sets(6):
        cone = LinearCone.from_contacts(contacts, 4)
        size = np.linalg.norm(cone.facets, axis=1)[:, np.newaxis] * np.linalg.norm(cone.rays, axis=1)
        slack = -(cone.facets @ cone.rays.T) / size
        assert slack.min() > -1e-9
        assert (np.sort(slack, axis=1)[:, cone.dimension - 1] < 1e-8).all()
        for _ in range(6 if cone.dimension == 5 else 0):
            weights = rng.dirichlet(np.full(len(cone.rays), 0.1))
            wrench = weights @ cone.rays + rng.normal(0.0, 0.05, 6)
            by_facets = float((cone.facets @ wrench).max())
            assert (by_facets <= 0.0) == (linear_margin(contacts, wrench, 4).margin_n >= 0.0)


def test_largest_cone_is_inside_by_every_facet_and_by_linear_programmes() -> None:
    """(4.14), (4.16), (4.6)."""
    rng = np.random.default_rng(2)
    for contacts in some_sets(30):
        linear = LinearCone.from_contacts(contacts)
        cone = linear.largest_lorentz()
        assert linear.violation(cone) <= 0.0
        nearest = np.argsort(linear.facets @ cone.boundary_wrenches(np.ones((1, cone.dimension)))[0])[-2:]
        for wrench in [
            *cone.boundary_wrenches(rng.normal(size=(2, cone.dimension))),
            *cone.nearest_to_facets(linear.facets[nearest]),
        ]:
            assert cone.gauge(wrench[np.newaxis])[0] == pytest.approx(1.0)
            assert linear_margin(contacts, wrench, N_RAYS).margin_n >= -1e-9 * np.linalg.norm(wrench)


def test_largest_cone_touches_and_cannot_be_grown() -> None:
    for contacts in some_sets(10):
        linear = LinearCone.from_contacts(contacts)
        cone = linear.largest_lorentz()
        assert linear.violation(cone) > -1e-5
        assert linear.alpha_max(cone) == pytest.approx(1.0, abs=1e-5)
        assert linear.violation(cone.shrink(1.001)) > 0.0


def test_it_keeps_more_than_twice_and_a_half_of_the_thesis_cone() -> None:
    ratios = []
    for contacts in some_sets(45):
        linear, there = LinearCone.from_contacts(contacts), wrench_transform(-com_m(contacts))
        if linear.dimension < 5:
            continue
        outer = outer_cone(contacts.wrench_rays() @ there.T).in_frame(there)
        ratios.append(linear.volume_ratio(linear.largest_lorentz()) / linear.volume_ratio(outer.shrink(0.3)))
    assert np.median(ratios) >= 2.5


@pytest.mark.parametrize(("shift", "scale"), [((3.0, -40.0, 7.0), 1.0), ((0.1, 0.2, 0.3), 1000.0), ((0, 0, 9), 0.3)])
def test_point_and_unit_of_length_do_not_matter(shift: tuple[float, ...], scale: float) -> None:
    rng = np.random.default_rng(3)
    to = wrench_transform(np.array(shift, dtype=float), scale)
    for contacts in some_sets(9):
        here = LinearCone.from_contacts(contacts)
        there = LinearCone.from_contacts(contacts.in_frame(np.array(shift, dtype=float), scale))
        ours, theirs = here.largest_lorentz(), there.largest_lorentz()
        boundary = ours.boundary_wrenches(rng.normal(size=(50, ours.dimension)))
        np.testing.assert_allclose(theirs.gauge(boundary @ to.T), 1.0, atol=1e-6)
        assert there.volume_ratio(theirs) == pytest.approx(here.volume_ratio(ours), rel=1e-6)


@pytest.mark.parametrize("seed", [12, 26, 99])
def test_sections_that_qhull_cannot_merge(seed: int) -> None:
    """Parallelograms of soles that rounding tears apart in another frame: the joggled facets give the same cone."""
    rng = np.random.default_rng(seed)
    contacts, shift = random_contacts(rng, 2), np.array([3.0, -40.0, 7.0])
    ours = LinearCone.from_contacts(contacts).largest_lorentz()
    there = LinearCone.from_contacts(contacts.in_frame(shift, 1000.0))
    theirs = there.largest_lorentz()
    assert there.violation(theirs) < 0.0
    boundary = ours.boundary_wrenches(rng.normal(size=(50, 5))) @ wrench_transform(shift, 1000.0).T
    np.testing.assert_allclose(theirs.gauge(boundary), 1.0, atol=1e-6)


def test_turning_the_world_about_the_vertical_turns_the_cone() -> None:
    turn = Placement.from_wxyz((0.0, 0.0, 0.0), (0.6, 0.0, 0.0, 0.8)).rotation
    rng = np.random.default_rng(4)
    for contacts in some_sets(6):
        turned = PointContacts(contacts.position_m @ turn.T, turn @ contacts.rotation, contacts.friction)
        ours, theirs = (LinearCone.from_contacts(c).largest_lorentz() for c in (contacts, turned))
        y = ours.boundary_wrenches(rng.normal(size=(50, ours.dimension))).reshape(-1, 2, 3) @ turn.T
        np.testing.assert_allclose(theirs.gauge(y.reshape(-1, 6)), 1.0, atol=1e-6)


def test_volumes_against_draws() -> None:
    """Share of a polytope's volume by draws of the rays' simplices: here of the box around the section (4.15)."""
    rng = np.random.default_rng(5)
    contacts = some_sets(1)[0]
    linear = LinearCone.from_contacts(contacts)
    k = linear.dimension
    x_rays = (linear.rays @ linear.to_section.T)[:, : k + 1]
    x_rays = x_rays[:, :k] / x_rays[:, k:]
    low, high = x_rays.min(axis=0), x_rays.max(axis=0)
    x = rng.uniform(low, high, (200_000, k))
    in_polytope = (x @ linear.normals.T <= linear.offsets).all(axis=1)
    padded = np.hstack([x, np.ones((len(x), 1)), np.zeros((len(x), 5 - k))])
    in_cone = linear.largest_lorentz().gauge(np.linalg.solve(linear.to_section, padded.T).T) <= 1.0
    assert not (in_cone & ~in_polytope).any()
    assert linear.volume == pytest.approx(in_polytope.mean() * np.prod(high - low), rel=0.1)
    assert linear.volume_ratio(linear.largest_lorentz()) == pytest.approx(in_cone.sum() / in_polytope.sum(), rel=0.2)


def test_one_hand_is_a_cone_of_three_dimensions() -> None:
    """Its pyramid's section is a square with half diagonal mu; the largest ellipse in it the circle mu / sqrt(2)."""
    contacts = PointContacts.from_placements([(Placement.from_wxyz((1.0, 0.0, 0.0)), None, 0.5)])
    linear = LinearCone.from_contacts(contacts, 4)
    cone = linear.largest_lorentz()
    assert (linear.dimension, len(linear.normals)) == (2, 4)
    assert linear.volume_ratio(cone) == pytest.approx(np.pi / 4, rel=1e-6)
    slope = 0.5 / np.sqrt(2.0)
    force = np.array([0.6 * slope, 0.8 * slope, 1.0])
    wrench = np.concatenate([force, np.cross([1.0, 0.0, 0.0], force)])
    assert cone.gauge(wrench[np.newaxis])[0] == pytest.approx(1.0, abs=1e-6)


def test_two_hands_cannot_turn_about_their_line() -> None:
    contacts = PointContacts.from_placements([(LEVEL, None, 0.5), (Placement.from_wxyz((1.0, 0.0, 0.2)), None, 0.5)])
    linear = LinearCone.from_contacts(contacts)
    cone = linear.largest_lorentz()
    assert linear.dimension == 4
    boundary = cone.boundary_wrenches(np.random.default_rng(0).normal(size=(20, 4)))
    np.testing.assert_allclose(boundary[:, 3:] @ np.array([1.0, 0.0, 0.2]), 0.0, atol=1e-9)
    assert min(linear_margin(contacts, y, N_RAYS).margin_n for y in boundary) >= -1e-9


def test_a_hand_on_a_wall_has_a_section_too() -> None:
    contacts = PointContacts.from_placements([(LEVEL, (0.1, 0.06), 0.5), (SIDE, None, 0.5)])
    linear = LinearCone.from_contacts(contacts)
    cone = linear.largest_lorentz()
    assert linear.violation(cone) <= 0.0
    assert linear.volume_ratio(cone) > 0.1


def test_a_grip_has_no_section() -> None:
    contacts = PointContacts.from_placements([(SIDE, None, 0.5), (OTHER_SIDE, None, 0.5)])
    with pytest.raises(NotEstimable) as raised:
        LinearCone.from_contacts(contacts)
    assert raised.value.code == "wrench-cone-not-pointed"


@pytest.mark.parametrize(
    ("place", "friction"), [((0.0, 0.0, 0.0), 0.0), ((0.0, 0.0, 0.0), -0.3), ((np.nan, 0.0, 0.0), 0.5), (None, 1.0)]
)
def test_what_makes_no_sense_is_refused(place: tuple[float, float, float] | None, friction: float) -> None:
    with pytest.raises(InvalidInput) as raised:
        PointContacts.from_placements([] if place is None else [(Placement.from_wxyz(place), None, friction)])
    assert raised.value.code == "contacts-invalid"
    assert not raised.value.message[0].isupper()
