"""Random stairs: drawn from the stated boxes, each a valid scenario, a refusal searched for a way out."""

from dataclasses import replace

import pytest

from experiments import stair_variations as stairs
from experiments.stair_variations import (
    Attempt,
    SearchResult,
    Variation,
    alternatives_to,
    random_variations,
    run_variation,
    search_alternatives,
)
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.schemas.scenarios import Scenario
from stridelab.wholebody.certificate.certificate import Check

REFUSED = Attempt("certificate", "a 3 > 2 m")
DONE = Attempt(None, "", (Check("a", 1.0, "m", 2.0),), True, 0.003)


def test_variations_are_drawn_from_their_boxes_and_the_same_every_time() -> None:
    result = random_variations()
    assert result == random_variations()
    assert result[:5] == random_variations(5)
    assert len(set(result)) == len(result) == stairs.NUMBER
    for name, (low, high) in {
        "height_m": stairs.HEIGHT_M,
        "depth_m": stairs.DEPTH_M,
        "toe_gap_m": stairs.TOE_GAP_M,
        "pace": stairs.PACE,
    }.items():
        values = [getattr(variation, name) for variation in result]
        assert low <= min(values) < low + 0.2 * (high - low)
        assert high >= max(values) > high - 0.2 * (high - low)
    rails = [variation.rail for variation in result if variation.rail is not None]
    assert len(rails) == stairs.NUMBER // 2
    for rail in rails:
        for value, (low, high) in zip((rail.ahead_m, rail.height_m, rail.y_m), stairs.RAIL_M, strict=True):
            assert low <= value <= high


@pytest.mark.parametrize("index", range(0, stairs.NUMBER, 7))
def test_every_variation_is_a_scenario(index: int) -> None:
    scenario = Scenario.model_validate(random_variations()[index].as_scenario).model_dump(mode="json")
    assert sequence_of(scenario, effector_shapes("talos")).robot == "talos"


def test_others_keep_the_stairs_and_the_rail_and_change_pace_or_place() -> None:
    variation = random_variations(2)[1]
    assert variation.rail is not None
    listed = list(alternatives_to(variation))
    assert variation not in listed
    assert len(set(listed)) == len(listed) >= 20
    for other in listed:
        stored = replace(other, pace=variation.pace, shift_m=0.0, half_width_m=variation.half_width_m, reach_m=0.0)
        assert stored == variation
    moved = replace(variation, reach_m=0.08)
    rails = [
        next(surface for surface in v.as_scenario["terrain"] if surface["kind"] == "rail") for v in (variation, moved)
    ]
    slope = variation.height_m / variation.depth_m
    heights = [rail["from_m"][2] - slope * rail["from_m"][0] for rail in rails]
    assert heights[0] == pytest.approx(heights[1], abs=1e-5), "the hand goes elsewhere on the same rail"
    assert {other.reach_m for other in alternatives_to(random_variations(1)[0])} == {0.0}


def test_a_pace_stretches_all_durations() -> None:
    def durations(pace: float) -> list[float]:
        scenario = Variation(0.1, 0.3, 0.055, pace).as_scenario
        return [phase["duration_s"] for phase in scenario["phases"]]

    assert durations(0.8) == pytest.approx([0.8 * seconds for seconds in durations(1.0)])


def test_the_search_ends_with_the_first_that_is_carried_out() -> None:
    variation = random_variations(1)[0]
    third = list(alternatives_to(variation))[2]
    result = search_alternatives(0, variation, REFUSED, lambda other: DONE if other == third else REFUSED)
    assert (result.tried, result.instead, result.failure_confirmed) == (3, third, False)


def test_a_refusal_is_confirmed_by_a_search_that_finds_nothing() -> None:
    variation = random_variations(1)[0]
    result = search_alternatives(0, variation, REFUSED, lambda _: REFUSED)
    assert result.failure_confirmed
    assert result.tried == len(list(alternatives_to(variation)))
    assert not SearchResult(0, REFUSED).failure_confirmed, "nothing was tried"


def test_only_a_motion_that_passes_its_checks_can_count_as_a_fall() -> None:
    failed = (Check("a", 3.0, "m", 2.0),)
    assert Attempt("replay", "falls", DONE.checks, replayed=False).fell_despite_certificate
    assert not Attempt("certificate", "", failed, replayed=False).fell_despite_certificate
    assert not Attempt("plan", "").fell_despite_certificate
    assert not DONE.fell_despite_certificate


def test_what_no_robot_can_do_is_refused_with_its_stage() -> None:
    assert run_variation(Variation(0.1, 0.2, 0.055, 1.0)).stage == "scenario", "soles longer than the treads"
