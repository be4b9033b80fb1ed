"""Figures 4.6 and 4.7, and what is measured on random contact sets."""

from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from stridelab.contacts.wrench_cones.contact_points import PointContacts
from stridelab.contacts.wrench_cones.ellipsoids import Ellipsoid
from stridelab.contacts.wrench_cones.support_region import area_m2
from stridelab.contacts.wrench_cones.thesis_lorentz_cone import outer_cone
from stridelab.contacts.wrench_cones.wrench_cone import LinearCone, LorentzCone
from stridelab.conventions import GRAVITY_M_S2
from stridelab.reproduction.chapter4 import fig_4_6, fig_4_7
from stridelab.reproduction.registry import ITEMS, reproduce_item
from stridelab.reproduction.studies import cone_validation
from stridelab.reproduction.studies.cone_validation import ConeCheck, Timed, check_cones, check_summary, thesis_cone
from stridelab.reproduction.studies.random_contact_sets import random_contacts, random_wrench, stair_sets
from support.recorded_claims import assert_as_recorded


@pytest.fixture(scope="module")
def sets():
    return stair_sets("hrp2")


def test_sections_of_smaller_cones_lie_in_those_of_larger_ones(sets) -> None:
    """Smaller alphas lie in larger ones; all of ours in the pyramids; areas are those of the ellipses."""
    for contacts in sets.values():
        result = fig_4_7.cone_sections(contacts)
        areas = [area_m2(result[f"alpha {alpha:g}"]) for alpha in (1.0, 0.5, 0.3, 0.2)]
        assert areas == sorted(areas, reverse=True)
        assert area_m2(result["alpha 0.3"]) < area_m2(result["largest"]) < area_m2(result["4 rays"]) * 1.1
        assert fig_4_7._share_inside(result["largest"], result["circular"]) == 1.0
        assert fig_4_7._share_inside(result["4 rays"], result["circular"]) > 0.5


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_an_ellipse_is_outlined_counter_clockwise(sense: float) -> None:
    """Its area, pi times its half axes, is positive also if its axes are those of a mirrored circle."""
    ellipse = Ellipsoid(np.array([1.0, 2.0]), np.diag([2.0, 3.0 * sense]))
    cone = Mock(spec=LorentzCone, section_ellipsoid=lambda _: ellipse)
    outline = fig_4_7._lorentz_section(cone, np.eye(6, 3))
    assert area_m2(outline) == pytest.approx(6.0 * np.pi, rel=1e-3)
    assert outline.mean(axis=0) == pytest.approx([1.0, 2.0])
    assert len(outline) == 180, "a corner every two degrees"


def test_a_cone_that_the_plane_misses_has_no_outline() -> None:
    cone = Mock(spec=LorentzCone, section_ellipsoid=lambda _: None)
    assert fig_4_7._lorentz_section(cone, np.eye(6, 3)).shape == (0, 2)


def test_a_sole_on_the_floor_accelerates_as_far_as_its_edge(sets) -> None:
    """Two feet far apart below a low CoM are limited by friction: |c''| <= mu g; the section's corners show it."""
    circular = fig_4_7.cone_sections(sets["2 contacts"])["circular"]
    assert np.hypot(*circular.T).max() <= 0.5 * 9.81 * 1.01


def test_the_table_of_alphas(sets) -> None:
    rows = [fig_4_6.compare_cones(name, contacts) for name, contacts in sets.items()]
    for row in rows:
        assert 0.2 < row.alpha_max < 0.45
        assert row.kept_02 < row.kept_03 < row.kept_ours < 1.0
        assert row.kept_03 == pytest.approx(row.kept_02 * 1.5**5, rel=0.3)
        assert row.excess_of_true > 0.0
        assert 0.0 < row.true_rays_outside < 1.0
        assert row.kept_ours > 2.5 * row.kept_03
    columns = fig_4_6.cone_table(rows)
    assert list(columns["contacts"]) == ["2 contacts", "3 contacts", "4 contacts"]


@pytest.mark.parametrize(("robot", "alphas"), [("hrp2", (0.319, 0.280, 0.296)), ("talos", (0.316, 0.283, 0.278))])
def test_which_alpha_is_safe_on_the_stair(robot: str, alphas: tuple[float, ...]) -> None:
    """As docs/theory/wrench-cones.md says: a fifth is, 0.3 for two feet only."""
    result = [LinearCone.from_contacts(c, 4).alpha_max(thesis_cone(c)) for c in stair_sets(robot).values()]
    assert result == pytest.approx(list(alphas), abs=0.001)


def test_promises_on_random_sets() -> None:
    result = check_summary(check_cones(12, 6, seed=1))
    assert result["sets"] == 12
    assert result["facets_violated"] == result["points_outside"] == 0
    assert result["largest_change"] < 1e-6
    assert result["median_kept_over_thesis"] > 2.0
    assert result["least_alpha_max"] < 0.2


def test_figure_4_7_is_an_item_with_claims_that_are_checked() -> None:
    reported: list[float] = []
    result = reproduce_item("fig-4.7", None, lambda fraction, _: reported.append(fraction))
    assert reported[-1] == 1.0
    verdicts = {claim.key: claim.verdict for claim in result.claims}
    assert verdicts["alpha_03"] == "met"
    assert verdicts["largest_inside"] == verdicts["largest_area"] == "beaten"
    assert result.drawing.startswith("<svg")
    assert "fig-4.6" in ITEMS


def invented_check(alpha: float, kept: float, **measured: float) -> ConeCheck:
    given = {"violation": 0.0, "least_margin": 0.0, "change": 0.0} | measured
    return ConeCheck(3, 6, 20, volume_ratio=kept, thesis_volume_ratio=0.1, alpha_max=alpha, time_s=0.01, **given)


def test_claims_on_random_sets_count_every_set() -> None:
    """Five sets: alpha = 0.2 leaves one, 0.3 three; one facet, one point and one change are wrong."""
    checks = [
        invented_check(0.19, 0.20, violation=1e-3),
        invented_check(0.25, 0.30, least_margin=-1.2e-9),
        invented_check(0.28, 0.25, change=2e-6),
        invented_check(0.31, 0.40, least_margin=-0.9e-9),
        invented_check(0.40, 0.26),
    ]
    timed = Timed(0.01)
    stances = [("2 contacts", 0.30), ("3 contacts", 0.296)]
    rows = [fig_4_6.Row(name, alpha, 0.1, 0.2, 0.3, 0.4, 0.1, 0.2, timed, timed) for name, alpha in stances]
    claims = {claim.key: claim for claim in fig_4_6.figure_claims(rows, checks)}
    assert (claims["alpha_fifth"].ours, claims["alpha_fifth"].cases_inside, claims["alpha_fifth"].n) == (0.2, 4, 5)
    assert (claims["alpha_third"].ours, claims["alpha_third"].cases_inside) == (0.6, 2)
    assert (claims["violations"].ours, claims["violations"].cases_inside) == (2.0, 3)
    assert (claims["change"].ours, claims["change"].cases_inside) == (2e-6, 4)
    assert claims["kept"].ours == pytest.approx(2.6), "median of the ratios to the thesis' cone"
    assert claims["kept"].interval == pytest.approx((2.0, 4.0))
    assert claims["alpha_third_stairs"].verdict == "met", "0.296 is 0.30 to two digits"
    assert_as_recorded("figure 4.6 of invented sets", claims.values())
    assert fig_4_6.undefined_note(checks) == ""
    without = [*checks, invented_check(float("nan"), 0.3), invented_check(float("nan"), 0.4)]
    assert fig_4_6.undefined_note(without).startswith(" 2 of them have no cone")


SQUARE_M_S2 = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def test_the_share_of_an_outline_inside_is_that_of_its_corners() -> None:
    """Rounding errors below a billionth do not count, and an empty outline is inside."""
    corners = np.array([[0.5, 0.5], [1.0, 0.2], [1.0 + 0.8e-9, 0.5], [1.0 + 1.2e-9, 0.5], [0.5, -0.1]])
    assert fig_4_7._share_inside(corners, SQUARE_M_S2) == pytest.approx(3.0 / 5.0)
    assert fig_4_7._share_inside(np.zeros((0, 2)), SQUARE_M_S2) == 1.0


def test_a_section_without_end_is_cut_at_fifty() -> None:
    """One facet, c_x'' <= 2 m/s^2, bounds one side; gravity and friction bound all sections of the figure."""
    lift = fig_4_7._acceleration_to_wrench(np.array([0.3, 0.2, 0.8]))
    facet = Mock(spec=LinearCone, facets=np.array([[1.0, 0.0, -2.0 / GRAVITY_M_S2, 0.0, 0.0, 0.0]]))
    outline = fig_4_7._linear_section(facet, lift)
    assert outline.min(axis=0) == pytest.approx([-50.0, -50.0])
    assert outline.max(axis=0) == pytest.approx([2.0, 50.0])


def test_claims_on_sections_take_the_worst_set() -> None:
    """Two sets of invented squares; the second has no section at alpha = 0.3, whose area counts as a billionth."""

    def outlines(sides: dict[str, float]) -> dict[str, np.ndarray]:
        return {name: side * SQUARE_M_S2 if side else np.zeros((0, 2)) for name, side in sides.items()}

    sides = {"circular": 4.0, "4 rays": 3.9, "alpha 1": 5.0, "alpha 0.5": 4.5, "alpha 0.3": 2.0, "alpha 0.2": 1.0,
             "largest": 3.0}  # fmt: skip
    other = sides | {"circular": 5.0, "4 rays": 4.0, "alpha 1": 6.0, "alpha 0.5": 3.0, "largest": 6.0}
    claims = {claim.key: claim for claim in fig_4_7.figure_claims({"two": outlines(sides), "three": outlines(other)})}
    assert claims["linear"].ours == pytest.approx((4.0 / 5.0) ** 2)
    assert claims["outer"].ours == 1.0
    assert claims["alpha_05_four"].ours == 1.0, "the last set alone"
    assert claims["grows"].ours == pytest.approx(25.0 / 16.0)
    assert claims["largest_inside"].ours == pytest.approx(1.0 / 4.0), "three corners of the larger square are outside"
    assert claims["largest_area"].ours == pytest.approx((3.0 / 2.0) ** 2)
    empty = fig_4_7.figure_claims({"two": outlines(sides), "three": outlines(sides | {"alpha 0.3": 0.0})})
    assert {claim.key: claim.ours for claim in empty}["largest_area"] == pytest.approx((3.0 / 2.0) ** 2)
    alone = fig_4_7.figure_claims(dict.fromkeys(("two", "three"), outlines(sides | {"alpha 0.3": 0.0})))
    assert {claim.key: claim.ours for claim in alone}["largest_area"] == pytest.approx(9.0 / 1e-9)
    assert_as_recorded("figure 4.7 of invented sections", claims.values())


def test_a_summary_counts_violations_and_what_leaves_the_cone() -> None:
    """Five invented sets, of one of which the thesis' cone is undefined; three have three bodies."""
    checks = [
        ConeCheck(3, 6, 20, -1e-3, 1e-3, 1e-9, 0.5, 0.1, 0.19, 0.010),
        ConeCheck(3, 6, 20, 2e-3, -1.2e-9, 3e-9, 0.3, 0.1, 0.25, 0.040),
        ConeCheck(2, 6, 20, -2e-3, -0.9e-9, 2e-9, 0.2, 0.1, 0.31, 0.900),
        ConeCheck(3, 6, 20, 0.0, 2e-3, 1e-9, 0.9, 0.1, 0.45, 0.020),
        ConeCheck(4, 6, 20, -1e-3, 1e-3, 1e-9, 0.1, np.nan, np.nan, 0.001),
    ]
    assert check_summary(checks) == pytest.approx({
        "sets": 5, "facets_violated": 1, "largest_violation": 2e-3, "points_outside": 1, "least_margin": -1.2e-9,
        "largest_change": 3e-9, "median_kept": 0.3, "median_kept_over_thesis": 4.0, "thesis_undefined": 1,
        "share_where_0.2_leaves": 0.25, "share_where_0.3_leaves": 0.5, "least_alpha_max": 0.19,
        "median_alpha_max": 0.28, "median_time_3_bodies_ms": 20.0,
    }, rel=1e-9, abs=0.0)  # fmt: skip


def test_the_time_of_a_cone_is_that_of_a_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    ticks = iter([3.0, 3.5])
    monkeypatch.setattr(cone_validation, "time", SimpleNamespace(process_time=lambda: next(ticks)))
    cone = Mock(spec=LorentzCone)
    assert cone_validation.timed_cone(lambda: cone) == (cone, Timed(0.5))


def test_a_gauge_is_compared_about_another_point_in_millimetres(monkeypatch: pytest.MonkeyPatch) -> None:
    """An invented gauge that is a component of the wrench, all moved by (3, -40, 7) m: m + p x f, in N mm."""
    frames: list[tuple[list[float], float]] = []

    def in_frame(point_m: np.ndarray, scale: float) -> str:
        frames.append((point_m.tolist(), scale))
        return "there"

    def cone_of(component: int) -> SimpleNamespace:
        cone = Mock(spec=LorentzCone, gauge=lambda wrenches: wrenches[:, component])
        return SimpleNamespace(from_contacts=lambda _: SimpleNamespace(largest_lorentz=lambda: cone))

    contacts = Mock(spec=PointContacts, in_frame=in_frame)
    boundary = np.array([[0.0, 0.0, 1.0, 0.2, -2.9, 0.0], [0.0, 0.0, 2.0, -0.5, 0.25, 0.0]])
    for component, expected in ((2, 1.0), (3, 80_500.0 + 1.0), (4, 5900.0 + 1.0)):
        monkeypatch.setattr(cone_validation, "LinearCone", cone_of(component))
        assert cone_validation._gauge_change(contacts, boundary) == pytest.approx(expected)
    assert frames == [([3.0, -40.0, 7.0], 1000.0)] * 3


def test_the_thesis_has_pyramids_about_the_centre_of_mass(sets) -> None:
    """Its cone is centred on rays about the CoM, 0.8 m above the mean of the contacts."""
    for contacts in sets.values():
        rays = contacts.wrench_rays(4)
        middle = contacts.position_m.mean(axis=0) + np.array([0.0, 0.0, 0.8])
        about = np.hstack([rays[:, :3], rays[:, 3:] - np.cross(middle, rays[:, :3])])
        expected = outer_cone(about)
        cone = thesis_cone(contacts)
        assert cone.gauge(rays) == pytest.approx(expected.gauge(about), rel=1e-6)
        assert cone.gauge(rays).max() == pytest.approx(1.0, abs=1e-6), "the four rays are inside"


def test_two_three_and_four_bodies_alternate(monkeypatch: pytest.MonkeyPatch) -> None:
    bodies: list[tuple[int, int, int]] = []

    def check_cone(contacts: int, of: int, points: int, _: np.random.Generator) -> ConeCheck:
        bodies.append((contacts, of, points))
        return invented_check(0.3, 0.2)

    monkeypatch.setattr(cone_validation, "random_contacts", lambda _, of: of)
    monkeypatch.setattr(cone_validation, "check_cone", check_cone)
    assert len(check_cones(7, 6)) == 7
    assert bodies == [(of, of, 6) for of in (2, 3, 4, 2, 3, 4, 2)]


def test_a_random_wrench_is_that_of_a_robot_of_ninety_kilograms() -> None:
    """Upright at the centre of mass on average; the drawn one has each deviation once: 200 N, 0.3 m and 20 N m."""

    def wrench_at(deviations: float) -> np.ndarray:
        rng = Mock(spec=np.random.Generator, normal=lambda mean, sd, n: np.full(n, mean + deviations * sd))
        return random_wrench(rng, contacts)

    contacts = random_contacts(np.random.default_rng(0), 2)
    middle = contacts.position_m.mean(axis=0) + np.array([0.0, 0.0, 0.8])
    still, drawn = wrench_at(0.0), wrench_at(1.0)
    assert still[:2] == pytest.approx([0.0, 0.0])
    assert still[2] == pytest.approx(90.0 * GRAVITY_M_S2, rel=0.05)
    assert still[3:] == pytest.approx(np.cross(middle, still[:3]))
    assert drawn[:3] - still[:3] == pytest.approx(np.full(3, 200.0))
    assert drawn[3:] - np.cross(middle + 0.3, drawn[:3]) == pytest.approx(np.full(3, 20.0))
