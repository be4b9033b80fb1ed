"""The search of what a robot can do: bisection, its end, and the scenarios that it tries."""

import math
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from stridelab.contacts.scenarios.stairs import turn_on_the_spot
from stridelab.pipelines.commissioning import capability_search
from stridelab.pipelines.commissioning.capability_search import (
    NAMES,
    LevelWalk,
    one_stair,
    search_capabilities,
)
from stridelab.pipelines.commissioning.commission_robot import com_height_m, foot_places_m, scaled_walk
from stridelab.pipelines.plan_problem import validate_scenario
from stridelab.robots.loader import load_robot
from stridelab.schemas.scenarios import Scenario
from stridelab.wholebody.motion import WholeBodyMotion
from stridelab.wholebody.shoe_check import shoe_ends_m, shoe_faults


def search_up_to(limit: float, number: int = 20) -> Any:
    def attempt(value: float) -> tuple[str, dict[str, Any] | None]:
        return ("", {"value": value}) if value <= limit else (f"above {limit:g}", None)

    return capability_search._Search("m", 0.0, 0.01, number, attempt)


@pytest.mark.parametrize(
    ("limit", "value", "end"), [(0.135, 0.13, "fails"), (0.005, 0.0, "fails"), (1.0, 0.2, "range")]
)
def test_the_largest_value_that_passes(limit: float, value: float, end: str) -> None:
    search = search_up_to(limit)
    bisection = capability_search._Bisection("stair", search)
    while (number := bisection.next_number) is not None:
        bisection.record_attempt(number, search.attempt(search.value_of(number)), 0.5)
    capability = bisection.to_capability()
    assert (capability.value, capability.ended_by) == (pytest.approx(value), end)
    assert (bisection.best or {"value": 0.0})["value"] == pytest.approx(value)
    assert [one.passed for one in capability.attempts] == [one.value <= limit for one in capability.attempts]
    assert capability.reason == ("" if end == "range" else f"{value + 0.01:g} m: above {limit:g}")
    assert len(capability.attempts) <= bisection.most_attempts == math.ceil(math.log2(21))
    assert capability.seconds == 0.5 * len(capability.attempts)


def find_capabilities(
    monkeypatch: pytest.MonkeyPatch, tried: Callable[[str, int], dict[str, Any] | None], *, walks: bool = True
) -> tuple[dict[str, Any], list[float]]:
    """Result of a search in which ``tried`` stands in for motions, and its progress."""
    monkeypatch.setattr("stridelab.machine.parallel._has_one_thread", lambda: True)  # forks know what stands in
    monkeypatch.setattr(capability_search, "_try_value", lambda _walk, _ends_s, item: tried(*item))
    progress: list[float] = []
    walk = replace(level_walk("talos"), motion=WholeBodyMotion.__new__(WholeBodyMotion) if walks else None)
    found = search_capabilities(walk, 60.0, lambda fraction, _message: progress.append(fraction))
    return {one.name: one for one in found.capabilities}, progress


def test_searches_take_turns_and_tell_their_progress_at_every_value(monkeypatch: pytest.MonkeyPatch) -> None:
    passes: dict[str, int] = {name: k for k, name in enumerate(NAMES, start=2)}
    found, progress = find_capabilities(
        monkeypatch,
        lambda name, k: {"reason": "" if k <= passes[name] else "falls", "scenario": {}, "seconds": 1.0},
    )
    for name, capability in found.items():
        numbers = [one.value for one in capability.attempts if one.passed]
        assert capability.value == max(numbers)
        assert (capability.ended_by, capability.reason.partition(": ")[2]) == ("fails", "falls")
        steps = (capability.value - (level_walk("talos").speed_m_s if name == "pace" else 0.0)) / capability.resolution
        assert steps == pytest.approx(passes[name], abs=1e-3)
    assert len(progress) == sum(len(one.attempts) for one in found.values())
    assert progress == sorted(progress)
    assert progress[-1] > 0.8


def test_a_search_whose_time_ends_states_what_every_capability_has_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a busy machine: no turn is begun in time, of the others one value each."""
    first = {"turn": 0, "stair": 20}
    passing = {"reason": "", "scenario": {}, "seconds": 1.0}
    found, _ = find_capabilities(monkeypatch, lambda name, k: passing if k <= first.get(name, 11) else None)
    assert (found["turn"].value, found["turn"].ended_by, found["turn"].reason) == (None, "not-tried", "the time ended")
    for name in set(NAMES) - {"turn"}:
        assert (found[name].ended_by, len(found[name].attempts)) == ("time", 1)


def test_a_value_whose_process_ends_does_not_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    def end_process(name: str, k: int) -> dict[str, Any]:
        if name == "stair":
            os._exit(3)
        return {"reason": "", "scenario": {}, "seconds": 1.0}

    found, _ = find_capabilities(monkeypatch, end_process)
    assert found["stair"].value == 0.0
    assert "exit code 3" in found["stair"].reason
    assert found["pace"].ended_by == "range"


def level_walk(name: str) -> LevelWalk:
    robot = load_robot(name)
    feet_y_m = foot_places_m(robot)
    scenario, step_m, step_s = scaled_walk(robot, feet_y_m, 1.0)
    scale = com_height_m(robot) / capability_search.TALOS_COM_HEIGHT_M  # type: ignore[attr-defined]
    return LevelWalk(name, Path("none"), feet_y_m, scale, Scenario.model_validate(scenario), step_m / step_s, None)


@pytest.mark.parametrize("name", ["talos", "hrp2", "g1"])
def test_shoes_have_room_on_a_stair_for_any_robot(name: str) -> None:
    robot, walk = load_robot(name), level_walk(name)
    sequence, _ = validate_scenario(Scenario.model_validate(one_stair(walk, 0.05)))
    assert shoe_faults(robot, sequence) == []
    ahead_m, behind_m = shoe_ends_m(robot, "left_foot")
    half_m = (robot.effectors["left_foot"].contact_half_size_m or (0.0,))[0]
    assert half_m <= min(ahead_m, behind_m)
    assert max(ahead_m, behind_m) < half_m + 0.1


def test_a_stair_that_fails_is_tried_with_longer_double_supports(monkeypatch: pytest.MonkeyPatch) -> None:
    """As of GR1-T2, whose plans cannot shift its weight between two feet 0.25 m apart within 0.2 s."""
    rests_s: list[float] = []

    def try_scenario(scenario: dict[str, Any]) -> tuple[str, dict[str, Any]]:
        both = [phase["duration_s"] for phase in scenario["phases"][1:-1] if len(phase["contacts"]) == 2]
        rests_s.extend(both)
        return "" if both[0] > longest_s else f"rests of {both[0]:g} s", scenario

    monkeypatch.setattr(capability_search, "_try_scenario", try_scenario)
    walk, longest_s = replace(level_walk("talos"), scale=1.0), 0.1
    assert capability_search._try_stair(walk, 0.1)[0] == ""
    longest_s = 0.3
    reason, passing = capability_search._try_stair(walk, 0.1)
    assert (reason, rests_s) == ("", [0.2, 0.2, 0.6])
    assert passing is not None
    assert passing["phases"][2]["duration_s"] == 0.6
    longest_s = 1.0
    assert capability_search._try_stair(walk, 0.1)[0] == "rests of 0.6 s"


def test_both_feet_turn_about_the_point_between_them() -> None:
    scenario = turn_on_the_spot(2, 0.3)
    last = {contact["effector"]: contact for contact in scenario["phases"][-1]["contacts"]}
    left, right = last["left_foot"]["position_m"], last["right_foot"]["position_m"]
    assert [a + b for a, b in zip(left, right, strict=True)] == pytest.approx([0.0, 0.0, 0.0])
    assert math.atan2(-left[0], left[1]) == pytest.approx(0.6, abs=1e-5)
    for contact in last.values():
        w, _, _, z = contact["orientation_wxyz"]
        assert 2 * math.atan2(z, w) == pytest.approx(0.6, abs=1e-6)
    assert len(scenario["phases"]) == 9


def test_every_capability_has_a_reason_without_a_level_walk() -> None:
    nothing = search_capabilities(level_walk("talos"), 0.0, lambda _fraction, _message: None)
    assert [one.name for one in nothing.capabilities] == list(NAMES)
    assert {(one.value, one.reason) for one in nothing.capabilities} == {(None, "no time was given")}
    assert nothing.scenarios == {}


def test_without_a_level_walk_turn_and_stair_alone_are_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    passing = {"reason": "", "scenario": {}, "seconds": 1.0}
    found, _ = find_capabilities(monkeypatch, lambda _name, _k: passing, walks=False)
    assert {name for name, one in found.items() if one.ended_by == "range"} == {"turn", "stair"}
    assert (found["pace"].value, found["pace"].reason) == (None, capability_search.NO_WALK)
