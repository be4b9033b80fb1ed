"""Durations of phases that a scenario omits."""

import json
from copy import deepcopy
from typing import Any

import pytest
from pydantic import ValidationError

from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.planner.planner import ContactPlanner
from stridelab.contacts.scenarios.stairs import six_stairs, stairs_with_rail
from stridelab.reachability.planner_limits import planner_limits
from stridelab.schemas.scenarios import ENDS_S, REST_S, Scenario

PLANNER = ContactPlanner(effector_shapes("talos"), planner_limits("talos"))


def durations_s(body: dict[str, Any]) -> list[float]:
    return [phase.duration_s for phase in Scenario.model_validate(body).phases]


def without_durations(body: dict[str, Any]) -> dict[str, Any]:
    bare = deepcopy(body)
    for phase in bare["phases"]:
        del phase["duration_s"]
    return bare


@pytest.mark.parametrize("build", [six_stairs, stairs_with_rail], ids=lambda build: build.__name__)
def test_omitted_durations_are_those_of_the_contact_planner(build: Any) -> None:
    body = build()
    first, last = ({"contacts": body["phases"][k]["contacts"]} for k in (0, -1))
    asked = {key: body[key] for key in ("robot", "terrain", "friction")} | {"start": first, "goal": last}
    planned = PLANNER.plan(asked).scenario
    assert durations_s(without_durations(planned)) == pytest.approx(durations_s(planned))


def test_given_durations_stay() -> None:
    body = six_stairs()
    del body["phases"][0]["duration_s"]
    del body["phases"][2]["duration_s"]
    given = [phase.get("duration_s") for phase in body["phases"]]
    chosen = durations_s(body)
    assert (chosen[0], chosen[2]) == (ENDS_S, REST_S)
    assert [s for k, s in enumerate(chosen) if k not in (0, 2)] == [s for k, s in enumerate(given) if k not in (0, 2)]


def test_a_far_step_lasts_longer_in_proportion() -> None:
    feet = [{"effector": f"{side}_foot", "position_m": [0.0, y, 0.0]} for side, y in (("left", 0.1), ("right", -0.1))]
    ahead = {"effector": "right_foot", "position_m": [1.05, -0.1, 0.0]}
    stances = [feet, feet[:1], [feet[0], ahead]]
    body = {"name": "Far", "robot": "talos", "terrain": [], "phases": [{"contacts": c} for c in stances]}
    assert durations_s(body) == pytest.approx([ENDS_S, 0.7 * 1.4 * 1.05 / 0.7, ENDS_S])


def test_the_service_reads_json_strictly_with_and_without_durations() -> None:
    for body in (six_stairs(), without_durations(six_stairs())):
        read = Scenario.model_validate_json(json.dumps(body), strict=True)
        assert all(phase.duration_s > 0.0 for phase in read.phases)


def test_null_is_no_duration() -> None:
    body = six_stairs()
    body["phases"][3]["duration_s"] = None
    with pytest.raises(ValidationError) as caught:
        Scenario.model_validate(body)
    assert [item["loc"] for item in caught.value.errors()] == [("phases", 3, "duration_s")]


def test_answers_have_durations_that_requests_may_omit() -> None:
    described = Scenario.model_json_schema()["$defs"]["ScenarioPhase"]
    assert described["required"] == ["contacts"]
    assert "default" not in described["properties"]["duration_s"]
    read = Scenario.model_validate(without_durations(six_stairs()))
    assert all(phase["duration_s"] > 0.0 for phase in json.loads(read.model_dump_json())["phases"])
