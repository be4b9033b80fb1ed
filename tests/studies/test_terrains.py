"""Scenarios of the survey: drawn within their bounds, valid, the same every time; its page from given results."""

from typing import Any

import numpy as np
import pytest

from experiments.terrains.bounds import BOUNDS
from experiments.terrains.draw import Draw
from experiments.terrains.level import arc, sidestep
from experiments.terrains.steps import mirrored
from experiments.terrains.survey import CLASSES, Drawn, random_scenarios
from experiments.terrains.uneven import ramp, stairs
from make_terrains import NOTE, Row, page
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.validation.validate import validate_scenario
from stridelab.schemas.scenarios import Scenario

NUMBER = len(BOUNDS) * len(CLASSES)


@pytest.fixture(scope="module")
def drawn() -> list[Drawn]:
    return random_scenarios(2 * NUMBER, 5)


def test_every_class_is_drawn_for_every_robot(drawn: list[Drawn]) -> None:
    assert {(one.robot, one.kind) for one in drawn[:NUMBER]} == {(r, k) for r in BOUNDS for k in CLASSES}
    assert [one.index for one in drawn] == list(range(2 * NUMBER))


def test_a_scenario_depends_on_seed_and_index_only(drawn: list[Drawn]) -> None:
    assert [one.scenario for one in random_scenarios(7, 5)] == [one.scenario for one in drawn[:7]]
    assert random_scenarios(1, 6)[0].scenario != drawn[0].scenario


def test_scenarios_are_what_the_service_accepts(drawn: list[Drawn]) -> None:
    for one in drawn:
        Scenario.model_validate(one.scenario)
        report = validate_scenario(one.scenario, effector_shapes(one.robot))
        assert report.valid, (one.robot, one.kind, report.faults)


def test_half_of_them_are_mirrored_and_a_mirror_of_a_mirror_is_the_original(drawn: list[Drawn]) -> None:
    for one in drawn:
        assert mirrored(mirrored(one.scenario)) == one.scenario
    turns = [one.scenario for one in drawn if one.kind == "turn"]
    first = {phases["phases"][1]["contacts"][0]["effector"] for phases in turns}
    assert first == {"left_foot", "right_foot"}  # the foot that still stands: turns to either side


def feet_of(scenario: dict[str, Any], name: str) -> np.ndarray:
    """Consecutive places of a foot ``(n, 3)``."""
    places: list[list[float]] = []
    for phase in scenario["phases"]:
        for contact in phase["contacts"]:
            if contact["effector"] == name and (not places or contact["position_m"] != places[-1]):
                places.append(contact["position_m"])
    return np.array(places)


@pytest.mark.parametrize("robot", BOUNDS)
def test_values_lie_within_the_bounds_of_the_page(robot: str) -> None:
    bounds = BOUNDS[robot]
    for seed in range(20):
        draw = Draw(np.random.default_rng(seed))
        aside = np.diff(feet_of(sidestep(draw, bounds), "left_foot")[:, 1])
        assert aside.min() > bounds.side_m[0] - 1e-6
        assert aside.max() < bounds.side_m[1] + 1e-6
        up = np.abs(np.diff(feet_of(stairs(draw, bounds), "left_foot")[:, 2]))
        assert up.min() > bounds.stair_height_m[0] - 1e-6
        assert up.max() < bounds.stair_height_m[1] + 1e-6
        slope = ramp(draw, bounds)
        path = np.diff(feet_of(slope, "right_foot")[-2:], axis=0)[0]
        assert abs(np.degrees(np.arctan2(path[2], path[0]))) < max(map(abs, bounds.slope_deg)) + 1e-3


def test_an_arc_turns_by_the_same_angle_at_every_step() -> None:
    made = arc(Draw(np.random.default_rng(3)), BOUNDS["talos"])
    yaws = [
        {c["effector"]: 2 * np.arctan2(c["orientation_wxyz"][3], c["orientation_wxyz"][0]) for c in phase["contacts"]}
        for phase in made["phases"][::2]
    ]
    first, second = yaws[1], yaws[2]
    turns = [after[name] - before[name] for before, after in ((yaws[0], first), (first, second)) for name in before]
    assert max(turns) > np.radians(BOUNDS["talos"].arc_deg[0])
    assert sum(turn > 1e-9 for turn in turns) == 2  # one foot per step


def test_the_page_counts_outcomes_by_robot_with_their_interval() -> None:
    """Refusals before the body, failed certificates and falls are in columns of their own."""
    done = [Row(k, "talos", "arc", "", 10.0, certified=True, completed=True) for k in range(18)]
    refused = Row(18, "talos", "turn", "6 turns", 0.0, "check", ("shoes-overlap",), ("shoes | overlap",))
    fell = Row(19, "talos", "rail", "2 stairs", 9.0, "replay", ("replay-fell",), ("It falls.",), True, False, True)
    text = page([*done, refused, fell], 5, [], NOTE)
    assert "| talos | 20 | 18 | 70 to 97 % | 1 | 0 | 0 | 1 | 1 |" in text
    assert "| **all** | 20 | 18 | 70 to 97 % | 1 | 0 | 0 | 1 | 1 |" in text
    assert "| g1 | 0" not in text
    assert "| talos | turn | 18: 6 turns | check | shoes / overlap |" in text
    assert "first 20 of 200" in text
