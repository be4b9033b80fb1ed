"""``POST /scenarios/check`` with ``body_checked``: what the whole body says beside the judge."""

import json
import math
import time
from typing import Any

import httpx
import pytest

from experiments.terrains.steps import Pose, Steps, wide_ground
from stridelab.contacts.scenarios.parts import TALOS, Timing
from stridelab.machine.models_folder import models_dir
from stridelab.service.samples.scenarios import bundled_scenarios
from support.robots.scenario_bodies import everywhere, one_step, with_contact
from support.service.web_server import refusal_code

CHECK = "/api/v1/scenarios/check"


def check_scenario(http: httpx.Client, body: dict[str, Any], **query: Any) -> dict[str, Any]:
    answer = http.post(CHECK, json=body, params={"body_checked": True, **query}, timeout=120)
    assert answer.status_code == 200, answer.text
    return dict(answer.json())


def test_the_body_is_checked_only_if_the_request_says_so(http: httpx.Client) -> None:
    plain = http.post(CHECK, json=one_step()).json()
    assert [one["body"] for one in plain["phases"]] == ["not-asked"] * 3
    whole = check_scenario(http, one_step())
    assert [(one["phase"], one["body"]) for one in whole["phases"]] == [(k, "reachable") for k in range(3)]
    assert all(one["reason"] is one["link_poses"] is None for one in whole["phases"])
    del plain["phases"], whole["phases"]
    assert whole == plain, "all else is the judge's answer"


def stretched() -> dict[str, Any]:
    """HRP-2's left foot 1.03 m from its right one: what the learned reach calls valid, with 5 cm to spare."""
    body: dict[str, Any] = json.loads(
        (models_dir() / "scenarios" / "stairs-with-rail-hrp2.json").read_text(encoding="utf-8")
    )
    for phase in body["phases"][6:11]:
        for contact in phase["contacts"]:
            if contact["effector"] == "left_foot":
                contact["position_m"] = [-0.857, 0.467, 0.0]
    return body


def test_a_scenario_within_the_learned_reach_that_no_body_can_do_is_invalid(http: httpx.Client) -> None:
    body = stretched()
    plain = http.post(CHECK, json=body).json()
    assert (plain["valid"], plain["errors"]) == (True, [])
    whole = check_scenario(http, body)
    while any(warning["code"] == "body-unfinished" for warning in whole["warnings"]):
        whole = check_scenario(http, body)
    assert whole["valid"] is False
    out = [one for one in whole["phases"] if one["body"] == "unreachable"]
    assert [one["phase"] for one in out] == [10]
    assert "left foot" in out[0]["reason"]
    assert any(limit.startswith("LLEG_JOINT") for limit in out[0]["limits"])
    assert [fault["where"] for fault in whole["errors"]] == ["phases[10].contacts[left_foot]"]
    assert whole["errors"][0]["message"] == out[0]["reason"]


def test_a_drag_that_no_body_can_follow_is_invalid(http: httpx.Client) -> None:
    """All stances are reachable: the check of the motion follows in further requests."""
    body = bundled_scenarios()["flat-walk"]
    everywhere(body, "left_foot", (0.0, 0.09, 0.0), position_m=[0.473, 0.526, 0.0])
    first = check_scenario(http, body, within_s=0.03)
    assert (first["valid"], first["warnings"][-1]["code"]) == (True, "body-unfinished")
    whole = first
    while any(warning["code"] == "body-unfinished" for warning in whole["warnings"]):
        whole = check_scenario(http, body, within_s=0.03)
    assert whole["valid"] is False
    (out,) = (one for one in whole["phases"] if one["body"] == "unreachable")
    assert "the centre of mass is" in out["reason"]
    assert [fault["where"] for fault in whole["errors"]] == [f"phases[{out['phase']}]"]
    assert whole["errors"][0]["message"] == out["reason"]


def test_shoes_that_overlap_are_errors_of_the_check_as_of_a_plan(http: httpx.Client) -> None:
    def turned(angle_deg: float) -> dict[str, Any]:
        steps = Steps.from_pose(TALOS, Timing(1.0, 1.0, 0.2), Pose(0.0, 0.0))
        steps.move_foot("left_foot", Pose(0.0, 0.0, math.radians(angle_deg)))
        return dict(steps.as_scenario("turn", "", [wide_ground()]))

    plain = http.post(CHECK, json=turned(30.0)).json()
    assert (plain["valid"], plain["errors"]) == (True, [])
    whole = check_scenario(http, turned(30.0))
    assert whole["valid"] is False
    (fault,) = (one for one in whole["errors"] if "shoe" in one["message"])
    assert fault["where"] == "phases[2].contacts[right_foot]"
    assert "overlaps with that of left_foot by" in fault["message"]
    assert not [one for one in check_scenario(http, turned(20.0))["errors"] if "shoe" in one["message"]]


def test_a_hand_a_metre_and_a_half_away_is_unreachable(http: httpx.Client) -> None:
    """The validation refuses it, too; the body is checked all the same."""
    body = one_step()
    body["terrain"].append({"name": "table", "kind": "box", "center_m": [0.0, -1.6, 0.45], "size_m": [0.4, 0.4, 0.9]})
    body["phases"][0]["contacts"].append({"effector": "right_hand", "position_m": [0.0, -1.5, 0.9]})
    check = check_scenario(http, body)
    assert check["valid"] is False
    assert [one["body"] for one in check["phases"]] == ["unreachable", "reachable", "reachable"]
    assert check["phases"][0]["limits"][0] == "right_hand"
    assert "right hand" in check["phases"][0]["reason"]


def test_the_posture_of_a_phase_stands_on_its_contacts(http: httpx.Client) -> None:
    facts = http.get("/api/v1/robots/talos", timeout=120).json()
    check = check_scenario(http, one_step(), posture_of=1)
    poses = [one["link_poses"] for one in check["phases"]]
    assert poses[0] is poses[2] is None
    assert len(poses[1]) == len(facts["links"])
    base, usual = poses[1][0], facts["link_poses"][0]
    assert base[2] == pytest.approx(usual[2], abs=0.15)
    assert len(check_scenario(http, one_step(), posture_of=7)["phases"]) == 3
    for wrong in ("-1", "x"):
        refused = http.post(CHECK, json=one_step(), params={"body_checked": True, "posture_of": wrong})
        assert refusal_code(refused) == (422, "invalid-request")


def test_contacts_that_are_invalid_are_not_checked_for_the_body(http: httpx.Client) -> None:
    body = with_contact(0, 0, effector="tail")
    body["phases"][1]["contacts"] = []
    check = check_scenario(http, body)
    assert check["valid"] is False
    assert [one["body"] for one in check["phases"]] == ["not-asked", "not-asked", "reachable"]
    unknown_robot = check_scenario(http, one_step(robot="nobody"))
    assert [one["body"] for one in unknown_robot["phases"]] == ["not-asked"] * 3


def stored_check(http: httpx.Client, scenario_id: str) -> dict[str, Any]:
    """The check of a stored scenario once it is complete."""
    while True:
        answer = http.get(f"/api/v1/scenarios/{scenario_id}/check", timeout=120)
        assert answer.status_code == 200, answer.text
        check = dict(answer.json())
        if all(warning["code"] != "body-unfinished" for warning in check["warnings"]):
            return check
        assert {one["body"] for one in check["phases"]} == {"not-asked"}
        time.sleep(0.1)


def test_a_stored_scenario_has_the_verdict_of_the_body(http: httpx.Client) -> None:
    added = http.post("/api/v1/scenarios", json=stretched())
    assert added.status_code == 201, added.text
    check = stored_check(http, added.json()["id"])
    assert check["valid"] is False
    assert [one["phase"] for one in check["phases"] if one["body"] == "unreachable"] == [10]
    assert [fault["where"] for fault in check["errors"]] == ["phases[10].contacts[left_foot]"]
    replaced = http.put(f"/api/v1/scenarios/{added.json()['id']}", json=one_step())
    assert replaced.status_code == 200, replaced.text
    check = stored_check(http, added.json()["id"])
    assert (check["valid"], [one["body"] for one in check["phases"]]) == (True, ["reachable"] * 3)
    unknown = http.get(f"/api/v1/scenarios/{'0' * 32}/check")
    assert refusal_code(unknown) == (404, "scenario-not-found")


def test_the_phase_that_is_shown_comes_first_and_the_others_in_further_requests(http: httpx.Client) -> None:
    """With no time for more, each request checks one phase that was not checked before, the nearest to that phase."""
    body = one_step()
    for phase in body["phases"]:
        for contact in phase["contacts"]:
            contact["position_m"][0] += 0.0123
    bodies = [
        [one["body"] for one in check_scenario(http, body, posture_of=2, within_s=1e-6)["phases"]] for _ in range(3)
    ]
    assert bodies[0] == ["not-asked", "not-asked", "reachable"]
    assert bodies[1] == ["not-asked", "reachable", "reachable"]
    assert bodies[2] == ["reachable"] * 3
