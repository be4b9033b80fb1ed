"""Numbers in the text of chapter 4 by hand: facets and rays with known violations, seeds of sets, invented clocks."""

from collections.abc import Mapping
from itertools import count
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from stridelab.contacts.wrench_cones.wrench_cone import LinearCone
from stridelab.reproduction.chapter4 import numbers
from stridelab.reproduction.chapter4.numbers import FacetCounts
from support.recorded_claims import assert_as_recorded


def test_a_violation_is_the_sine_between_ray_and_facet() -> None:
    """Neither is of unit length; a ray on a facet violates nothing."""
    cone = Mock(spec=LinearCone, rays=np.array([[3.0, 4.0], [-2.0, 0.0]]), facets=np.array([[0.0, 0.5], [0.0, -7.0]]))
    assert numbers._largest_violation(cone) == pytest.approx(0.8)
    inside = Mock(spec=LinearCone, rays=np.array([[5.0, 0.0], [3.0, 4.0]]), facets=np.array([[0.0, -2.0]]))
    assert numbers._largest_violation(inside) == 0.0


def test_sets_of_each_number_of_bodies_and_seed_are_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of one seed the sets of two and three bodies, too; the largest violation is that of the worst set."""
    drawn: list[tuple[int, float]] = []
    rays: list[int] = []
    normals = count(5)

    def random_contacts(rng: np.random.Generator, bodies: int) -> int:
        drawn.append((bodies, float(rng.random())))
        return bodies

    def from_contacts(_contacts: int, n_rays: int) -> Mock:
        rays.append(n_rays)
        k = next(normals)
        facets = np.array([[k / 100.0, 1.0]])
        return Mock(spec=LinearCone, normals=[None] * k, rays=np.array([[1.0, 0.0]]), facets=facets)

    monkeypatch.setattr(numbers, "random_contacts", random_contacts)
    monkeypatch.setattr(numbers, "LinearCone", SimpleNamespace(from_contacts=from_contacts))
    counts = {(bodies, seed): numbers.facet_counts(bodies, seed) for bodies in (2, 3) for seed in (0, 1, 2)}
    assert set(rays) == {4}, "pyramids, as in the thesis"
    assert [bodies for bodies, _ in drawn] == [2] * 3 * numbers.SETS + [3] * 3 * numbers.SETS
    assert len({value for _, value in drawn}) == len(drawn)
    first = [np.random.default_rng(bodies + 10 * seed).random() for bodies, seed in counts]
    assert [value for _, value in drawn[:: numbers.SETS]] == first, "documented seeds"
    assert counts[2, 0].facets == tuple(map(float, range(5, 5 + numbers.SETS)))
    assert counts[2, 0].violations == pytest.approx([np.sin(np.arctan(k / 100.0)) for k in range(5, 5 + numbers.SETS)])


def test_claims_on_facets_count_every_set() -> None:
    """Medians of invented counts, and one violation of all sets beyond rounding."""
    two = FacetCounts((40.0, 60.0, 20.0, 100.0), (1e-9, 1.2e-6, 0.9e-6, 0.0))
    three = FacetCounts((90.0, 130.0, 110.0), (0.0, 2e-6, 1e-12))
    assert (two.median_number, two.largest_violation) == (50.0, 1.2e-6)
    claims = {claim.key: claim for claim in numbers._facet_claims({2: two, 3: three})}
    assert (claims["facets_2"].ours, claims["facets_3"].ours) == (50.0, 110.0)
    assert (claims["facets_2"].holds_from, claims["facets_2"].holds_to) == (25.0, 100.0)
    assert claims["facets_3"].holds_from == 100.0
    assert (claims["facets_violation"].ours, claims["facets_violation"].outcome) == (2e-6, "aim_missed")
    assert (claims["facets_violation"].cases_inside, claims["facets_violation"].n) == (5, 7)
    assert claims["facets_3"].interval == (90.0, 130.0)
    stairs = [len(cone.normals) for cone in (LinearCone.from_contacts(c, 4) for _, c in numbers._stair_contact_sets())]
    assert len(stairs) == 2
    assert claims["facets_2"].note.endswith(f"{stairs[0]} with 2 contacts, {stairs[1]} with 3 contacts.")


def test_factors_of_ellipsoids_are_those_of_squares_and_triangles() -> None:
    """The circle around a square shrinks by the root of two, that around a triangle by two, wherever they are."""
    square = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    angle = np.radians([90.0, 210.0, 330.0])
    triangle = np.column_stack([np.cos(angle), np.sin(angle)])
    for shift in (0.0, 5.0):
        assert numbers._shrinking_factor(3.0 * square + shift) == pytest.approx(np.sqrt(0.5), abs=1e-4)
        assert numbers._shrinking_factor(triangle + shift) == pytest.approx(0.5, abs=1e-4)


def test_bounds_of_ellipsoids_are_a_fifth_and_its_root() -> None:
    """Rounding errors of a millionth do not count."""
    alphas = {"general": (0.2 - 0.9e-6, 0.3), "symmetric": (np.sqrt(0.2) - 1.1e-6, 0.5)}
    general, symmetric = numbers._john_claims(alphas)
    assert (general.ours, general.verdict, general.cases_inside, general.n) == (0.2 - 0.9e-6, "met", 2, 2)
    assert (symmetric.verdict, symmetric.cases_inside, symmetric.n) == ("not_met", 1, 2)
    assert (general.thesis, symmetric.thesis) == pytest.approx((0.2, np.sqrt(0.2)))
    clouds = numbers.shrinking_factors(symmetric=False, seed=4), numbers.shrinking_factors(symmetric=True, seed=4)
    assert [len(of) for of in clouds] == [numbers.CLOUDS + 1] * 2
    assert [of[-1] for of in clouds] == pytest.approx([0.2, np.sqrt(0.2)], abs=1e-4), "the sharp ones"
    assert f"Minimum over {numbers.CLOUDS} clouds of {numbers.POINTS} points" in general.note


def test_a_kernel_takes_the_least_time_over_all_pairs(monkeypatch: pytest.MonkeyPatch) -> None:
    """An invented clock: 5, 3 and 4 s for the evaluation of so many points by every kernel of the right foot."""
    ticks = iter([10.0, 15.0, 20.0, 23.0, 30.0, 34.0])
    asked: list[tuple[str, str, int]] = []
    cloud = np.random.default_rng(0).normal(size=(400, 3))

    def load_cloud(robot: str, measure: str) -> Mapping[str, np.ndarray]:
        asked.append((robot, measure, 0))
        return {"right_foot": cloud}

    class Density:
        @staticmethod
        def with_scott_bandwidth(of: np.ndarray) -> "Density":
            assert of is cloud
            return Density()

        def log_density(self, at: np.ndarray) -> None:
            asked.append(("", "", len(at)))

    monkeypatch.setattr(numbers, "load_cloud", load_cloud)
    monkeypatch.setattr(numbers, "KernelDensity", Density)
    monkeypatch.setattr(numbers, "time", SimpleNamespace(process_time=lambda: next(ticks)))
    claim = numbers._kernel_claim()
    assert asked == [("hrp2", "uniform", 0), *[("", "", 200)] * 3]
    assert claim.ours == pytest.approx(1e9 * 3.0 / (200 * 400))
    assert (claim.thesis, claim.holds_to, claim.verdict, claim.n) == (10.0, 20.0, "not_met", 3)
    assert_as_recorded("a kernel by an invented clock", [claim], timed=True)
    assert "400 kernels at 200 points; least of 3" in claim.note


def test_what_is_printed_is_in_a_tenth_of_what_is_ours() -> None:
    """Around 100 kg: 90 to 110 kg; durations to 2 %."""
    claim = numbers._around_claim("k", "says", 100.0, 91.0, "kg", "", "4.6.4")
    assert claim.where == "4.6.4"
    assert (claim.holds_from, claim.holds_to, claim.verdict) == (pytest.approx(90.0), pytest.approx(110.0), "met")
    bounds = {claim.key: (claim.thesis, claim.holds_from, claim.holds_to) for claim in numbers._duration_claims()}
    for key, printed_s in (("motion_1_s", 8.0), ("motion_2_s", 24.0), ("motion_3_s", 36.0)):
        assert bounds[key] == (printed_s, pytest.approx(0.98 * printed_s), pytest.approx(1.02 * printed_s))
