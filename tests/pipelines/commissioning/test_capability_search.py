"""The search of what a robot can do: bisection, its end, and the scenarios that it tries."""

import math
from pathlib import Path
from typing import Any

import pytest

from stridelab.contacts.scenarios.stairs import turn_on_the_spot
from stridelab.pipelines.commissioning import capability_search
from stridelab.pipelines.commissioning.capability_search import (
    NAMES,
    LevelWalk,
    bisect_capability,
    one_stair,
    search_capabilities,
)
from stridelab.pipelines.commissioning.commission_robot import com_height_m, foot_places_m, scaled_walk
from stridelab.pipelines.plan_problem import validate_scenario
from stridelab.robots.loader import load_robot
from stridelab.schemas.scenarios import Scenario
from stridelab.wholebody.shoe_check import shoe_ends_m, shoe_faults


def search_up_to(limit: float, number: int = 20) -> Any:
    def attempt(value: float) -> tuple[str, dict[str, Any] | None]:
        return ("", {"value": value}) if value <= limit else (f"above {limit:g}", None)

    return capability_search._Search("m", 0.0, 0.01, number, attempt)


@pytest.mark.parametrize(
    ("limit", "value", "end"), [(0.135, 0.13, "fails"), (0.005, 0.0, "fails"), (1.0, 0.2, "range")]
)
def test_the_largest_value_that_passes(limit: float, value: float, end: str) -> None:
    capability, scenario = bisect_capability("stair", search_up_to(limit))
    assert (capability.value, capability.ended_by) == (pytest.approx(value), end)
    assert (scenario or {"value": 0.0})["value"] == pytest.approx(value)
    assert [one.passed for one in capability.attempts] == [one.value <= limit for one in capability.attempts]
    assert capability.reason == ("" if end == "range" else f"{value + 0.01:g} m: above {limit:g}")
    assert len(capability.attempts) <= math.ceil(math.log2(21))


def test_a_search_without_time_states_no_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([0.0, *(float(k) for k in range(20))])
    monkeypatch.setattr(capability_search.time, "monotonic", lambda: next(clock))  # type: ignore[attr-defined]
    some, _ = bisect_capability("stair", search_up_to(0.2), ends_s=2.0)
    assert (some.value, some.ended_by, len(some.attempts)) == (pytest.approx(0.15), "time", 2)
    nothing, scenario = bisect_capability("stair", search_up_to(0.2), ends_s=0.0)
    assert (nothing.value, nothing.ended_by, nothing.reason, scenario) == (None, "not-tried", "the time ended", None)


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
    pace = capability_search._search_one(level_walk("talos"), math.inf, "pace")["capability"]
    assert (pace["value"], pace["reason"]) == (None, capability_search.NO_WALK)
