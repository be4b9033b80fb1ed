"""Robots of users over HTTP: uploaded, corrected, commissioned, planned for, deleted; hostile ones refused."""

import asyncio
import json
from pathlib import Path
from typing import Any

import httpx
import pytest
from sqlalchemy import select, update

from stridelab.schemas.plans import PlanMotionInput, PlanMotionTask
from stridelab.schemas.robots import CommissionRobotInput, CommissionRobotTask
from stridelab.service.kinds.commission_robot.kind import KIND, publish
from stridelab.service.kinds.staging import stage_scenario
from stridelab.service.storage.tables import audit, robot
from support.robots.humanoid import Humanoid, archive
from support.robots.scenario_bodies import one_step
from support.service.web_server import Served, refusal_code

ROBOTS = "/api/v1/robots"


def send(http: httpx.Client, content: bytes, name: str = "small", **fields: str) -> httpx.Response:
    return http.post(ROBOTS, files={"file": ("small.zip", content)}, data={"name": name, **fields}, timeout=300.0)


def put_card(http: httpx.Client, card: dict[str, Any]) -> httpx.Response:
    return http.put(f"{ROBOTS}/small/card", json=card, timeout=300.0)


def problem_of(answer: httpx.Response, status: int) -> dict[str, Any]:
    assert refusal_code(answer)[0] == status, answer.text
    problem: dict[str, Any] = answer.json()
    return problem


@pytest.fixture(autouse=True)
def no_robots(http: httpx.Client, request: pytest.FixtureRequest) -> None:
    """A test begins without robots of users, but for ``small``, which stays for the next test that takes it."""
    stays = {"small"} if "small" in request.fixturenames else set()
    for item in http.get(ROBOTS).json()["items"]:
        if item["state"] != "bundled" and item["name"] not in stays:
            http.delete(f"{ROBOTS}/{item['name']}")


@pytest.fixture(scope="module")
def uploaded() -> dict[str, Any]:
    """The last answer to an upload of ``small``."""
    return {}


@pytest.fixture
def small(http: httpx.Client, uploaded: dict[str, Any], no_robots: None) -> dict[str, Any]:
    """A robot as it was uploaded, which takes 1.5 s of processor: one that a test has changed is uploaded anew."""
    stored = http.get(f"{ROBOTS}/small/card")
    if stored.status_code != 200 or stored.json() != uploaded:
        http.delete(f"{ROBOTS}/small")
        answer = send(http, archive({"small.urdf": Humanoid().urdf()}))
        assert answer.status_code == 201, answer.text
        uploaded.clear()
        uploaded.update(answer.json())
    return json.loads(json.dumps(uploaded))


@pytest.mark.parametrize(
    ("content", "code"),
    [
        (b"PK\x03\x04 broken", "zip-damaged"),
        (archive({"../../robot.urdf": Humanoid().urdf()}), "zip-path"),
        (archive({"robot.urdf": "<!DOCTYPE r [<!ENTITY a 'b'>]><robot/>"}), "robot-data-unreadable"),
        (archive({"robot.urdf": Humanoid(foot="sphere").urdf()}), "robot-not-humanoid"),
        (archive({"robot.urdf": Humanoid(scale=1000.0).urdf()}), "robot-description-invalid"),
    ],
    ids=["no zip", "path", "entities", "point feet", "millimetres"],
)
def test_a_refused_robot_leaves_nothing(http: httpx.Client, service: Served, content: bytes, code: str) -> None:
    problem = problem_of(send(http, content), 422)
    assert problem["code"] == code
    assert problem["errors"]
    assert all(item["state"] == "bundled" for item in http.get(ROBOTS).json()["items"])

    async def stored_files() -> list[str]:
        return [info.key async for info in service.parts.blobs.list_prefix("own-robots")]

    assert service.run(stored_files()) == []


def test_a_corrected_number_is_no_longer_assumed(http: httpx.Client) -> None:
    robot = send(http, archive({"small.urdf": Humanoid(effort=None).urdf()})).json()
    assert {"limits.torque_nm.left_knee", "limits.torque_nm.right_knee"} <= set(robot["assumed"])
    robot["card"]["limits"]["torque_nm"]["left_knee"] = 123.0
    answer = put_card(http, robot["card"])
    assert answer.status_code == 200, answer.text
    assert "limits.torque_nm.left_knee" not in answer.json()["assumed"]
    assert "limits.torque_nm.right_knee" in answer.json()["assumed"]
    limits = {limit["joint"]: limit for limit in http.get(f"{ROBOTS}/small").json()["limits"]}
    assert limits["left_knee"]["torque_nm"] == 123.0
    changed = http.get(f"{ROBOTS}/small/card").json()
    (first,) = changed["earlier"]
    assert (changed["card"], changed["version"], first["version"]) == (answer.json()["card"], 2, 1)
    assert first["card"]["limits"]["torque_nm"]["left_knee"] != 123.0
    back = put_card(http, first["card"]).json()
    assert (back["card"], back["assumptions"], back["version"]) == (first["card"], robot["assumptions"], 3)
    assert [one["version"] for one in back["earlier"]] == [1, 2]
    assert put_card(http, back["card"]).json()["version"] == 3, "nothing has changed"


def test_an_implausible_torque_is_kept_and_its_estimate_is_assumed_once_chosen(http: httpx.Client) -> None:
    robot = send(http, archive({"small.urdf": Humanoid(effort=20.0).urdf()})).json()
    field = "limits.torque_nm.left_knee"
    assert robot["card"]["limits"]["torque_nm"]["left_knee"] == 20.0
    robot["card"]["limits"]["torque_nm"]["left_knee"] = estimate_nm = robot["estimates"][field]
    changed = put_card(http, robot["card"]).json()
    assert changed["assumptions"][field].startswith(f"{estimate_nm:g} N m, estimated, in place of what")
    assert field not in changed["estimates"]
    assert "limits.torque_nm.right_knee" in changed["estimates"]


def test_bundled_robots_cannot_be_deleted(http: httpx.Client) -> None:
    assert problem_of(http.delete(f"{ROBOTS}/talos"), 409)["code"] == "bundled-read-only"
    assert problem_of(http.delete(f"{ROBOTS}/none"), 404)["code"] == "robot-not-found"
    assert problem_of(http.post("/api/v1/jobs/commission-robot", json={"robot": "talos"}), 409)["code"] == (
        "bundled-read-only"
    )
    assert (
        problem_of(http.post("/api/v1/jobs/commission-robot", json={"robot": "none"}), 404)["code"] == "robot-not-found"
    )


def test_an_upload_answers_with_a_proposed_card(http: httpx.Client, small: dict[str, Any], service: Served) -> None:
    assert (small["name"], small["state"], small["owner"]) == ("small", "proposed", None)
    assert set(small["card"]["effectors"]) == {"left_foot", "right_foot", "left_hand", "right_hand"}
    assert "rotors.armature_kg_m2" in small["assumed"]
    assert "data" not in small["card"]
    listed = next(item for item in http.get(ROBOTS).json()["items"] if item["name"] == "small")
    assert (listed["state"], listed["available"], listed["title"]) == ("proposed", True, "small")
    facts = http.get(f"{ROBOTS}/small").json()
    assert facts["mass_kg"] == pytest.approx(50.8, abs=3.0)
    assert facts["measures"] == []
    assert http.get(f"{ROBOTS}/small/links").content[:4] == b"glTF"
    assert http.get(f"{ROBOTS}/small/preparation").json()["state"] == "ready"
    assert problem_of(http.get(f"{ROBOTS}/small/reachability"), 404)["code"] == "reachability-not-learned"
    assert "robot-added" in actions(service)


def test_scenes_are_scaled_to_the_legs_of_an_own_robot(http: httpx.Client, small: dict[str, Any]) -> None:
    """Six stairs for this robot: built, stored, and as high for its legs as those of TALOS."""
    scaled = "/api/v1/scenarios/scaled"
    legs_m = [http.get(f"{ROBOTS}/{name}").json()["walker"]["leg_m"] for name in ("small", "talos")]
    answer = http.post(scaled, json={"robot": "small", "scene": "six-stairs"})
    assert answer.status_code == 200, answer.text
    tops_m = [box["center_m"][2] + 0.5 * box["size_m"][2] for box in answer.json()["terrain"]][1:]
    assert len(tops_m) == 6
    assert tops_m[0] == pytest.approx(0.10 * legs_m[0] / legs_m[1], abs=1e-3)
    stored = http.post("/api/v1/scenarios", json=answer.json())
    assert stored.status_code == 201, stored.text
    assert stored.json()["robot"] == "small"
    assert http.delete(f"/api/v1/scenarios/{stored.json()['id']}").status_code == 204
    refused = http.post(scaled, json={"robot": "nessie", "scene": "six-stairs"})
    assert refusal_code(refused) == (404, "robot-not-found")
    refused = http.post(scaled, json={"robot": "small", "scene": "wall-step"})
    assert refusal_code(refused) == (422, "invalid-request")


def test_a_robot_of_an_earlier_version_has_no_scenes_until_its_card_is_saved(
    http: httpx.Client, small: dict[str, Any], service: Served
) -> None:
    async def forget_legs() -> None:
        async with service.parts.engine.begin() as connection:
            facts = (await connection.execute(select(robot.c.facts).where(robot.c.name == "small"))).scalar_one()
            older = {key: value for key, value in facts.items() if key != "walker"}
            await connection.execute(update(robot).where(robot.c.name == "small").values(facts=older))

    service.run(forget_legs())
    asked = {"robot": "small", "scene": "six-stairs"}
    refused = http.post("/api/v1/scenarios/scaled", json=asked)
    assert refusal_code(refused) == (422, "robot-not-scalable")
    assert put_card(http, small["card"]).status_code == 200
    assert http.post("/api/v1/scenarios/scaled", json=asked).status_code == 200


def test_an_mjcf_file_gives_the_card_of_its_urdf(http: httpx.Client, small: dict[str, Any]) -> None:
    files = {"robot/small.xml": Humanoid().mjcf(), "robot/scene.xml": "<mujoco/>"}
    several = archive(files | {"robot/a.urdf": "<robot/>", "robot/b.urdf": "<robot/>"})
    refused = problem_of(send(http, several, "other"), 422)
    assert refused["code"] == "robot-several-descriptions"
    assert [error["where"] for error in refused["errors"]] == ["robot/a.urdf", "robot/b.urdf"]
    answer = send(http, several, "other", description="small.xml")
    assert answer.status_code == 201, answer.text
    card = answer.json()["card"]
    assert card["groups"] == small["card"]["groups"]
    assert card["effectors"].keys() == small["card"]["effectors"].keys()
    outside = "<mujoco><asset><mesh name='m' file='/etc/passwd'/></asset></mujoco>"
    refused = problem_of(send(http, archive({"robot.xml": outside}), "outside"), 422)
    assert refused["errors"] == [{"where": "/etc/passwd", "message": "its format is none of .stl, .obj, .dae"}]


def actions(service: Served) -> list[str]:
    async def read() -> list[str]:
        async with service.parts.engine.connect() as connection:
            return list((await connection.execute(select(audit.c.action))).scalars())

    return service.run(read())


def test_a_name_is_taken_once(http: httpx.Client, small: dict[str, Any]) -> None:
    again = archive({"small.urdf": Humanoid().urdf()})
    for name in (small["name"], "talos", "human"):
        assert problem_of(send(http, again, name), 409)["code"] == "robot-name-taken"
    for name in ("", "A", "../x", "a b", "a" * 50, "<b>"):
        assert problem_of(send(http, again, name), 422)["errors"][0]["where"] == "name"


def test_the_card_is_refused_field_by_field(http: httpx.Client, small: dict[str, Any]) -> None:
    card = json.loads(json.dumps(small["card"]))
    card["limits"]["torque_nm"]["left_knee"] = -1.0
    card["effectors"]["left_foot"]["contact_half_size_m"] = [0.0, 0.05]
    problem = problem_of(put_card(http, card), 422)
    assert problem["code"] == "robot-card-invalid"
    wheres = {error["where"] for error in problem["errors"]}
    assert wheres == {"limits.torque_nm.left_knee", "effectors.left_foot.contact_half_size_m"}
    card = json.loads(json.dumps(small["card"]))
    card["limits"]["torque_nm"]["left_knee"] = 1e300
    card["effectors"]["left_foot"]["position_m"] = [-1e6, 0.0, 0.0]
    wheres = {error["where"] for error in problem_of(put_card(http, card), 422)["errors"]}
    assert wheres == {"limits.torque_nm.left_knee", "effectors.left_foot.position_m"}
    card = {**small["card"], "base_frame": "chassis"}
    assert problem_of(put_card(http, card), 422)["errors"][0]["where"] == "base_frame"
    card = {**small["card"], "data": {"urdf": "../../etc/passwd"}}
    assert problem_of(put_card(http, card), 422)["errors"][0]["where"] == "data"
    assert problem_of(http.put(f"{ROBOTS}/talos/card", json=small["card"]), 409)["code"] == "bundled-read-only"
    assert problem_of(http.put(f"{ROBOTS}/none/card", json=small["card"]), 404)["code"] == "robot-not-found"


def test_the_list_names_the_owner(http: httpx.Client, small: dict[str, Any], service: Served) -> None:
    async def give_away(owner: str | None) -> None:
        async with service.parts.engine.begin() as connection:
            await connection.execute(update(robot).values(owner=owner))

    service.run(give_away("ann"))
    listed = next(item for item in http.get(ROBOTS).json()["items"] if item["name"] == "small")
    assert listed["owner"] == "ann"
    assert small["owner"] is None
    service.run(give_away(None))


def test_jobs_that_name_it_or_its_parts_are_validated(http: httpx.Client, small: dict[str, Any]) -> None:
    jobs = "/api/v1/jobs"

    def learn(effector: str) -> httpx.Response:
        return http.post(f"{jobs}/learn-reachability", json={"robot": "small", "effectors": [effector], "samples": 500})

    def plan(link: str) -> httpx.Response:
        replay = {"pushes": [{"time_s": 1.0, "impulse_ns": [5.0, 0.0, 0.0], "link": link}]}
        return http.post(f"{jobs}/plan-motion", json={"scenario": one_step(robot="small"), "replay": replay})

    def push(robot_name: str) -> httpx.Response:
        body = {"scenario": one_step(), "robot": robot_name, "speed_m_s": 0.2, "n": 2}
        return http.post(f"{jobs}/push-basin", json=body)

    def simulate(robot_name: str) -> httpx.Response:
        return http.post(f"{jobs}/simulate-recording", json={"robot": robot_name, "duration_s": 2.0})

    wrong = problem_of(learn("nose"), 422)
    assert (wrong["errors"][0]["where"], "left_foot" in wrong["detail"]) == ("effectors.0", True)
    wrong = problem_of(plan("nose"), 422)
    assert (wrong["code"], wrong["errors"][0]["where"]) == ("replay-invalid", "replay.pushes.0.link")
    assert problem_of(push("nobody"), 422)["errors"][0]["where"] == "robot"
    assert problem_of(simulate("no-such-robot"), 422)["errors"][0]["where"] == "robot"
    for answer in (learn("left_foot"), plan("pelvis"), push("small"), simulate("small"), simulate("human")):
        assert answer.status_code == 202, answer.text
        http.delete(f"{jobs}/{answer.json()['id']}")
    assert small["name"] == "small"


def test_the_whole_body_of_a_robot_is_checked_before_anything_is_learned(
    http: httpx.Client, small: dict[str, Any]
) -> None:
    check = "/api/v1/scenarios/check"
    query = {"body_checked": True, "posture_of": 1}
    body = http.post(check, json=one_step(robot="small"), params=query).json()
    assert [phase["body"] for phase in body["phases"]] == ["reachable"] * 3
    assert len(body["phases"][1]["link_poses"]) == len(http.get(f"{ROBOTS}/small").json()["links"])
    wide = one_step(robot="small")
    wide["phases"][2]["contacts"][0]["position_m"] = [0.2, 0.95, 0.0]
    out = http.post(check, json=wide, params=query).json()
    assert (out["valid"], [phase["body"] for phase in out["phases"]]) == (False, ["reachable"] * 2 + ["unreachable"])
    wide["phases"][2]["contacts"][0]["position_m"] = [0.0, 0.3, 0.0]
    assert http.post(check, json=wide, params=query).json()["phases"][2]["body"] == "reachable"
    stiff = json.loads(json.dumps(small["card"]))
    stiff["limits"]["position_rad"] = {".*_hip_(roll|yaw)": [-0.02, 0.02]}
    assert put_card(http, stiff).status_code == 200
    assert http.post(check, json=wide, params=query).json()["phases"][2]["body"] == "unreachable", "of the card before"


def assert_planned_at_once(http: httpx.Client, service: Served, scenario: dict[str, Any], scenario_id: str) -> None:
    """The editor's calls know the robot and its densities, also when these change meanwhile."""
    stored = http.get(f"/api/v1/scenarios/{scenario_id}/check").json()
    while any(warning["code"] == "body-unfinished" for warning in stored["warnings"]):
        stored = http.get(f"/api/v1/scenarios/{scenario_id}/check").json()
    assert {phase["body"] for phase in stored["phases"]} == {"reachable"}
    plan = http.post("/api/v1/plans/preview", json={"scenario": scenario}, timeout=120).json()
    assert plan.get("code") == "solver-unavailable" or plan["motion"]["converged"] is True

    async def set_learned(key: str | None) -> str:
        async with service.parts.engine.begin() as connection:
            before = (await connection.execute(select(robot.c.learned_key))).scalar_one()
            await connection.execute(update(robot).values(learned_key=key))
        return str(before)

    learned = service.run(set_learned(None))
    forgotten = http.post("/api/v1/plans/preview", json={"scenario": scenario}, timeout=120).json()
    assert forgotten["code"] in ("reachability-not-learned", "solver-unavailable"), "planned with the densities before"
    service.run(set_learned(learned))


async def counted_bytes(service: Served) -> int:
    """What the robot counts for its owner's storage."""
    async with service.parts.engine.connect() as connection:
        return int((await connection.execute(select(robot.c.bytes))).scalar_one())


async def file_sizes(service: Served) -> list[int]:
    """Of its files in the store."""
    return [info.bytes async for info in service.parts.blobs.list_prefix("own-robots")]


def test_an_uploaded_robot_is_commissioned_and_planned_for(
    http: httpx.Client, small: dict[str, Any], service: Served, tmp_path: Path
) -> None:
    """The stages of a worker, one by one: fetch, run, publish; then a scenario and the plan of its job."""
    request = CommissionRobotInput(robot="small", samples=500, search_s=0.01)
    submitted = http.post("/api/v1/jobs/commission-robot", json=request.model_dump())
    assert submitted.status_code == 202, submitted.text
    in_use = problem_of(http.delete(f"{ROBOTS}/small"), 409)
    assert in_use["code"] == "robot-in-use"
    assert in_use["errors"][0]["where"] == f"job {submitted.json()['id']}"
    http.delete(f"/api/v1/jobs/{submitted.json()['id']}")

    folder = tmp_path / "commission"
    folder.mkdir()

    async def fetch() -> dict[str, Any]:
        async with service.parts.engine.connect() as connection:
            return await KIND.stage(connection, service.parts.blobs, request, folder)

    task = service.run(fetch())
    CommissionRobotTask.model_validate(task)
    running = service.parts.pool.run(KIND.run, task, folder, timeout_s=600.0, memory_mb=4096)
    child = asyncio.run_coroutine_threadsafe(running, service.loop).result(timeout=600.0)
    assert child.state == "ok", child
    outcome = child.value
    walk = outcome["summary"]["first_walk"]
    assert (walk["certified"], walk["completed"]) == (True, True), walk
    ends = {one["name"]: (one["value"], one["ended_by"]) for one in outcome["summary"]["capabilities"]}
    assert len(ends) == 7
    assert set(ends.values()) == {(None, "not-tried")}, "no time was left"

    async def store() -> None:
        async with service.parts.engine.begin() as connection:
            await publish(connection, service.parts.blobs, {"id": "job1"}, outcome, folder)

    sizes = []
    for _ in range(2):  # commissioned again: earlier densities are not counted, since they are removed
        service.run(store())
        sizes.append(service.run(counted_bytes(service)))
    assert sizes[0] == sizes[1] == sum(service.run(file_sizes(service)))
    listed = next(item for item in http.get(ROBOTS).json()["items"] if item["name"] == "small")
    assert listed["state"] == "commissioned"
    assert http.get(f"{ROBOTS}/small").json()["measures"] == ["uniform", "conditioned"]
    reach = http.get(f"{ROBOTS}/small/reachability", params={"measure": "uniform"}).json()
    assert {item["card"]["effector"] for item in reach["effectors"]} >= {"left_foot", "right_foot"}

    scenario = json.loads((folder / "scenario.json").read_text(encoding="utf-8"))
    checked = http.post("/api/v1/scenarios/check", json=scenario).json()
    assert checked["valid"], checked["errors"]
    assert checked["margins"]
    added = http.post("/api/v1/scenarios", json=scenario)
    assert added.status_code == 201, added.text
    assert_planned_at_once(http, service, scenario, added.json()["id"])
    assert problem_of(http.delete(f"{ROBOTS}/small"), 409)["errors"][0]["where"] == f"scenario {added.json()['id']}"

    plan_folder = tmp_path / "plan"
    plan_folder.mkdir()
    plan = PlanMotionInput(scenario_id=added.json()["id"], whole_body=False)

    async def fetch_plan() -> dict[str, Any]:
        async with service.parts.engine.connect() as connection:
            return await stage_scenario(PlanMotionTask)(connection, service.parts.blobs, plan, plan_folder)

    PlanMotionTask.model_validate(service.run(fetch_plan()))
    assert sorted(path.name for path in plan_folder.iterdir()) == [
        "robot-bundle.zip",
        "robot-learned.zip",
        "robot.json",
    ]
    http.delete(f"/api/v1/scenarios/{added.json()['id']}")
    assert http.delete(f"{ROBOTS}/small").status_code == 204
    assert problem_of(http.get(f"{ROBOTS}/small"), 404)["code"] == "robot-not-found"
