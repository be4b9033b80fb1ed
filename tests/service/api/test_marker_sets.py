"""Marker sets over HTTP: stored, used by all recordings that they fit, named in the facts, deleted by their owner."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import pytest

from stridelab.recordings.files.c3d_writer import write_c3d
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.reader import read_recording
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.tasks import EstimateComTask
from stridelab.service.kinds.estimate_com import run as estimate_com
from stridelab.service.kinds.staging import stage_estimate_com
from support.command_line import SAMPLE, quiet
from support.service.web_server import Served, refusal_code, upload

SETS = "/api/v1/marker-sets"
RECORDINGS = "/api/v1/recordings"


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, dict[str, str]]:
    """The sample under labels that no shipped set has, and its map from landmark to label."""
    recording = read_recording(SAMPLE / "recording.c3d")
    new = {label: f"mk{k:02d}" for k, label in enumerate(recording.markers_m)}
    path = tmp_path_factory.mktemp("lab") / "walk.c3d"
    write_c3d(path, replace(recording, markers_m={new[label]: t for label, t in recording.markers_m.items()}))
    return path.read_bytes(), {m: new[label] for m, label in identify(tuple(recording.markers_m)).landmarks.items()}


@pytest.fixture(autouse=True)
def no_sets(http: httpx.Client) -> Iterator[None]:
    yield
    for item in http.get(SETS).json()["items"]:
        http.delete(f"{SETS}/{item['id']}")


def uploaded(http: httpx.Client, content: bytes) -> dict[str, Any]:
    answer = upload(http, content)
    assert answer.status_code == 201, answer.text
    recording: dict[str, Any] = answer.json()
    return recording


def codes(recording: dict[str, Any]) -> set[str]:
    return {warning["code"] for warning in recording["warnings"]}


def test_a_set_from_storing_to_deletion(http: httpx.Client) -> None:
    body = {"name": "own", "landmarks": {"c7": "A", "t8": ["B", "b 2"]}, "required": ["c7"], "source": "our lab"}
    answer = http.post(SETS, json=body)
    assert answer.status_code == 201, answer.text
    stored_set = answer.json()
    assert {name: stored_set[name] for name in body} == body
    assert (stored_set["owner"], stored_set["recordings"]) == (None, [])
    path = answer.headers["location"]
    assert path == f"{SETS}/{stored_set['id']}"
    assert http.get(path).json() == {name: value for name, value in stored_set.items() if name != "recordings"}
    assert [item["id"] for item in http.get(SETS).json()["items"]] == [stored_set["id"]]
    assert refusal_code(http.post(SETS, json=body)) == (409, "marker-set-name-taken")
    assert refusal_code(http.post(SETS, json={**body, "name": "plug-in-gait"})) == (409, "marker-set-name-taken")
    assert http.delete(path).status_code == 204
    for method in ("GET", "DELETE"):
        assert refusal_code(http.request(method, path)) == (404, "marker-set-not-found")
    actions = [(item["action"], item["what"]) for item in http.get("/api/v1/audit").json()["items"]]
    assert actions[:2] == [("marker-set-deleted", stored_set["id"]), ("marker-set-added", stored_set["id"])]
    again = http.post(SETS, json=stored_set)
    assert again.status_code == 201, "the fields of a stored set are ignored"
    assert again.json()["id"] != stored_set["id"]
    assert {name: again.json()[name] for name in body} == body


@pytest.mark.parametrize(
    ("changes", "place"),
    [
        ({"landmarks": {"tail": "T"}, "required": ["c7"]}, "landmarks.tail"),
        ({"landmarks": {"c7": "A", "t8": "a"}, "required": ["c7"]}, "landmarks.t8"),
        ({"landmarks": {"c7": "A"}}, "required"),
    ],
)
def test_an_invalid_set_is_refused_naming_the_entry(http: httpx.Client, changes: dict[str, Any], place: str) -> None:
    answer = http.post(SETS, json={"name": "own", **changes})
    assert refusal_code(answer) == (422, "marker-set-invalid")
    assert place in [fault["where"] for fault in answer.json()["errors"]]
    assert http.get(SETS).json()["items"] == []


def test_stored_and_new_recordings_use_the_set_and_a_deleted_one_is_named(
    http: httpx.Client, lab: tuple[bytes, dict[str, str]]
) -> None:
    content, landmarks = lab
    before = uploaded(http, content)
    assert before["marker_set"] is None
    (reason,) = {offer["reason"] for offer in before["estimates"]}
    assert "POST /marker-sets" in reason

    stored_set = http.post(SETS, json={"name": "lab", "landmarks": landmarks}).json()
    assert stored_set["recordings"] == [before["id"]]
    path = f"{RECORDINGS}/{before['id']}"
    assert (http.get(path).json()["marker_set"], http.get(path).json()["marker_set_id"]) == ("lab", stored_set["id"])
    assert all(offer["possible"] for offer in http.get(path).json()["estimates"])
    after = uploaded(http, content)
    assert (after["marker_set"], after["marker_set_id"], after["landmarks"]) == ("lab", stored_set["id"], landmarks)
    batch = http.post(f"{RECORDINGS}/batch", files=[("file", ("walk.c3d", content))]).json()
    assert batch["recordings"][0]["marker_set_id"] == stored_set["id"]
    assert "marker-set-deleted" not in codes(after)

    http.delete(f"{SETS}/{stored_set['id']}")
    after_deletion = http.get(path).json()
    assert "marker-set-deleted" in codes(after_deletion)
    assert after_deletion["marker_set"] == "lab"
    unrelated = uploaded(http, (SAMPLE / "recording.c3d").read_bytes())
    assert "marker-set-deleted" not in codes(unrelated)


def test_a_shipped_set_wins_only_if_it_fits_better(http: httpx.Client) -> None:
    content = (SAMPLE / "recording.c3d").read_bytes()
    shipped = uploaded(http, content)
    fewer = {name: label for name, label in shipped["landmarks"].items() if name != "c7"}
    assert http.post(SETS, json={"name": "fewer", "landmarks": fewer}).json()["recordings"] == []
    assert uploaded(http, content)["marker_set"] == shipped["marker_set"]
    equal = http.post(SETS, json={"name": "equal", "landmarks": shipped["landmarks"]}).json()
    assert shipped["id"] in equal["recordings"]
    assert http.get(f"{RECORDINGS}/{shipped['id']}").json()["marker_set"] == "equal"


def test_the_task_of_an_estimate_carries_the_sets(
    http: httpx.Client, service: Served, lab: tuple[bytes, dict[str, str]], tmp_path: Path
) -> None:
    content, landmarks = lab
    recording = uploaded(http, content)
    stored_set = http.post(SETS, json={"name": "lab", "landmarks": landmarks, "source": "x"}).json()

    async def staged() -> dict[str, Any]:
        async with service.parts.engine.connect() as connection:
            job_input = EstimateComInput(recording_id=recording["id"])
            return await stage_estimate_com(connection, service.parts.blobs, job_input, tmp_path)

    task = service.run(staged())
    (carried,) = task["recording"]["marker_sets"]
    assert (carried["id"], carried["name"], carried["landmarks"]) == (stored_set["id"], "lab", landmarks)
    outcome = estimate_com.run(EstimateComTask.model_validate(task), tmp_path, quiet)
    assert outcome.summary["mass_kg"] == pytest.approx(60.0, abs=1.5)


def test_a_proposal_for_a_recording_names_every_label_once(
    http: httpx.Client, lab: tuple[bytes, dict[str, str]]
) -> None:
    content, landmarks = lab
    recording = uploaded(http, content)
    answer = http.post(f"{SETS}/propose", json={"recording_id": recording["id"]})
    assert answer.status_code == 200, answer.text
    proposal = answer.json()
    assert proposal["recording_id"] == recording["id"]
    labels = [one["label"] for one in proposal["landmarks"].values()]
    assert sorted([*labels, *proposal["unassigned"]]) == sorted(recording["labels"])
    right = [name for name, one in proposal["landmarks"].items() if landmarks.get(name) == one["label"]]
    assert len(right) >= 0.7 * len(landmarks), "from position and motion alone"
    assert refusal_code(http.post(f"{SETS}/propose", json={"recording_id": "none"})) == (404, "recording-not-found")
