"""One number of a scenario changed, and what hangs on it with it."""

import json
from typing import Any

import numpy as np
import pytest

from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenarios.variations import FIELDS, current_value, vary_scenario
from stridelab.contacts.validation.validate import validate_scenario
from stridelab.errors import InvalidInput
from stridelab.machine.models_folder import models_dir

SCENARIOS = models_dir() / "scenarios"


def bundled(name: str) -> dict[str, Any]:
    result: dict[str, Any] = json.loads((SCENARIOS / f"{name}.json").read_text())
    return result


def turned(scenario: dict[str, Any], yaw_rad: float) -> dict[str, Any]:
    """All of it about the world's z axis."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    for surface in scenario["terrain"]:
        surface["center_m"] = (R @ surface["center_m"]).tolist()
        surface["yaw_rad"] = (surface["yaw_rad"] or 0.0) + yaw_rad
    for phase in scenario["phases"]:
        for contact in phase["contacts"]:
            contact["position_m"] = (R @ contact["position_m"]).tolist()
            contact["orientation_wxyz"] = [np.cos(yaw_rad / 2), 0.0, 0.0, np.sin(yaw_rad / 2)]
    return scenario


@pytest.mark.parametrize(
    ("name", "field", "value"),
    [("long-stride", "stride", 0.7), ("six-stairs", "stride", 0.32), ("six-stairs", "height", 0.08)],
)
def test_the_scenario_then_has_the_value(name: str, field: Any, value: float) -> None:
    assert current_value(vary_scenario(bundled(name), {field: value}), field) == pytest.approx(value)


def test_what_it_has_already_changes_nothing() -> None:
    before = bundled("six-stairs")
    after = vary_scenario(before, {field: current_value(before, field) for field in FIELDS})
    for old, new in zip(before["terrain"], after["terrain"], strict=True):
        np.testing.assert_allclose(new["center_m"], old["center_m"], atol=1e-12)
        np.testing.assert_allclose(new["size_m"], old["size_m"], atol=1e-12)
    for old, new in zip(before["phases"], after["phases"], strict=True):
        assert new["duration_s"] == old["duration_s"]
        for one, other in zip(old["contacts"], new["contacts"], strict=True):
            np.testing.assert_allclose(other["position_m"], one["position_m"], atol=1e-12)


def test_lower_stairs_carry_the_feet_that_stood_on_the_higher_ones() -> None:
    result = validate_scenario(vary_scenario(bundled("six-stairs"), {"height": 0.06}), effector_shapes("talos"))
    assert result.valid, result.faults
    heights = [margin.height_m for margin in result.margins if margin.height_m is not None]
    assert np.abs(heights).max() < 1e-9


def test_steps_that_leave_the_robots_reach_are_refused_by_name() -> None:
    result = validate_scenario(vary_scenario(bundled("long-stride"), {"stride": 4.0}), effector_shapes("talos"))
    assert not result.valid
    assert any(fault.where.startswith("phases[") for fault in result.faults)


def test_a_turned_scenario_is_stretched_along_its_own_way() -> None:
    straight = vary_scenario(bundled("six-stairs"), {"stride": 0.33})
    aslant = vary_scenario(turned(bundled("six-stairs"), 0.6), {"stride": 0.33})
    np.testing.assert_allclose(
        [c["position_m"] for p in aslant["phases"] for c in p["contacts"]],
        [c["position_m"] for p in turned(straight, 0.6)["phases"] for c in p["contacts"]],
        atol=1e-9,
    )


@pytest.mark.parametrize("length", [1.0, 4.0])
def test_boxes_may_say_their_turn_as_a_quaternion_of_any_length(length: float) -> None:
    """Leaning by less than a milliradian to either side, which counts as upright."""
    aslant, message = turned(bundled("six-stairs"), 0.6), turned(bundled("six-stairs"), 0.6)
    for surface in message["terrain"]:
        surface["orientation_wxyz"] = (length * np.array([np.cos(0.3), 0.0004, 0.0, np.sin(0.3)])).tolist()
        surface["yaw_rad"] = None
    for one, other in zip(
        vary_scenario(aslant, {"stride": 0.33})["terrain"],
        vary_scenario(message, {"stride": 0.33})["terrain"],
        strict=True,
    ):
        np.testing.assert_allclose(other["size_m"], one["size_m"], atol=1e-12)
        np.testing.assert_allclose(other["center_m"], one["center_m"], atol=1e-12)


def test_a_box_that_leans_by_more_than_a_milliradian_cannot_be_stretched() -> None:
    leaning = bundled("six-stairs")
    leaning["terrain"][1]["orientation_wxyz"] = [1.0, 0.0006, 0.0, 0.0]  # half the angle
    with pytest.raises(InvalidInput, match="is tilted"):
        vary_scenario(leaning, {"stride": 0.33})


def test_timing_is_a_factor_and_friction_that_of_every_surface() -> None:
    before = bundled("stepping-stones")
    before["terrain"][1]["friction"] = 0.9
    after = vary_scenario(before, {"timing": 0.5, "friction": 0.4})
    assert [p["duration_s"] for p in after["phases"]] == [p["duration_s"] / 2 for p in before["phases"]]
    assert after["friction"] == 0.4
    assert all(surface["friction"] is None for surface in after["terrain"])
    assert before["terrain"][1]["friction"] == 0.9


@pytest.mark.parametrize(
    ("name", "field", "value", "words"),
    [
        ("stepping-stones", "stride", 0.5, "is tilted"),
        ("stairs-with-rail", "height", 0.1, "rail"),
        ("long-stride", "height", 0.1, "no foot moves in that direction"),
        ("stand-up", "stride", 0.1, "no foot moves in that direction"),
        ("long-stride", "stride", -0.3, "not above zero"),
        ("long-stride", "timing", float("nan"), "not above zero"),
    ],
)
def test_what_cannot_be_varied_says_why(name: str, field: Any, value: float, words: str) -> None:
    with pytest.raises(InvalidInput, match=words) as refusal:
        vary_scenario(bundled(name), {field: value})
    assert refusal.value.code == "sweep-field-impossible"
    assert refusal.value.faults[0].where == f"vary.{field}"
