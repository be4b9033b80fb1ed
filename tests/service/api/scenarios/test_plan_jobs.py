"""Jobs of the robot wing: which scenario they belong to, and what is refused before they are accepted."""

import io
import json
import zipfile

import httpx
import pytest

from stridelab.service.samples import scenarios
from stridelab.service.samples.scenario_bodies import ONE_STEP, STANDING, STANDING_AHEAD
from support.robots.scenario_bodies import add_scenario, one_step, with_contact
from support.service.stored_rows import publish_result, start_job
from support.service.web_server import Served, fault_places, refusal_code

JOBS = "/api/v1/jobs"
PLAN = f"{JOBS}/plan-motion"
CONTACTS = {"robot": "talos", "terrain": ONE_STEP["terrain"], "start": STANDING, "goal": STANDING_AHEAD}


@pytest.fixture
def scenario_id(service: Served) -> str:
    return service.run(add_scenario(service.parts))


def test_a_plan_belongs_to_its_scenario(http: httpx.Client, service: Served, scenario_id: str) -> None:
    first = http.post(PLAN, json={"scenario_id": scenario_id})
    assert first.status_code == 202, first.text
    assert (first.json()["scenario_id"], first.json()["recording_id"]) == (scenario_id, None)
    second = http.post(PLAN, json={"scenario_id": scenario_id, "whole_body": False}).json()
    other = http.post(PLAN, json={"scenario_id": service.run(add_scenario(service.parts))}).json()

    def listed(**params: str) -> list[str]:
        return [item["id"] for item in http.get(JOBS, params=params).json()["items"]]

    assert listed(scenario_id=scenario_id) == [second["id"], first.json()["id"]]
    assert listed(scenario_id=other["scenario_id"]) == [other["id"]]
    assert listed(scenario_id=scenario_id, kind="estimate-com") == []
    assert listed(scenario_id="nope") == []
    assert http.get(f"{JOBS}/{other['id']}").json()["about"] == one_step()["name"]
    assert refusal_code(http.get(JOBS, params={"scenario_id": "a\x00"})) == (422, "invalid-request")

    assert http.delete(f"/api/v1/scenarios/{scenario_id}").status_code == 204
    job = http.get(f"{JOBS}/{second['id']}").json()
    assert (job["state"], job["scenario_id"]) == ("queued", None)


def test_the_newest_plan_of_each_of_several_scenarios(http: httpx.Client, service: Served) -> None:
    scenario_ids = [service.run(add_scenario(service.parts)) for _ in range(3)]
    plans = [http.post(PLAN, json={"scenario_id": scenario_ids[k]}).json()["id"] for k in (0, 1, 0, 2)]

    def listed(**params: str | list[str]) -> list[str]:
        answer = http.get(JOBS, params={"scenario_id": scenario_ids[:2], "one_per_scenario": "true", **params})
        return [item["id"] for item in answer.json()["items"]]

    assert listed(one_per_scenario="false") == [plans[2], plans[1], plans[0]]
    assert listed() == [plans[2], plans[1]]
    service.run(publish_result(service.parts, service.run(start_job(service.parts, plans[0]))))
    assert listed(state="succeeded") == [plans[0]], "the newest of those that match"
    first = http.get(JOBS, params={"scenario_id": scenario_ids, "one_per_scenario": "true", "limit": 2}).json()
    assert [item["id"] for item in first["items"]] == [plans[3], plans[2]]
    rest = http.get(JOBS, params={"scenario_id": scenario_ids, "one_per_scenario": "true", "cursor": first["next"]})
    assert [item["id"] for item in rest.json()["items"]] == [plans[1]]


def test_a_plan_of_a_scenario_in_the_request_belongs_to_no_stored_scenario(http: httpx.Client) -> None:
    submitted = http.post(PLAN, json={"scenario": one_step()})
    assert submitted.status_code == 202, submitted.text
    assert submitted.json()["scenario_id"] is None


@pytest.mark.parametrize("identifier", ["f" * 32, "nope", "a b", "\n", "", "x" * 65, "'; DROP TABLE scenario; --"])
def test_an_unknown_scenario_is_refused_at_once(http: httpx.Client, identifier: str) -> None:
    assert refusal_code(http.post(PLAN, json={"scenario_id": identifier})) == (404, "scenario-not-found")


def test_an_unknown_scenario_is_not_taken_for_a_recording(http: httpx.Client) -> None:
    answer = http.post(f"{JOBS}/estimate-com", json={"recording_id": "scenario_id"})
    assert refusal_code(answer) == (404, "recording-not-found")


def test_a_scenario_that_the_robot_cannot_do_is_refused_before_any_solver(http: httpx.Client) -> None:
    before = http.get(JOBS, params={"kind": "plan-motion"}).json()
    answer = http.post(PLAN, json={"scenario": with_contact(0, 1, position_m=[0.0, -0.09, 0.3])})
    assert refusal_code(answer) == (422, "scenario-invalid")
    assert any(place.startswith("phases[0].contacts[right_foot]") for place in fault_places(answer))
    assert "right_foot" in answer.json()["detail"]
    assert http.get(JOBS, params={"kind": "plan-motion"}).json() == before


@pytest.mark.parametrize(
    ("kind", "body", "where"),
    [
        ("plan-motion", {}, "body"),
        ("plan-motion", {"scenario_id": "flat-walk", "scenario": one_step()}, "body"),
        ("plan-motion", {"scenario_id": "flat-walk", "whole_body": False, "replay": True}, "body"),
        ("plan-motion", {"scenario_id": 7}, "scenario_id"),
        ("plan-motion", {"scenario_id": "flat-walk", "replay": {"friction": 0}}, "replay.friction"),
        ("plan-motion", {"scenario_id": "flat-walk", "replay": {"sensors": "none"}}, "replay.sensors"),
        (
            "plan-motion",
            {"scenario_id": "flat-walk", "replay": {"pushes": [{"time_s": 1}]}},
            "replay.pushes.0.impulse_ns",
        ),
        ("plan-motion", {"scenario_id": "flat-walk", "solver": "magic"}, "solver"),
        ("plan-motion", {"scenario": {**one_step(), "friction": "-1"}}, "scenario.friction"),
        ("plan-motion", {"scenario_id": "flat-walk", "measure": "gaussian"}, "measure"),
        ("plan-motion", {"scenario_id": "flat-walk", "free_durations": True, "solver": "fatrop"}, "free_durations"),
        ("plan-motion", {"scenario_id": "flat-walk", "duration_range": [1.2, 1.4]}, "duration_range.0"),
        ("plan-motion", {"scenario_id": "flat-walk", "shape": "cubic", "formulation": "wrench"}, "shape"),
        ("plan-motion", {"scenario_id": "flat-walk", "time_limit_s": 0}, "time_limit_s"),
        ("plan-motion", {"scenario_id": "flat-walk", "weights": {"likelihood": -1.0}}, "weights"),
        ("learn-reachability", {"robot": "nao"}, "robot"),
        ("plan-receding", {}, "body"),
        ("plan-receding", {"scenario_id": "flat-walk", "period_s": 0.9, "horizon_s": 0.8}, "body"),
        ("plan-receding", {"scenario_id": "flat-walk", "horizon_s": 60.0}, "horizon_s"),
        ("plan-receding", {"scenario_id": "flat-walk", "pushes": [{"time_s": 1.0}]}, "pushes.0.velocity_m_s"),
        ("plan-contacts", {**CONTACTS, "robot": "nao"}, "robot"),
        ("plan-contacts", {**CONTACTS, "terrain": []}, "terrain"),
        ("plan-contacts", {**CONTACTS, "goal": {"contacts": []}}, "goal.contacts"),
        ("plan-contacts", {**CONTACTS, "friction": None}, "friction"),
        ("learn-reachability", {"robot": "../talos"}, "robot"),
        ("learn-reachability", {"robot": "talos", "effectors": ["left_foot", "tail"]}, "effectors.1"),
        ("learn-reachability", {"robot": "talos", "effectors": []}, "effectors"),
        ("learn-reachability", {"robot": "talos", "samples": 10**9}, "samples"),
        ("learn-reachability", {"robot": "talos", "measure": "../uniform"}, "measure"),
    ],
)
def test_an_invalid_input_is_named(http: httpx.Client, kind: str, body: object, where: str) -> None:
    answer = http.post(f"{JOBS}/{kind}", json=body)
    assert refusal_code(answer) == (422, "invalid-request")
    assert fault_places(answer) == [where]


@pytest.mark.parametrize("stored", [True, False])
def test_a_push_that_does_not_fit_is_named_and_is_no_job(http: httpx.Client, scenario_id: str, *, stored: bool) -> None:
    before = http.get(JOBS, params={"kind": "plan-motion"}).json()
    source = {"scenario_id": scenario_id} if stored else {"scenario": one_step()}
    pushes = [
        {"time_s": 0.1, "impulse_ns": [0, 5, 0], "link": "base_link"},
        {"time_s": 1e3, "impulse_ns": [0, 5, 0], "link": "nose"},
    ]
    answer = http.post(PLAN, json={**source, "replay": {"pushes": pushes}})
    assert refusal_code(answer) == (422, "replay-invalid")
    assert fault_places(answer) == ["replay.pushes.1.time_s", "replay.pushes.1.link"]
    assert "leg_left_6_link" in answer.json()["errors"][1]["message"]
    assert http.get(JOBS, params={"kind": "plan-motion"}).json() == before
    assert http.post(PLAN, json={**source, "replay": {"pushes": pushes[:1]}}).status_code == 202


@pytest.mark.parametrize("duration_s", [0.0, -0.4, 1e-3, 1e4])
@pytest.mark.parametrize("kind", ["plan-motion", "plan-receding"])
def test_a_phase_that_takes_no_time_is_named_and_is_no_job(http: httpx.Client, kind: str, duration_s: float) -> None:
    before = http.get(JOBS, params={"kind": kind}).json()
    body = one_step()
    body["phases"][1] = {**body["phases"][1], "duration_s": duration_s}
    answer = http.post(f"{JOBS}/{kind}", json={"scenario": body})
    assert refusal_code(answer) == (422, "scenario-invalid")
    assert "phases[1].duration_s" in fault_places(answer)
    assert http.get(JOBS, params={"kind": kind}).json() == before


def test_contacts_are_planned_without_a_stored_scenario(http: httpx.Client) -> None:
    answer = http.post(f"{JOBS}/plan-contacts", json=CONTACTS)
    assert answer.status_code == 202, answer.text
    assert (answer.json()["kind"], answer.json()["scenario_id"]) == ("plan-contacts", None)


def stance(effector: str = "right_foot", **change: object) -> dict[str, object]:
    """The start with one contact changed."""
    contacts = [{**c, **(change if c["effector"] == effector else {})} for c in STANDING["contacts"]]
    return {"contacts": contacts}


@pytest.mark.parametrize("end", ["start", "goal"])
@pytest.mark.parametrize(
    ("wrong", "where", "word"),
    [
        (stance(position_m=[0.0, -0.09, 0.3]), ".contacts[right_foot]", "above"),
        (stance(position_m=[0.0, -0.09, -0.1]), ".contacts[right_foot]", ""),
        (stance(position_m=[0.0, 0.09, 0.0]), ".contacts[right_foot]", "left_foot"),
        (stance(effector="left_foot", position_m=[0.0, 9.0, 0.0]), ".contacts[left_foot]", ""),
        (stance(effector="right_foot", orientation_wxyz=[0.0, 0.0, 0.0, 0.0]), ".contacts[right_foot]", "zero"),
        ({"contacts": [*STANDING["contacts"], STANDING["contacts"][0]]}, ".contacts[left_foot]", "twice"),
        ({"contacts": STANDING["contacts"][:1]}, ".contacts", "right_foot must be in contact"),
    ],
)
def test_ends_that_the_robot_cannot_hold_are_no_job(
    http: httpx.Client, end: str, wrong: dict[str, object], where: str, word: str
) -> None:
    before = http.get(JOBS, params={"kind": "plan-contacts"}).json()
    answer = http.post(f"{JOBS}/plan-contacts", json={**CONTACTS, end: wrong})
    assert refusal_code(answer) == (422, "stance-invalid")
    assert answer.headers["content-type"] == "application/problem+json"
    assert f"{end}{where}" in fault_places(answer)
    assert any(word in fault["message"] for fault in answer.json()["errors"])
    assert end in answer.json()["detail"]
    assert http.get(JOBS, params={"kind": "plan-contacts"}).json() == before


@pytest.mark.parametrize("end", ["start", "goal"])
def test_too_little_friction_names_the_end_that_cannot_be_held(http: httpx.Client, end: str) -> None:
    terrain = [{**surface, "friction": 0.0} for surface in ONE_STEP["terrain"]]
    for change in ({"friction": -0.5}, {"terrain": terrain}):
        answer = http.post(f"{JOBS}/plan-contacts", json={**CONTACTS, **change})
        assert refusal_code(answer) == (422, "stance-invalid")
        assert f"{end}.contacts[left_foot]" in fault_places(answer)


def test_reachability_is_learned_for_a_known_robot(http: httpx.Client) -> None:
    answer = http.post(f"{JOBS}/learn-reachability", json={"robot": "talos", "effectors": ["left_foot"]})
    assert answer.status_code == 202, answer.text
    assert (answer.json()["scenario_id"], answer.json()["recording_id"]) == (None, None)


def test_the_bundle_of_a_plan_holds_its_scenario_as_it_was(http: httpx.Client, service: Served) -> None:
    service.run(scenarios.seed_scenarios(service.parts.engine))
    job_id = http.post(PLAN, json={"scenario_id": scenarios.EXAMPLE_ID}).json()["id"]
    attempt = service.run(start_job(service.parts, job_id))
    planned = json.dumps(one_step()).encode()
    files = [("scenario.json", "application/json", planned), ("poses.f32", "application/octet-stream", b"\0" * 28)]
    service.run(publish_result(service.parts, attempt, files))
    bundle = http.get(f"{JOBS}/{job_id}/bundle.zip")
    with zipfile.ZipFile(io.BytesIO(bundle.content)) as archive:
        assert archive.read("artifacts/scenario.json") == planned
        assert json.loads(archive.read("input.json")) == {"scenario_id": scenarios.EXAMPLE_ID}
        assert not any(name.startswith("input/") for name in archive.namelist())
