"""Durations and contacts that the solver may choose."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.centroidal.contact_wrench import ContactWrench
from stridelab.centroidal.free_variables import FreeDurations, FreePlacements, movable_spans
from stridelab.centroidal.placement_windows import placement_window_m
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.solver import solve
from stridelab.contacts.sequence import Contact
from stridelab.contacts.terrain import Box, Rail, Terrain
from stridelab.dynamics.spatial import Placement
from stridelab.errors import InvalidInput
from support.robots.sequences import foot, phase, rest_to_rest, sequence, two_steps, with_a_contact_between


@pytest.fixture(scope="module")
def walk() -> CentroidalProblem:
    return rest_to_rest(two_steps(0.4))


@pytest.fixture(scope="module")
def fixed(walk: CentroidalProblem) -> CentroidalPlan:
    return solve(walk)


def whole_cost(plan: CentroidalPlan) -> float:
    return sum(plan.cost_terms.values())


def durations_s(plan: CentroidalPlan) -> np.ndarray:
    return np.array([phase.duration_s for phase in plan.sequence.phases])


def test_free_durations_cost_less_within_their_bounds_and_the_same_time(
    walk: CentroidalProblem, fixed: CentroidalPlan
) -> None:
    plan = solve(replace(walk, durations=FreeDurations(0.7, 1.4)))
    assert plan.converged, plan.status
    assert whole_cost(plan) < whole_cost(fixed) - 0.1
    share = durations_s(plan) / durations_s(fixed)
    assert share.min() >= 0.7 - 1e-9
    assert share.max() <= 1.4 + 1e-9
    assert plan.sequence.duration_s == pytest.approx(walk.sequence.duration_s)
    assert plan.time_s[-1] == pytest.approx(plan.sequence.duration_s)
    assert plan.verification.dynamics_gap < 1e-8


def test_the_durations_chosen_are_the_best_of_their_kind(walk: CentroidalProblem) -> None:
    """Solved again with the chosen durations given, and with others, the cost is that of the choice, and more."""
    free = replace(walk, durations=FreeDurations(0.95, 1.05))
    plan = solve(free)

    def given(durations_s: np.ndarray) -> float:
        phases = [replace(p, duration_s=float(d)) for p, d in zip(walk.sequence.phases, durations_s, strict=True)]
        again = solve(replace(free, durations=None, sequence=replace(walk.sequence, phases=tuple(phases))))
        assert len(again.phase) == len(plan.phase)
        return whole_cost(again)

    chosen = durations_s(plan)
    assert given(chosen) == pytest.approx(whole_cost(plan), abs=1e-3)
    stated_s = np.array([p.duration_s for p in walk.sequence.phases])
    assert given(0.5 * (chosen + stated_s)) > given(chosen) + 1e-3
    assert given(0.9 * chosen + 0.1 * stated_s) > given(chosen) + 1e-3


def test_free_durations_begin_where_the_given_ones_lead(walk: CentroidalProblem, fixed: CentroidalPlan) -> None:
    plan = solve(replace(walk, durations=FreeDurations()), "ipopt")
    assert plan.solution is not None
    first, second = plan.solution.attempts
    assert first.iterations == fixed.iterations
    assert plan.iterations == first.iterations + second.iterations
    assert plan.solve_time_s == pytest.approx(first.solve_s + second.solve_s)


def test_too_little_time_is_made_enough_where_it_may_be() -> None:
    """On both feet by 0.2 m in 0.3 s: friction allows no more than 0.13 m."""
    standing = rest_to_rest(sequence(phase(0.3, foot("left", 0.0), foot("right", 0.0))), proxies={})
    hurried = replace(standing, com_end_m=standing.com_end_m + np.array([0.2, 0.0, 0.0]), node_rate_hz=20.0)
    assert not solve(hurried, "ipopt").converged
    plan = solve(replace(hurried, durations=FreeDurations(1.0, 6.0, fixed_total=False, price_per_s=1.0)))
    assert plan.converged, plan.status
    assert plan.sequence.duration_s > 0.35


def test_a_cost_of_time_shortens_the_motion(walk: CentroidalProblem) -> None:
    cheap, dear = (
        solve(replace(walk, durations=FreeDurations(fixed_total=False, price_per_s=price))) for price in (0.0, 50.0)
    )
    assert cheap.converged
    assert dear.converged
    assert dear.sequence.duration_s < cheap.sequence.duration_s - 0.1
    assert dear.cost_terms["duration"] == pytest.approx(50.0 * dear.sequence.duration_s)
    assert "duration" not in cheap.cost_terms


def test_durations_are_free_with_the_wrench_too(walk: CentroidalProblem) -> None:
    given, free = (solve(replace(walk, control=ContactWrench(), durations=d)) for d in (None, FreeDurations()))
    assert free.converged, free.status
    assert whole_cost(free) < whole_cost(given)


def test_contacts_move_where_they_may_and_the_plan_verifies_there() -> None:
    reach_m = (0.05, 0.03)
    swung = with_a_contact_between()
    moved = solve(replace(swung, placements=FreePlacements(reach_m)))
    still = solve(swung)
    assert moved.converged, moved.status
    assert whole_cost(moved) < whole_cost(still) - 1e-3
    before = swung.sequence.phases[2].contacts["right_foot"].placement.position_m
    after = moved.sequence.phases[2].contacts["right_foot"].placement.position_m
    shift = after - before
    assert np.abs(shift).max() > 1e-3
    assert (np.abs(shift) <= np.array([*reach_m, 0.0]) + 1e-9).all()
    assert moved.sequence.phases[0].contacts["right_foot"] is swung.sequence.phases[0].contacts["right_foot"]


def test_placements_and_durations_are_free_at_once() -> None:
    """Cheaper than either alone; given what both chose, the plan costs the same."""
    swung = with_a_contact_between()
    durations, placements = FreeDurations(0.96, 1.04), FreePlacements((0.05, 0.03))
    of_durations, of_placements, of_both = (
        solve(replace(swung, durations=d, placements=p))
        for d, p in ((durations, None), (None, placements), (durations, placements))
    )
    assert of_both.converged, of_both.status
    assert whole_cost(of_both) < min(whole_cost(of_durations), whole_cost(of_placements)) - 1e-3
    share = durations_s(of_both) / durations_s(of_placements)
    assert share.min() >= 0.96 - 1e-9
    assert share.max() <= 1.04 + 1e-9
    given = solve(replace(swung, sequence=of_both.sequence))
    assert len(given.phase) == len(of_both.phase)
    assert whole_cost(given) == pytest.approx(whole_cost(of_both), abs=1e-3)


def test_contacts_at_the_start_and_end_do_not_move() -> None:
    spans = [
        (stay.contact.effector, stay.first, stay.last) for stay in movable_spans(with_a_contact_between().sequence)
    ]
    assert spans == [("right_foot", 2, 4)]


SOLE = np.array([[x, y, 0.0] for x in (-0.1, 0.1) for y in (-0.06, 0.06)])


def on(surface: str, at: tuple[float, float, float], yaw_rad: float = 0.0) -> Contact:
    half = yaw_rad / 2
    return Contact("right_foot", Placement.from_wxyz(at, (np.cos(half), 0.0, 0.0, np.sin(half))), surface, 0.5)


def test_a_window_ends_at_the_edge_of_its_face() -> None:
    stair = Box("stair", Placement.from_wxyz((0.0, 0.0, 0.0)), np.array([0.3, 1.0, 0.2]))
    lower, upper = placement_window_m(on("stair", (0.03, 0.0, 0.1)), SOLE, Terrain((stair,)), (0.05, 0.03))
    assert lower == pytest.approx([-0.05, -0.03])
    assert upper == pytest.approx([0.02, 0.03])


def test_a_window_ends_at_the_next_riser() -> None:
    low = Box("low", Placement.from_wxyz((0.0, 0.0, 0.0)), np.array([2.0, 1.0, 0.2]))
    high = Box("high", Placement.from_wxyz((0.63, 0.0, 0.1)), np.array([1.0, 1.0, 0.4]))
    lower, upper = placement_window_m(on("low", (0.0, 0.0, 0.1)), SOLE, Terrain((low, high)), (0.05, 0.03))
    assert lower == pytest.approx([-0.05, -0.03])
    assert upper == pytest.approx([0.03, 0.03])


def test_a_turned_window_stays_on_the_face_whatever_corner_it_takes() -> None:
    stair, rng = Box("stair", Placement.from_wxyz((0.0, 0.0, 0.0)), np.array([0.4, 0.4, 0.2])), np.random.default_rng(3)
    for yaw in rng.uniform(-3.0, 3.0, 30):
        contact = on("stair", (0.04, -0.03, 0.1), float(yaw))
        lower, upper = placement_window_m(contact, SOLE, Terrain((stair,)), (0.2, 0.2))
        for d in [(x, y) for x in (lower[0], upper[0]) for y in (lower[1], upper[1])]:
            corners = contact.placement.act(SOLE) + contact.placement.rotation[:, :2] @ d
            assert np.abs(corners[:, :2]).max() <= 0.2 + 1e-12
        assert (upper - lower).max() > 1e-3


def test_a_hand_moves_along_its_rail_only() -> None:
    rail = Rail("rail", np.array([0.0, -0.5, 0.8]), np.array([1.0, -0.5, 0.8]), 0.02)
    lower, upper = placement_window_m(on("rail", (0.97, -0.5, 0.82)), np.zeros((1, 3)), Terrain((rail,)), (0.05, 0.05))
    assert lower == pytest.approx([-0.05, 0.0])
    assert upper == pytest.approx([0.03, 0.0])


def test_on_a_surface_that_the_terrain_lacks_nothing_moves() -> None:
    lower, upper = placement_window_m(on("nowhere", (0.0, 0.0, 0.0)), SOLE, Terrain(()), (0.05, 0.05))
    assert not lower.any()
    assert not upper.any()


@pytest.mark.parametrize("bounds", [(0.0, 1.5), (1.1, 1.5), (0.5, 0.9), (0.5, float("inf")), (float("nan"), 1.5)])
def test_bounds_on_durations_must_hold_what_was_given(bounds: tuple[float, float]) -> None:
    with pytest.raises(InvalidInput) as caught:
        FreeDurations(*bounds)
    assert caught.value.code == "durations-out-of-range"


def test_a_negative_cost_of_time_is_refused() -> None:
    with pytest.raises(InvalidInput):
        FreeDurations(price_per_s=-1.0)


@pytest.mark.parametrize("reach_m", [(-0.01, 0.02), (0.02, float("nan"))])
def test_a_window_of_invalid_size_is_refused(reach_m: tuple[float, float]) -> None:
    with pytest.raises(InvalidInput) as caught:
        FreePlacements(reach_m)
    assert caught.value.code == "placements-out-of-range"
