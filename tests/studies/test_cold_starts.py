"""The C++ solver held against a conic solver that knows the constraints alone, which is held against free fall."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from experiments.cold_starts import (
    compare_with_oracle,
    mirror_sequence,
    moved_problems,
    random_problems,
    shorten_durations,
    shortened_problems,
    summary_by_kind,
    transform_sequence,
)
from stridelab.centroidal.native.availability import NativeUnavailable, native_availability
from stridelab.centroidal.solver import solve
from stridelab.contacts.sequence import ContactPhase
from stridelab.dynamics.spatial import Placement
from support.oracles.feasibility import motion_exists
from support.robots.sequences import bundled

needs_native = pytest.mark.skipif(
    isinstance(native_availability(), NativeUnavailable), reason=str(native_availability())
)


def test_the_oracle_knows_free_fall() -> None:
    """Who begins in the air can land; nothing holds a body up in the air at the end."""
    problem = bundled("flat-walk")
    assert motion_exists(problem) == "feasible"
    only_flight = (ContactPhase(0.4, {}), problem.sequence.phases[0])
    airborne = replace(problem, sequence=replace(problem.sequence, phases=only_flight), com_end_m=problem.com_start_m)
    assert motion_exists(airborne) == "feasible"
    end_in_flight = replace(airborne, sequence=replace(airborne.sequence, phases=only_flight[::-1]))
    assert motion_exists(end_in_flight) == "infeasible"


def test_the_oracle_knows_what_friction_allows() -> None:
    """Cones bound how soon a CoM can be elsewhere."""
    problem = bundled("long-stride")
    assert motion_exists(shorten_durations(problem, 2.0)) == "feasible"
    assert motion_exists(shorten_durations(problem, 20.0)) == "infeasible"


def test_twice_mirrored_is_as_before() -> None:
    sequence = bundled("stairs-with-rail").sequence
    once, twice = mirror_sequence(sequence), mirror_sequence(mirror_sequence(sequence))
    assert "right_hand" in sequence.effectors
    assert "left_hand" in once.effectors
    for before, after in zip(sequence.phases, twice.phases, strict=True):
        for name, contact in before.contacts.items():
            np.testing.assert_allclose(after.contacts[name].placement.rotation, contact.placement.rotation, atol=1e-15)
            np.testing.assert_allclose(after.contacts[name].placement.position_m, contact.placement.position_m)
    for phase in once.phases:
        assert all(np.linalg.det(c.placement.rotation) > 0.0 for c in phase.contacts.values())


@needs_native
def test_cold_starts_end_as_the_oracle_says() -> None:
    kinds = {"drawn": random_problems(6), "hasty": islice(shortened_problems(24), 0, 24, 4), "moved": moved_problems(1)}
    result = [
        compare_with_oracle(kind, name, problem, motion_exists) for kind, of in kinds.items() for name, problem in of
    ]
    assert [c for c in result if not c.agrees_with_oracle and c.kind != "hasty"] == []
    assert [c for c in result if c.exists == "unknown"] == []
    assert all(of["wrong"] == 0 for of in summary_by_kind(result).values())


@needs_native
def test_what_is_infeasible_is_proved() -> None:
    result = compare_with_oracle(
        "hasty", "20 times as fast", shorten_durations(bundled("long-stride"), 20.0), motion_exists
    )
    assert (result.exists, result.proved, result.converged) == ("infeasible", True, False)
    assert result.agrees_with_oracle


@needs_native
def test_a_motion_does_not_know_where_it_is() -> None:
    """Turned by a right angle and 100 m away the optimum costs the same, to what single contacts' places round to."""
    problem = shorten_durations(bundled("long-stride"), 1.0)
    place = Placement.from_wxyz((60.0, -80.0, 3.0), (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)))
    there = replace(
        problem,
        sequence=transform_sequence(problem.sequence, place),
        com_start_m=place.act(problem.com_start_m[None])[0],
        com_end_m=place.act(problem.com_end_m[None])[0],
    )
    here_plan, there_plan = solve(problem, "native"), solve(there, "native")
    assert there_plan.objective == pytest.approx(here_plan.objective, rel=1e-7)
    np.testing.assert_allclose(there_plan.com_m, place.act(here_plan.com_m), atol=1e-6)
