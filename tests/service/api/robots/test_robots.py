"""Robots over HTTP: described and drawn by children, once however many ask, and never again than needed."""

import asyncio
import json
import struct
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import httpx
import pytest

from stridelab.machine.models_folder import models_dir
from stridelab.robots import card
from stridelab.service.api import app
from stridelab.service.api.robots import cache as shelf_module
from stridelab.service.api.robots import endpoints
from stridelab.service.api.robots.cache import RobotCache
from stridelab.service.processes.pool import IsolatedPool
from stridelab.service.processes.priority import NICENESS
from stridelab.service.samples.scenario_bodies import ONE_STEP
from stridelab.service.source_hash import source_sha256
from support.service.processes import crowding
from support.service.robot_children import FACTS, GLB, REACH
from support.service.web_server import Served, refusal_code

ROBOTS = "/api/v1/robots"
STUBS = {name: f"support.service.robot_children:{name}" for name in ("describe", "draw", "enclose")}


@pytest.fixture
def diary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[3]))
    path = tmp_path / "diary"
    monkeypatch.setenv("ROBOT_DIARY", str(path))
    path.touch()
    return path


def shelve(service: Served, **children: str) -> None:
    """Give the application a shelf that knows nothing yet and runs stand-ins."""
    parts = service.parts
    close_shelf(service)
    shelf = RobotCache(IsolatedPool(), parts.blobs, parts.spool, 500, sandbox=None, **{**STUBS, **children})
    service.app.state.parts = replace(parts, robots=shelf)


def close_shelf(service: Served) -> None:
    """Nothing stays of a shelf that was made by a test, whose children saw that test's environment."""
    parts = service.parts
    if parts.robots.pool is not parts.pool:
        service.run(parts.robots.aclose())
        service.run(parts.robots.pool.close())


@pytest.fixture
def stubbed(service: Served, diary: Path) -> Iterator[Served]:
    before = service.parts
    service.run(before.blobs.delete_prefix("robots"))
    shelve(service)
    yield service
    close_shelf(service)
    service.run(before.blobs.delete_prefix("robots"))
    service.app.state.parts = before


def test_the_list_loads_every_robot_once(http: httpx.Client, stubbed: Served, diary: Path) -> None:
    page = http.get(ROBOTS).json()
    assert page["next"] is None
    talos = next(item for item in page["items"] if item["name"] == "talos")
    assert (talos["title"], talos["available"], talos["reason"]) == ("TALOS", True, None)
    assert talos["effectors"] == ["left_foot", "right_foot", "left_hand", "right_hand"]
    assert "CC BY-NC-ND" in talos["licence"]
    assert http.get(ROBOTS).json() == page
    assert diary.read_text().splitlines() == [f"describe {name}" for name in card.robot_names()]


@pytest.mark.parametrize(
    ("child", "message"), [("bad_card", "there is no frame 'chassis'"), ("crash", "could not be loaded")]
)
def test_a_robot_whose_card_is_broken_is_unavailable_and_can_do_nothing(
    http: httpx.Client, stubbed: Served, diary: Path, monkeypatch: pytest.MonkeyPatch, child: str, message: str
) -> None:
    shelve(stubbed, describe=f"support.service.robot_children:{child}")
    listed = http.get(ROBOTS).json()["items"]
    assert [item["name"] for item in listed] == list(card.robot_names())
    assert all(item["available"] is False and message in item["reason"] for item in listed)
    checked = http.post("/api/v1/scenarios/check", json=ONE_STEP).json()
    assert checked["valid"] is False
    assert [fault["where"] for fault in checked["errors"]] == ["robot"]
    assert message in checked["errors"][0]["message"]
    for path, body in (("scenarios", ONE_STEP), ("jobs/plan-motion", {"scenario": ONE_STEP})):
        assert refusal_code(http.post(f"/api/v1/{path}", json=body)) == (422, "scenario-invalid")
    assert len(diary.read_text().splitlines()) == len(listed), "a failure is remembered for a while"

    monkeypatch.setattr(shelf_module, "RETRY_S", 0.0)
    assert not any(item["available"] for item in http.get(ROBOTS).json()["items"])
    assert len(diary.read_text().splitlines()) == 2 * len(listed)


def test_a_robot_that_cannot_be_loaded_gives_the_reason(
    http: httpx.Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    good = (models_dir() / "robots" / "talos.toml").read_text(encoding="utf-8")
    folder = tmp_path / "robots"
    folder.mkdir()
    (folder / "absent.toml").write_text(good.replace("example_robot_data", "no_such_package"), encoding="utf-8")
    (folder / "broken.toml").write_text("title = 7", encoding="utf-8")
    monkeypatch.setattr(card, "models_dir", lambda: tmp_path)
    absent, broken = endpoints.robot_summaries()
    assert (absent.name, absent.available, absent.title) == ("absent", False, "TALOS")
    assert "no_such_package" in str(absent.reason)
    assert (broken.name, broken.available, broken.effectors) == ("broken", False, [])
    assert broken.reason
    assert [item["available"] for item in http.get(ROBOTS).json()["items"]] == [False, False]


def test_facts_are_computed_once(http: httpx.Client, stubbed: Served, diary: Path) -> None:
    first = http.get(f"{ROBOTS}/talos")
    assert first.status_code == 200, first.text
    assert first.json() == FACTS
    assert http.get(f"{ROBOTS}/talos").json() == FACTS
    assert diary.read_text().splitlines() == ["describe talos"]


def test_concurrent_requests_share_one_child(stubbed: Served, diary: Path) -> None:
    def ask(path: str) -> httpx.Response:
        with stubbed.http() as http:
            return http.get(path)

    paths = [f"{ROBOTS}/talos", f"{ROBOTS}/talos/links"] * 3
    with ThreadPoolExecutor(len(paths)) as threads:
        answers = list(threads.map(ask, paths))
    assert [answer.status_code for answer in answers] == [200] * len(paths)
    assert {answer.content for answer in answers[1::2]} == {GLB}
    assert sorted(diary.read_text().splitlines()) == ["describe talos", "draw talos"]


def test_a_cancelled_request_does_not_cancel_the_others(stubbed: Served, diary: Path) -> None:
    with stubbed.http() as http:
        with pytest.raises(httpx.ReadTimeout):
            http.get(f"{ROBOTS}/talos", timeout=0.05)
        assert http.get(f"{ROBOTS}/talos").json() == FACTS
    assert diary.read_text().splitlines() == ["describe talos"]


def test_meshes_are_drawn_once_and_stored(http: httpx.Client, stubbed: Served, diary: Path) -> None:
    path = f"{ROBOTS}/talos/links"
    first = http.get(path)
    assert (first.status_code, first.content) == (200, GLB)
    assert first.headers["content-type"] == "model/gltf-binary"
    assert first.headers["cache-control"] == "private, no-cache"
    assert first.headers["content-length"] == str(len(GLB))
    key = f"robots/talos/{source_sha256('talos')}/links.glb"
    assert key in stubbed.stored_files()
    etag = first.headers["etag"]
    for condition in (etag, f"W/{etag}", f'"x", {etag}', "*"):
        again = http.get(path, headers={"If-None-Match": condition})
        assert (again.status_code, again.content, again.headers["etag"]) == (304, b"", etag)
    assert http.get(path, headers={"If-None-Match": '"x"'}).content == GLB

    shelve(stubbed)  # as after a restart
    assert http.get(path).headers["etag"] == etag
    assert diary.read_text().splitlines() == ["describe talos", "draw talos"]

    stubbed.run(stubbed.parts.blobs.delete(key))
    renewed = http.get(path, headers={"If-None-Match": etag})
    assert (renewed.status_code, renewed.content) == (200, GLB)
    assert renewed.headers["etag"] != etag
    assert diary.read_text().splitlines()[-1] == "draw talos"
    assert not any(name.startswith("spool/") for name in stubbed.stored_files())


def test_reach_is_enclosed_once_for_each_measure(http: httpx.Client, stubbed: Served, diary: Path) -> None:
    path = f"{ROBOTS}/talos/reachability"
    first = http.get(path)
    assert (first.status_code, first.json()) == (200, REACH)
    assert first.headers["content-encoding"] == "gzip"
    etag = first.headers["etag"]
    named = http.get(path, params={"measure": "uniform"}, headers={"Accept-Encoding": "identity"})
    assert (named.json(), named.headers["etag"]) == (REACH, etag)
    assert "content-encoding" not in named.headers
    again = http.get(path, headers={"If-None-Match": etag})
    assert (again.status_code, again.content) == (304, b"")
    assert diary.read_text().splitlines() == ["describe talos", "enclose talos uniform"]


@pytest.mark.parametrize(
    ("measure", "status", "code"),
    [("conditioned", 404, "reachability-not-learned"), ("even", 422, "invalid-request"), ("", 422, "invalid-request")],
)
def test_an_unknown_measure_starts_no_child(
    http: httpx.Client, stubbed: Served, diary: Path, measure: str, status: int, code: str
) -> None:
    assert refusal_code(http.get(f"{ROBOTS}/talos/reachability", params={"measure": measure})) == (status, code)
    assert "enclose" not in diary.read_text()


def test_densities_of_another_description_are_refused(http: httpx.Client, stubbed: Served, diary: Path) -> None:
    shelve(stubbed, describe="support.service.robot_children:describe_changed")
    path = f"{ROBOTS}/talos/reachability"
    for params in ({}, {"measure": "uniform"}):
        assert refusal_code(http.get(path, params=params)) == (503, "reachability-of-another-robot")
    assert refusal_code(http.get(path, params={"measure": "conditioned"})) == (404, "reachability-not-learned")
    assert diary.read_text() == ""


@pytest.mark.parametrize(("child", "code"), [("no_data", "robot-data-missing"), ("crash", "robot-not-loaded")])
def test_a_failure_is_reported_and_tried_again(
    http: httpx.Client, stubbed: Served, diary: Path, child: str, code: str
) -> None:
    shelve(stubbed, describe=f"support.service.robot_children:{child}")
    for path in (f"{ROBOTS}/talos", f"{ROBOTS}/talos/links"):
        assert refusal_code(http.get(path)) == (503, code)
    assert len(diary.read_text().splitlines()) == 2
    shelve(stubbed, draw=f"support.service.robot_children:{child}", enclose=f"support.service.robot_children:{child}")
    for path in (f"{ROBOTS}/talos/links", f"{ROBOTS}/talos/reachability"):
        assert refusal_code(http.get(path)) == (503, code)
    assert http.get(f"{ROBOTS}/talos").status_code == 200


@pytest.mark.parametrize("name", ["nao", "..%2Ftalos", "talos.toml", "TALOS", "%00", "x" * 300, "talos%0a", "'; --"])
def test_an_unknown_robot_starts_no_child(http: httpx.Client, stubbed: Served, diary: Path, name: str) -> None:
    for path in (f"{ROBOTS}/{name}", f"{ROBOTS}/{name}/links", f"{ROBOTS}/{name}/reachability"):
        status, code = refusal_code(http.get(path))
        assert (status, code in {"robot-not-found", "unknown-path"}) == (404, True)
    assert diary.read_text() == ""


def nodes_of(glb: bytes) -> list[str]:
    """Names of the nodes of a binary glTF file with meshes, read by hand (Khronos, glTF 2.0, section 4.4)."""
    magic, version, length = struct.unpack_from("<4sII", glb)
    assert (magic, version, length) == (b"glTF", 2, len(glb))
    json_length, kind = struct.unpack_from("<I4s", glb, 12)
    assert kind == b"JSON"
    nodes = json.loads(glb[20 : 20 + json_length])["nodes"]
    return [node["name"] for node in nodes if "mesh" in node]


def test_the_real_talos_has_its_mass_effectors_and_meshes(service: Served) -> None:
    with service.http(timeout=120.0) as http:
        facts = http.get(f"{ROBOTS}/talos").json()
        drawn = http.get(f"{ROBOTS}/talos/links")
    assert facts["name"] == "talos"
    assert 85.0 < facts["mass_kg"] < 100.0
    assert {each["name"]: each["kind"] for each in facts["effectors"]} == {
        "left_foot": "surface", "right_foot": "surface", "left_hand": "point", "right_hand": "point",
    }  # fmt: skip
    assert len(facts["q_reference"]) == 7 + len(facts["limits"])
    assert all(each["lower_rad"] < each["upper_rad"] and each["torque_nm"] > 0 for each in facts["limits"])
    assert drawn.headers["content-type"] == "model/gltf-binary"
    assert set(nodes_of(drawn.content)) <= set(facts["links"])
    assert "base_link" in nodes_of(drawn.content)
    assert f"robots/talos/{source_sha256('talos')}/links.glb" in service.stored_files()


def test_an_application_that_stops_ends_its_children(stubbed: Served, diary: Path) -> None:
    shelf = stubbed.parts.robots

    async def stop_while_loading() -> object:
        asking = asyncio.ensure_future(shelf.facts("talos"))
        while not diary.read_text():
            await asyncio.sleep(0.02)
        await shelf.aclose()
        return (await asyncio.gather(asking, return_exceptions=True))[0]

    assert isinstance(stubbed.run(stop_while_loading()), asyncio.CancelledError)
    assert list(stubbed.parts.spool.iterdir()) == []


ALL_OF_TALOS = ["describe talos", "draw talos", "enclose talos uniform"]


def test_robots_are_prepared_one_after_the_other_and_a_failure_affects_no_other(
    http: httpx.Client, stubbed: Served, diary: Path
) -> None:
    stubbed.run(stubbed.parts.robots.prepare_all(["talos", "g1"]))
    diary_text = diary.read_text()
    assert diary_text.splitlines() == [*ALL_OF_TALOS, *(line.replace("talos", "g1") for line in ALL_OF_TALOS)]
    assert http.get(f"{ROBOTS}/talos/links").status_code == 200
    assert diary.read_text() == diary_text
    shelve(stubbed, describe="support.service.robot_children:missing")
    stubbed.run(stubbed.parts.robots.prepare_all(["hrp2"]))
    assert diary.read_text() == diary_text


def test_further_robots_are_prepared_once_no_job_runs_or_waits(
    http: httpx.Client, stubbed: Served, diary: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(app, "REST_S", 0.2)
    rest = partial(app.await_idle_queue, stubbed.parts.engine)
    asked = {"scenario": ONE_STEP, "whole_body": False}
    waiting = http.post("/api/v1/jobs/plan-motion", json=asked).raise_for_status().json()["id"]
    with ThreadPoolExecutor(1) as beside:
        preparing = beside.submit(stubbed.run, stubbed.parts.robots.prepare_all(["talos", "g1"], rest), 120.0)
        while len(diary.read_text().splitlines()) < len(ALL_OF_TALOS):
            time.sleep(0.1)
        time.sleep(2.5)
        assert not preparing.done()
        assert diary.read_text().splitlines() == ALL_OF_TALOS
        http.delete(f"/api/v1/jobs/{waiting}").raise_for_status()
        preparing.result()
    assert len(diary.read_text().splitlines()) == 2 * len(ALL_OF_TALOS)
    monkeypatch.setattr(app, "REST_S", 60.0)
    monkeypatch.setattr(app, "REST_MAX_S", 0.2)
    stubbed.run(rest())  # not for ever


def test_children_run_at_low_priority_until_a_request_waits_for_them(
    http: httpx.Client, stubbed: Served, diary: Path
) -> None:
    shelve(
        stubbed,
        describe="support.service.robot_children:describe_nicely",
        draw="support.service.robot_children:draw_nicely",
    )
    stubbed.run(stubbed.parts.robots.prepare_all(["talos"]))
    while http.get(f"{ROBOTS}/g1/preparation").json()["state"] == "preparing":
        time.sleep(0.05)
    warmed, drawn, requested, also = (int(line) for line in diary.read_text().splitlines())
    assert (warmed, requested) == (drawn, also)
    assert warmed - requested == NICENESS


def test_a_restarted_service_computes_nothing_again(http: httpx.Client, stubbed: Served, diary: Path) -> None:
    stubbed.run(stubbed.parts.robots.prepare_all(["talos"]))
    paths = (f"{ROBOTS}/talos", f"{ROBOTS}/talos/links", f"{ROBOTS}/talos/reachability")
    first = [http.get(path).content for path in paths]
    shelve(stubbed)
    stubbed.run(stubbed.parts.robots.prepare_all(["talos"]))
    assert [http.get(path).content for path in paths] == first
    assert diary.read_text().splitlines() == ALL_OF_TALOS


@pytest.mark.parametrize("file", ["facts.json", "links.glb", "uniform-reachability.json.gz"])
def test_only_lost_files_are_computed_again(http: httpx.Client, stubbed: Served, diary: Path, file: str) -> None:
    child_of_file = dict(zip(("facts.json", "links.glb", "uniform-reachability.json.gz"), ALL_OF_TALOS, strict=True))
    stubbed.run(stubbed.parts.robots.prepare_all(["talos"]))
    stubbed.run(stubbed.parts.blobs.delete(f"robots/talos/{source_sha256('talos')}/{file}"))
    shelve(stubbed)
    stubbed.run(stubbed.parts.robots.prepare_all(["talos"]))
    assert diary.read_text().splitlines() == [*ALL_OF_TALOS, child_of_file[file]]


@pytest.mark.parametrize("file", ["facts.json", "uniform-reachability.json.gz"])
@pytest.mark.parametrize("damage", [b"", b"{", b"\x1f\x8b\x08\x00"])
def test_a_damaged_file_is_not_served(
    http: httpx.Client, stubbed: Served, tmp_path: Path, file: str, damage: bytes
) -> None:
    stubbed.run(stubbed.parts.robots.prepare_all(["talos"]))
    (tmp_path / "damaged").write_bytes(damage)
    key = f"robots/talos/{source_sha256('talos')}/{file}"
    stubbed.run(stubbed.parts.blobs.put_file(key, tmp_path / "damaged"))
    shelve(stubbed)
    assert http.get(f"{ROBOTS}/talos").json() == FACTS
    assert http.get(f"{ROBOTS}/talos/reachability").json() == REACH


def test_the_progress_of_a_preparation_is_reported(http: httpx.Client, stubbed: Served, diary: Path) -> None:
    path = f"{ROBOTS}/talos/preparation"
    states: list[dict[str, Any]] = []
    while not states or states[-1]["state"] == "preparing":
        began = time.monotonic()
        states.append(http.get(path).json())
        assert time.monotonic() - began < 5.0 * crowding(), "the answer does not wait for the files"
    fractions = [each["fraction"] for each in states]
    assert fractions == sorted(fractions)
    assert states[0]["state"] == "preparing"
    assert states[-1] == {"state": "ready", "fraction": 1.0, "message": "ready"}
    assert "half way" in [each["message"] for each in states]
    assert diary.read_text().splitlines() == ALL_OF_TALOS, "however many requests there are"


@pytest.mark.parametrize("child", ["describe", "draw", "enclose"])
def test_a_failed_preparation_gives_the_reason_and_is_tried_again_later(
    http: httpx.Client, stubbed: Served, diary: Path, monkeypatch: pytest.MonkeyPatch, child: str
) -> None:
    shelve(stubbed, **{child: "support.service.robot_children:no_data"})
    path = f"{ROBOTS}/talos/preparation"
    while (preparation := http.get(path).json())["state"] == "preparing":
        time.sleep(0.05)
    assert preparation == {"state": "failed", "fraction": 0.0, "message": "The description of TALOS is missing."}
    assert http.get(path).json() == preparation
    assert diary.read_text().splitlines().count("no data") == 1
    monkeypatch.setattr(shelf_module, "RETRY_S", 0.0)
    while http.get(path).json()["state"] == "preparing":
        time.sleep(0.05)
    assert diary.read_text().splitlines().count("no data") > 1


def test_the_preparation_of_an_unknown_robot_is_refused(http: httpx.Client, stubbed: Served, diary: Path) -> None:
    assert refusal_code(http.get(f"{ROBOTS}/nao/preparation")) == (404, "robot-not-found")
    assert diary.read_text() == ""
