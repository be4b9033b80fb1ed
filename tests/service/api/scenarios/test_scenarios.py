"""Scenarios over HTTP: stored, listed, replaced, deleted; bundled ones are read-only; nonsense is named, not stored."""

import json
from collections.abc import Callable
from pathlib import Path

import httpx
import pytest

from stridelab.service.api.scenarios import repository
from stridelab.service.samples import scenarios
from support.robots.scenario_bodies import add_scenario, one_step, with_contact
from support.service.database import TestDatabases
from support.service.web_server import Served, fault_places, refusal_code, served

SCENARIOS = "/api/v1/scenarios"
CHECK = f"{SCENARIOS}/check"


@pytest.fixture(scope="module")
def seeded(service: Served) -> Served:
    service.run(scenarios.seed_scenarios(service.parts.engine))
    return service


def stored(http: httpx.Client) -> list[str]:
    return [item["id"] for item in http.get(SCENARIOS, params={"limit": 200}).json()["items"]]


def test_a_scenario_from_storing_to_deletion(http: httpx.Client) -> None:
    answer = http.post(SCENARIOS, json=one_step(description="two\nlines"))
    assert answer.status_code == 201, answer.text
    stored = answer.json()
    path = f"{SCENARIOS}/{stored['id']}"
    assert answer.headers["location"] == path
    assert (stored["name"], stored["description"], stored["bundled"], stored["owner"]) == (
        "One step",
        "two\nlines",
        False,
        None,
    )
    assert stored["phases"][2]["contacts"][0]["position_m"] == [0.2, 0.09, 0.0]
    assert stored["phases"][0]["contacts"][0]["orientation_wxyz"] == [1.0, 0.0, 0.0, 0.0]
    assert http.get(path).json() == stored

    other = http.put(path, json=one_step(name="Slower")).json()
    assert (other["id"], other["name"], other["description"]) == (stored["id"], "Slower", "")
    assert other["created_at"] == stored["created_at"]
    assert other["updated_at"] > stored["updated_at"] == stored["created_at"]
    assert http.get(path).json() == other

    deletion = http.delete(path)
    assert (deletion.status_code, deletion.content) == (204, b"")
    for method in ("GET", "DELETE"):
        assert refusal_code(http.request(method, path)) == (404, "scenario-not-found")
    assert refusal_code(http.put(path, json=one_step())) == (404, "scenario-not-found")


def test_a_downloaded_scenario_can_be_sent_again(seeded: Served, http: httpx.Client) -> None:
    bundled = http.get(f"{SCENARIOS}/six-stairs").json()
    copy = http.post(SCENARIOS, json={**bundled, "name": "Copy"})
    assert copy.status_code == 201, copy.text
    own = copy.json()
    assert own["phases"] == bundled["phases"]
    assert (own["id"] != "six-stairs", own["bundled"], own["owner"]) == (True, False, None)
    replaced = http.put(f"{SCENARIOS}/{own['id']}", json={**own, "name": "Again", "id": "other", "owner": "other"})
    assert replaced.status_code == 200, replaced.text
    assert {name: replaced.json()[name] for name in ("id", "owner", "name")} == {
        "id": own["id"],
        "owner": None,
        "name": "Again",
    }


def test_scenarios_of_other_users_are_not_overwritten(http: httpx.Client) -> None:
    stored = http.post(SCENARIOS, json=one_step()).json()
    path = f"{SCENARIOS}/{stored['id']}"
    first = http.get(path).headers["etag"]
    assert first == f'"{stored["updated_at"]}"'
    theirs = http.put(path, json=one_step(name="Theirs"), headers={"If-Match": first})
    assert theirs.status_code == 200
    ours = http.put(path, json=one_step(name="Ours"), headers={"If-Match": first})
    assert refusal_code(ours) == (412, "scenario-changed")
    assert http.get(path).json() == theirs.json()
    for named in ("{now}", f"{first}, {{now}}", "*"):
        now = theirs.headers["etag"]
        theirs = http.put(path, json=one_step(name="Theirs"), headers={"If-Match": named.format(now=now)})
        assert theirs.status_code == 200
        assert theirs.headers["etag"] == http.get(path).headers["etag"] != now
    assert http.put(path, json=one_step(name="Ours")).json()["name"] == "Ours"


def test_pages_of_the_list_hold_bundled_ones_too(postgres: TestDatabases, tmp_path: Path) -> None:
    with postgres.fresh() as url, served(url, tmp_path) as service, service.http() as http:
        service.run(scenarios.seed_scenarios(service.parts.engine))
        shipped = sorted(scenarios.bundled_scenarios(), reverse=True)
        ids = [http.post(SCENARIOS, json=one_step()).json()["id"] for _ in range(3)]
        listed, cursor, pages = [], None, 0
        while pages == 0 or cursor:
            page = http.get(SCENARIOS, params={"limit": 2, **({"cursor": cursor} if cursor else {})}).json()
            assert 0 < len(page["items"]) <= 2
            listed += [(item["id"], item["bundled"]) for item in page["items"]]
            cursor, pages = page["next"], pages + 1
        assert listed == [(each, False) for each in ids[::-1]] + [(each, True) for each in shipped]
        for limit in ("0", "201", "x"):
            assert refusal_code(http.get(SCENARIOS, params={"limit": limit})) == (422, "invalid-request")
        assert refusal_code(http.get(SCENARIOS, params={"cursor": "x"})) == (422, "invalid-cursor")


def test_a_page_of_very_long_scenarios_ends_early(
    postgres: TestDatabases, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(repository, "PAGE_PARTS", 20)  # one step has 9: a terrain, 3 phases, 5 contacts
    with postgres.fresh() as url, served(url, tmp_path) as service, service.http() as http:
        ids = [service.run(add_scenario(service.parts)) for _ in range(5)]
        first = http.get(SCENARIOS).json()
        assert [item["id"] for item in first["items"]] == ids[:2:-1]
        rest = http.get(SCENARIOS, params={"cursor": first["next"], "limit": 1}).json()
        assert [item["id"] for item in rest["items"]] == ids[2:1:-1]
        monkeypatch.setattr(repository, "PAGE_PARTS", 0)  # a page holds one at least
        alone = http.get(SCENARIOS, params={"cursor": rest["next"]}).json()
        assert [item["id"] for item in alone["items"]] == [ids[1]]
        last = http.get(SCENARIOS, params={"cursor": alone["next"]}).json()
        assert ([item["id"] for item in last["items"]], last["next"]) == ([ids[0]], None)


@pytest.mark.parametrize("stem", sorted(scenarios.bundled_scenarios()))
def test_bundled_scenarios_are_valid_and_read_only(seeded: Served, http: httpx.Client, stem: str) -> None:
    path = f"{SCENARIOS}/{stem}"
    before = http.get(path).json()
    body = {k: v for k, v in before.items() if k not in {"id", "created_at", "updated_at", "bundled", "owner"}}
    assert before["bundled"] is True
    check = http.post(CHECK, json=body).json()
    assert (check["valid"], check["errors"]) == (True, [])
    assert len(check["support_region_m"]) == len(check["support"]) == len(body["phases"])
    assert min(each["margin_m"] for each in check["support"]) > 0.05, (
        "slow walking and climbing: it could stop anywhere"
    )
    assert check["duration_s"] == pytest.approx(sum(phase["duration_s"] for phase in body["phases"]))
    assert refusal_code(http.delete(path)) == (409, "scenario-read-only")
    assert refusal_code(http.put(path, json=one_step())) == (409, "scenario-read-only")
    assert http.get(path).json() == before
    copy = http.post(SCENARIOS, json=body)
    assert copy.status_code == 201
    assert copy.json()["bundled"] is False


LEFT, FLOOR = one_step()["phases"][0]["contacts"][0], one_step()["terrain"][0]
CRATE = {"name": "crate", "kind": "box", "center_m": [0.35, 0.09, 0.0], "size_m": [0.3, 0.3, 0.3]}
PILLAR = {"name": "stair", "kind": "box", "center_m": [0.7, 0.09, 7.5], "size_m": [0.6, 0.3, 15.0]}
BROKEN = {
    "in the air": (with_contact(0, 1, position_m=[0.0, -0.09, 0.3]), "phases[0].contacts[right_foot]"),
    "beside the floor": (with_contact(2, 0, position_m=[50.0, 0.09, 0.0]), "phases[2].contacts[left_foot]"),
    "out of reach": (with_contact(2, 0, position_m=[1.9, 0.09, 0.0]), "phases[2]"),
    "a third foot": (with_contact(0, 0, effector="third_foot"), "phases[0].contacts[third_foot]"),
    "no support": (one_step(phases=[{"duration_s": 1.0, "contacts": []}]), "phases[0]"),
    "no phases": (one_step(phases=[]), "phases"),
    "time runs backwards": (
        one_step(phases=[{"duration_s": -0.5, "contacts": one_step()["phases"][0]["contacts"]}]),
        "phases[0].duration_s",
    ),
    "no such robot": (one_step(robot="../../etc/passwd"), "robot"),
    "no quaternion": (with_contact(0, 0, orientation_wxyz=[0.0, 0.0, 0.0, 0.0]), "phases[0].contacts[left_foot]"),
    "one effector twice": (
        one_step(phases=[{"duration_s": 1.0, "contacts": [*one_step()["phases"][0]["contacts"], LEFT]}]),
        "phases[0].contacts[left_foot]",
    ),
    "through a box": (one_step(terrain=[FLOOR, CRATE]), "phases[2].contacts[left_foot]"),
    "no friction": (one_step(friction=0.0), "phases[0].contacts[left_foot]"),
    "friction below 0": (one_step(friction=-0.3), "phases[0].contacts[left_foot]"),
    "a surface without friction": (one_step(terrain=[{**FLOOR, "friction": 0.0}]), "phases[0].contacts[left_foot]"),
    "a foot 150 m high": (with_contact(2, 0, position_m=[0.2, 0.09, 150.0]), "phases[2].contacts[left_foot]"),
    "a stair 150 m high": (one_step(terrain=[FLOOR, {**CRATE, "size_m": [0.3, 0.3, 150.0]}]), "terrain[1]"),
    "a stair of 15 cm in cm": (
        {**with_contact(2, 0, position_m=[0.7, 0.09, 15.0]), "terrain": [FLOOR, PILLAR]},
        "phases[2].contacts[left_foot]",
    ),
}


@pytest.mark.parametrize("name", BROKEN)
def test_an_infeasible_scenario_is_refused_and_not_stored(http: httpx.Client, name: str) -> None:
    body, where = BROKEN[name]
    before = stored(http)
    check = http.post(CHECK, json=body)
    assert check.status_code == 200, check.text
    assert check.json()["valid"] is False
    assert any(fault["where"].startswith(where) for fault in check.json()["errors"]), check.json()["errors"]
    refused = http.post(SCENARIOS, json=body)
    assert refusal_code(refused) == (422, "scenario-invalid")
    assert refused.json()["errors"] == check.json()["errors"]
    assert where in refused.json()["detail"] or len(check.json()["errors"]) > 1
    valid = http.post(SCENARIOS, json=one_step()).json()
    assert refusal_code(http.put(f"{SCENARIOS}/{valid['id']}", json=body)) == (422, "scenario-invalid")
    assert http.get(f"{SCENARIOS}/{valid['id']}").json() == valid
    http.delete(f"{SCENARIOS}/{valid['id']}")
    assert stored(http) == before


def test_a_length_that_is_not_in_metres_is_refused(http: httpx.Client) -> None:
    for name, words in (("a foot 150 m high", "lengths are in metres"), ("a stair of 15 cm in cm", "in metres?")):
        faults = http.post(CHECK, json=BROKEN[name][0]).json()["errors"]
        assert any(words in f["message"] for f in faults if f["where"] == BROKEN[name][1]), faults


def test_a_value_that_is_not_a_number_names_phase_and_effector(http: httpx.Client) -> None:
    nan, text_, far = [0.0, float("nan"), 0.0], [0.0, "x", 0.0], [0.0, 1e7, 0.0]
    for position, code in ((nan, "not-json"), (text_, "invalid-request"), (far, "invalid-request")):
        content = json.dumps(with_contact(2, 1, position_m=position))
        answer = http.post(SCENARIOS, content=content, headers={"Content-Type": "application/json"})
        assert refusal_code(answer)[1] == code
        assert fault_places(answer) == ["phases.2.contacts.1.position_m.1"]
        assert answer.json()["errors"][0]["message"].startswith("right_foot: ")
    answer = http.post(SCENARIOS, content='{"a": NaN, "a": 1}', headers={"Content-Type": "application/json"})
    assert (refusal_code(answer), fault_places(answer)) == ((400, "not-json"), ["body"])


def test_too_many_phases_are_counted(http: httpx.Client) -> None:
    answer = http.post(CHECK, json=one_step(phases=one_step()["phases"][:1] * 500))
    assert refusal_code(answer) == (422, "invalid-request")
    assert fault_places(answer) == ["phases"]
    assert "400" in answer.json()["errors"][0]["message"]
    assert "500" in answer.json()["errors"][0]["message"]


def test_a_check_returns_margins_and_support(http: httpx.Client) -> None:
    check = http.post(CHECK, json=one_step()).json()
    assert check["valid"] is True
    assert [(each["phase"], each["effector"]) for each in check["margins"]] == [
        (0, "left_foot"), (0, "right_foot"), (1, "right_foot"), (2, "left_foot"), (2, "right_foot"),
    ]  # fmt: skip
    assert all(each["surface"] == "floor" and abs(each["height_m"]) < 1e-9 for each in check["margins"])
    # the left sole reaches to y = 0.09 + 0.06, and the floor to y = 1
    assert check["margins"][0]["edge_m"] == pytest.approx(0.85)
    level, one_foot, astride = (each["margin_m"] for each in check["support"])
    assert (level, one_foot) == (pytest.approx(0.1, abs=1e-3), pytest.approx(0.06, abs=1e-3))
    assert astride > level
    double, single = check["support_region_m"][0], check["support_region_m"][1]
    assert {(abs(round(x, 6)), abs(round(y, 6))) for x, y in double} == {(0.1, 0.15)}
    assert {(round(x, 6), round(y, 6)) for x, y in single} == {(s * 0.1, t) for s in (1, -1) for t in (-0.15, -0.03)}


def deep(levels: int) -> str:
    return '{"name":' + "[" * levels + "]" * levels + "}"


def many_phases(count: int) -> str:
    phase = json.dumps({"duration_s": 1.0, "contacts": []})
    return json.dumps(one_step(phases=[])).replace('"phases": []', f'"phases": [{",".join([phase] * count)}]')


def text(change: Callable[[str], str]) -> str:
    return change(json.dumps(one_step()))


HOSTILE: dict[str, tuple[str, tuple[int, str], str | None]] = {
    "NaN": (text(lambda t: t.replace("0.2,", "NaN,", 1)), (400, "not-json"), "phases.2.contacts.0.position_m.0"),
    "Infinity": (text(lambda t: t.replace("0.5", "Infinity", 1)), (400, "not-json"), None),
    "1e308": (text(lambda t: t.replace('"position_m": [0.0,', '"position_m": [1e308,', 1)), (422, "invalid-request"),
              "phases.0.contacts.0.position_m.0"),
    "1e999": (text(lambda t: t.replace('"duration_s": 1.0', '"duration_s": 1e999', 1)), (422, "invalid-request"),
              "phases.0.duration_s"),
    "huge quaternion": (json.dumps(with_contact(0, 0, orientation_wxyz=[1e200, 0, 0, 0])), (422, "invalid-request"),
                        "phases.0.contacts.0.orientation_wxyz.0"),
    "1e5 phases": (many_phases(100_000), (413, "body-too-large"), None),
    "2e4 phases": (many_phases(20_000), (422, "invalid-request"), "phases"),
    "deep": (deep(100_000), (400, "not-json"), None),
    "less deep": (deep(500), (422, "invalid-request"), "body"),
    "deep enough to be read": (json.dumps(one_step(name=[[[[[]]]]])), (422, "invalid-request"), "name"),
    "an array": ("[]", (422, "invalid-request"), "body"),
    "null": ("null", (422, "invalid-request"), "body"),
    "nothing": ("", (400, "not-json"), None),
    "half": ('{"name": "x"', (400, "not-json"), None),
    "a number in quotes": (json.dumps(one_step(friction="0.3")), (422, "invalid-request"), "friction"),
    "true for a number": (json.dumps(one_step(friction=True)), (422, "invalid-request"), "friction"),
    "an unknown field": (json.dumps(one_step(length_m=2.0)), (422, "invalid-request"), "length_m"),
    "an unknown field below": (json.dumps(with_contact(1, 0, force_n=7)), (422, "invalid-request"),
                               "phases.1.contacts.0.force_n"),
    "an unknown surface": (json.dumps(one_step(terrain=[{"name": "x", "kind": "sphere"}])), (422, "invalid-request"),
                           "terrain.0"),
    "a flat box": (json.dumps(one_step(terrain=[{**one_step()["terrain"][0], "size_m": [1, 1, 0]}])),
                   (422, "invalid-request"), "terrain.0.box.size_m.2"),
    "an escape": (json.dumps(one_step(name="a\x1b[2J")), (422, "invalid-request"), "name"),
    "a new line": (json.dumps(one_step(name="a\nb")), (422, "invalid-request"), "name"),
    "text that turns": (json.dumps(one_step(description="\u202ecod.exe")), (422, "invalid-request"), "description"),
    "a NUL": (json.dumps(one_step(name="a\x00")), (422, "invalid-text"), None),
    "half a character": (json.dumps(one_step(name="a\ud800")), (422, "invalid-text"), None),
    "no name": (json.dumps(one_step(name="")), (422, "invalid-request"), "name"),
    "a long name": (json.dumps(one_step(name="x" * 121)), (422, "invalid-request"), "name"),
    "a surface named in markup": (
        json.dumps(one_step(terrain=[{**one_step()["terrain"][0], "name": "<script>"}])), (422, "invalid-request"),
        "terrain.0.box.name"),
}  # fmt: skip


@pytest.mark.parametrize("path", [SCENARIOS, CHECK])
@pytest.mark.parametrize("name", HOSTILE)
def test_an_invalid_scenario_is_refused(http: httpx.Client, path: str, name: str) -> None:
    content, expected, where = HOSTILE[name]
    answer = http.post(path, content=content, headers={"Content-Type": "application/json"})
    assert refusal_code(answer) == expected, answer.text[:500]
    assert len(answer.content) < 20_000
    if where is not None:
        assert fault_places(answer) == [where]


@pytest.mark.parametrize("case", ["a new line", "text that turns", "a surface named in markup"])
def test_a_text_is_refused_in_words(http: httpx.Client, case: str) -> None:
    """Before, by the regular expression that it does not match."""
    answer = http.post(CHECK, content=HOSTILE[case][0], headers={"Content-Type": "application/json"})
    (fault,) = answer.json()["errors"]
    assert fault["message"].startswith("must ")
    assert "^" not in fault["message"]


def test_a_body_of_faults_gets_a_short_answer(http: httpx.Client) -> None:
    unknown = {f"field{i}": None for i in range(30_000)}
    answer = http.post(CHECK, json=unknown)
    assert refusal_code(answer) == (422, "invalid-request")
    assert len(answer.content) < 50_000


def test_of_many_faults_only_the_first_are_listed(http: httpx.Client) -> None:
    contacts = [{"effector": f"limb_{i}", "position_m": [0.0, 0.0, 5.0]} for i in range(16)]
    body = one_step(phases=[{"duration_s": -1.0, "contacts": contacts}] * 400)
    answer = http.post(CHECK, json=body)
    assert answer.status_code == 200, answer.text[:300]
    assert answer.json()["valid"] is False
    assert 0 < len(answer.json()["errors"]) <= 50


@pytest.mark.parametrize(
    "name",
    [
        "'; DROP TABLE scenario; --",
        '" OR ""="',
        "%00",
        "<img src=x onerror=alert(1)>",
        "{{7*7}}",
        "日本 🦿",
        "می\u200cروم",
    ],
)
def test_odd_names_are_only_text(http: httpx.Client, name: str) -> None:
    stored = http.post(SCENARIOS, json=one_step(name=name)).json()
    assert http.get(f"{SCENARIOS}/{stored['id']}").json()["name"] == name
    assert http.delete(f"{SCENARIOS}/{stored['id']}").status_code == 204


@pytest.mark.parametrize(
    "identifier",
    ["'; DROP TABLE scenario; --", "1 OR 1=1", "%00", "..%2F..%2Fetc", "x" * 65, "flat-walk%0a", "ü", "nope"],
)
def test_odd_ids_are_not_found(http: httpx.Client, identifier: str) -> None:
    for method, body in (("GET", None), ("PUT", one_step()), ("DELETE", None)):
        answer = http.request(method, f"{SCENARIOS}/{identifier}", json=body)
        assert answer.status_code == 404
        assert refusal_code(answer)[1] in {"scenario-not-found", "unknown-path"}


def test_only_json_is_read(http: httpx.Client) -> None:
    assert refusal_code(http.post(SCENARIOS, content=json.dumps(one_step()))) == (415, "unsupported-media-type")
    assert refusal_code(http.patch(SCENARIOS, json={})) == (405, "method-not-allowed")


def test_a_course_becomes_the_input_of_the_contact_planner(http: httpx.Client) -> None:
    """Three stairs with a rail on the right; nothing is stored, and what is wrong is named by its field."""
    course = {"robot": "talos", "handrails": ["right"], "elements": [{"kind": "stairs", "number": 3, "rise_m": 0.12}]}
    before = stored(http)
    task = http.post(f"{SCENARIOS}/compose", json=course).json()
    names = [surface["name"] for surface in task["terrain"]]
    assert names[:4] == ["start", "1 stair 1", "1 stair 2", "1 stair 3"]
    ends = [{c["effector"]: c["position_m"] for c in task[end]["contacts"]} for end in ("start", "goal")]
    assert ends[1]["left_foot"][2] - ends[0]["left_foot"][2] == pytest.approx(0.36)
    assert ends[1]["right_hand"][2] - ends[0]["right_hand"][2] == pytest.approx(0.36)
    both = [{"duration_s": 1.0, "contacts": task[end]["contacts"]} for end in ("start", "goal")]
    fields = {key: task[key] for key in ("name", "robot", "friction", "terrain")}
    for phase in both:
        assert http.post(CHECK, json={**fields, "phases": [phase]}).json()["errors"] == []
    assert stored(http) == before

    answer = http.post(f"{SCENARIOS}/compose", json={**course, "robot": "nessie"})
    assert refusal_code(answer) == (404, "robot-not-found")
    answer = http.post(f"{SCENARIOS}/compose", json={**course, "elements": [{"kind": "stairs", "rise_m": 9.0}]})
    assert refusal_code(answer) == (422, "invalid-request")
    assert "rise_m" in fault_places(answer)[0]
    long = [{"kind": "level", "length_m": 9.0}] * 2
    answer = http.post(f"{SCENARIOS}/compose", json={**course, "elements": long})
    assert refusal_code(answer) == (422, "course-too-long")
