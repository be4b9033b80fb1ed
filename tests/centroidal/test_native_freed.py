"""The C++ solver where durations of phases or places of contacts are free, held against ipopt."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from stridelab.centroidal.boundary_conditions import PathBounds
from stridelab.centroidal.contact_wrench import ContactWrench
from stridelab.centroidal.control import Control
from stridelab.centroidal.free_variables import FreeDurations, FreePlacements
from stridelab.centroidal.native.availability import NativeUnavailable, native_availability
from stridelab.centroidal.point_forces import CircularCones
from stridelab.centroidal.solver import solve
from support.robots.sequences import (
    assert_same,
    bundled,
    foot,
    phase,
    rest_to_rest,
    sequence,
    total,
    two_steps,
    with_a_contact_between,
)

availability = native_availability()
if isinstance(availability, NativeUnavailable):
    pytest.skip(f"no native solver: {availability.reason}", allow_module_level=True)

CONES = CircularCones()


@pytest.mark.parametrize(
    ("durations", "control"),
    [
        (FreeDurations(0.7, 1.4), CONES),
        (FreeDurations(0.8, 1.3, fixed_total=False, price_per_s=3.0), CONES),
        (FreeDurations(0.8, 1.3), ContactWrench()),
    ],
    ids=str,
)
def test_finds_the_durations_that_cost_least(durations: FreeDurations, control: Control) -> None:
    problem = rest_to_rest(two_steps(0.4), control=control, durations=durations)
    plan = assert_same(problem)
    lengths_s = [np.array([p.duration_s for p in of.phases]) for of in (plan.sequence, problem.sequence)]
    share = lengths_s[0] / lengths_s[1]
    assert share.min() >= durations.shortest - 1e-9
    assert share.max() <= durations.longest + 1e-9
    if durations.fixed_total:
        assert plan.time_s[-1] == pytest.approx(problem.sequence.duration_s, abs=1e-9)
    given = solve(replace(problem, durations=None), "native")
    assert total(plan) < total(given) + durations.price_per_s * given.time_s[-1] - 1e-3


@pytest.mark.parametrize(
    "settings",
    [{"terminal": "capturable"}, {"bounds": PathBounds(normal_force_max_n={"left_foot": 400.0})}],
    ids=str,
)
def test_finds_the_durations_with_ends_and_bounds_of_every_kind(settings: dict[str, Any]) -> None:
    assert_same(rest_to_rest(two_steps(0.4), control=CONES, durations=FreeDurations(0.8, 1.25), **settings))


def test_a_flight_may_be_longer_or_shorter() -> None:
    left, right = foot("left", 0.0), foot("right", 0.0)
    hop = sequence(phase(0.7, left, right), phase(0.2), phase(1.0, left, right))
    assert_same(rest_to_rest(hop, control=CONES, durations=FreeDurations(0.8, 1.25)))


def test_finds_the_durations_of_the_long_stride() -> None:
    plan = assert_same(bundled("long-stride", control=CONES, durations=FreeDurations()))
    assert plan.iterations <= 60


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"terminal": "capturable"},
        {"placements": FreePlacements((0.05, 0.0))},
        {"bounds": PathBounds(normal_force_max_n={"right_foot": 500.0})},
    ],
    ids=str,
)
def test_finds_the_places_that_cost_least(settings: dict[str, Any]) -> None:
    problem = with_a_contact_between(**{"placements": FreePlacements((0.05, 0.03)), "control": CONES, **settings})
    plan = assert_same(problem)
    theirs = solve(problem, "ipopt")
    assert problem.placements is not None
    before, ours, other = (
        of.phases[2].contacts["right_foot"].placement.position_m
        for of in (problem.sequence, plan.sequence, theirs.sequence)
    )
    assert ours == pytest.approx(other, abs=1e-4)
    assert (np.abs(ours - before) <= np.array([*problem.placements.reach_m, 0.0]) + 1e-9).all()
    assert total(plan) < total(solve(replace(problem, placements=None), "native")) - 1e-2
    assert plan.solution is not None
    assert plan.solution.attempts[-1].log.objective[-1] == pytest.approx(total(plan), rel=1e-9)


@pytest.mark.parametrize("scenario", ["long-stride", "stairs-with-rail"])
def test_finds_the_places_of_the_experiments(scenario: str) -> None:
    problem = bundled(scenario, control=CONES)
    plan = solve(replace(problem, placements=FreePlacements()), "native")
    assert plan.converged, plan.status
    assert plan.iterations <= 30
    assert total(plan) < total(solve(problem, "native")) - 0.5


def test_a_contact_without_placement_window_does_not_move() -> None:
    problem = with_a_contact_between(control=CONES, placements=FreePlacements((0.0, 0.0)))
    plan = solve(problem, "native")
    assert plan.converged
    assert plan.sequence == problem.sequence


def test_durations_that_cannot_change_are_those_given() -> None:
    problem = rest_to_rest(two_steps(0.4), control=CONES, durations=FreeDurations(1.0, 1.0))
    plan = solve(problem, "native")
    assert plan.converged
    assert plan.sequence == problem.sequence


def test_free_durations_solve_a_problem_that_the_given_ones_do_not() -> None:
    """1.1 m is impossible in 0.1 s and in 0.2 s: this is reported, and nothing is proved of other durations."""
    near = phase(0.05, foot("left", 0.0), foot("right", 0.0))
    far = phase(0.05, foot("left", 1.0), foot("right", 1.0))
    plan = solve(rest_to_rest(sequence(near, far), control=CONES, durations=FreeDurations(0.5, 2.0)), "native")
    assert not plan.converged
    assert "infeasible" not in plan.status
