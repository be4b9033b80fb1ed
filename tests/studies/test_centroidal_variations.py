"""Random variations of the three experiments: drawn as promised, solved, and every ending distinguished."""

from dataclasses import replace

import numpy as np
import pytest

from experiments import centroidal_variations as module
from experiments.centroidal_variations import (
    EXPERIMENTS,
    FRICTION,
    HEIGHT_M,
    JITTER_M,
    PACE,
    STRIDE,
    Outcome,
    Variation,
    count_faults,
    distinct_validation_faults,
    outcome_summary,
    problem_of,
    random_variations,
    scenario_of,
    solve_variation,
    solve_variations,
    unvalidated_sequence,
)
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of as judged_sequence
from stridelab.contacts.scenarios.parts import TALOS
from stridelab.contacts.scenarios.stairs import long_stride
from stridelab.errors import InvalidInput

SHORT = Variation("stride", TALOS, 0.7, 1.0, 0.0, 0.5, 3)


def test_the_draws_fill_their_ranges_and_depend_on_the_seed_only() -> None:
    drawn = random_variations(300)
    assert random_variations(7) == drawn[:7]
    assert random_variations(7, seed=1) != drawn[:7]
    for name, (low, high) in (("stride", STRIDE), ("pace", PACE), ("height_m", HEIGHT_M), ("friction", FRICTION)):
        values = np.array([getattr(v, name) for v in drawn])
        assert values.min() >= low
        assert values.max() <= high
        assert np.ptp(values) > 0.97 * (high - low)
    for robot in ("talos", "hrp2"):
        for experiment in EXPERIMENTS:
            assert sum(v.walker.robot == robot and v.experiment == experiment for v in drawn) == 50


@pytest.mark.parametrize("variation", random_variations(6), ids=lambda v: f"{v.experiment} {v.walker.robot}")
def test_contacts_move_within_their_surfaces_and_stay_while_they_touch(variation: Variation) -> None:
    moved, plain = scenario_of(variation), module._build_scenario(variation)
    before: dict[str, tuple[list[float], list[float]]] = {}
    for jittered, straight in zip(moved["phases"], plain["phases"], strict=True):
        now = {}
        for a, b in zip(jittered["contacts"], straight["contacts"], strict=True):
            place, wanted = a["position_m"], b["position_m"]
            shift = np.subtract(place, wanted)
            assert np.abs(shift).max() <= JITTER_M
            if a["effector"] == "right_hand":
                assert np.cross(shift, [variation.stride * 0.3, 0.0, variation.height_m]) == pytest.approx(0, abs=1e-7)
            else:
                assert shift[2] == 0.0
            stored = before.get(a["effector"])
            if stored is not None and stored[0] == wanted:
                assert place == stored[1]
            now[a["effector"]] = (wanted, place)
        before = now
    sequence = unvalidated_sequence(moved, effector_shapes(variation.walker.robot))
    assert {c.friction for p in sequence.phases for c in p.contacts.values()} == {variation.friction}


def test_the_contacts_are_those_that_the_judge_reads() -> None:
    shapes = effector_shapes("talos")
    scenario = long_stride()
    ours, theirs = unvalidated_sequence(scenario, shapes), judged_sequence(scenario, shapes)
    for mine, read in zip(ours.phases, theirs.phases, strict=True):
        assert mine.duration_s == read.duration_s
        assert set(mine.contacts) == set(read.contacts)
        for name, contact in mine.contacts.items():
            assert contact.placement.position_m == pytest.approx(read.contacts[name].placement.position_m, abs=1e-9)
            assert contact.placement.rotation == pytest.approx(read.contacts[name].placement.rotation, abs=1e-9)
            assert (contact.kind, contact.half_size_m) == (
                read.contacts[name].kind,
                read.contacts[name].half_size_m,
            )


def test_variations_converge_and_the_summary_counts_them() -> None:
    heard: list[Outcome] = []
    result = solve_variations([SHORT, random_variations(3)[0]], heard.append)
    assert tuple(heard) == result
    counts = outcome_summary(result)
    assert counts["variations"] == counts["converged"] == 2
    assert counts["right"] == 1.0
    assert counts["dynamics_gap_most"] < 1e-8
    assert counts["terminal_gap_most"] < 1e-6
    assert counts["cone_margin_least_n"] >= 0.0
    assert 0 < counts["iterations_median"] <= counts["iterations_most"]


def test_problems_without_a_solution_differ_from_those_that_the_solver_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    def far(variation: Variation) -> CentroidalProblem:
        problem = problem_of(variation)
        return replace(problem, com_end_m=problem.com_end_m + np.array([200.0, 0.0, 0.0]))

    monkeypatch.setattr(module, "problem_of", far)
    outcome = solve_variation(SHORT)
    assert outcome.ending == "infeasible"
    assert outcome.reason

    def refused(variation: Variation) -> CentroidalProblem:
        raise InvalidInput("wrong", f"no {variation.experiment}")

    monkeypatch.setattr(module, "problem_of", refused)
    assert (solve_variation(SHORT).ending, solve_variation(SHORT).reason) == ("broken", "no stride")


def test_the_judges_reasons_are_counted_without_their_numbers() -> None:
    short_treads = [Variation("stairs", TALOS, stride, 1.0, 0.1, 0.5, 3) for stride in (0.6, 0.65)]
    reasons = [distinct_validation_faults(variation) for variation in (*short_treads, SHORT)]
    assert reasons[0] == reasons[1] != ()
    assert not any(character.isdigit() for character in "".join(reasons[0]))
    assert reasons[2] == ()
    result = [Outcome(variation, "stuck", why) for variation, why in zip((*short_treads, SHORT), reasons, strict=True)]
    assert count_faults(result) == dict.fromkeys(reasons[0], 2)
