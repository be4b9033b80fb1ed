"""Jobs over HTTP: submitted once, followed, waited for, cancelled; and what came out of them."""

import io
import json
import threading
import time
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import psycopg
import pytest

from stridelab.service.api.jobs.presentation import job_of
from stridelab.service.kinds.registry import KINDS
from support.service.database import TestDatabases
from support.service.stored_rows import add_job, add_recording, fail_attempt, publish_result, report_progress, start_job
from support.service.web_server import Served, refusal_code, served

JOBS = "/api/v1/jobs"


@pytest.fixture
def recording_id(service: Served) -> str:
    return service.run(add_recording(service.parts))


@pytest.fixture
def job_id(service: Served) -> str:
    return service.run(add_job(service.parts))


def test_a_submission_is_accepted_with_the_address_of_its_job(http: httpx.Client, recording_id: str) -> None:
    answer = http.post(f"{JOBS}/estimate-com?priority=7", json={"recording_id": recording_id})
    assert answer.status_code == 202
    body = answer.json()
    assert answer.headers["location"] == f"{JOBS}/{body['id']}"
    assert (body["kind"], body["state"], body["priority"], body["attempt"]) == ("estimate-com", "queued", 7, 0)
    assert body["recording_id"] == recording_id
    assert body["queue_position"] == 1
    assert http.get(answer.headers["location"]).json() == body


def test_an_unknown_kind_lists_the_known_ones(http: httpx.Client) -> None:
    answer = http.post(f"{JOBS}/make-coffee", json={})
    assert refusal_code(answer) == (404, "unknown-job-kind")
    assert "estimate-com" in answer.json()["detail"]
    assert "coffee" not in answer.text


def test_an_unknown_recording_is_refused_at_once(http: httpx.Client) -> None:
    for identifier in ("f" * 32, "\u0000", "", "../x"):
        status, _ = refusal_code(http.post(f"{JOBS}/estimate-com", json={"recording_id": identifier}))
        assert status in (404, 422)


@pytest.mark.parametrize(
    ("kind", "body", "where"),
    [
        ("estimate-com", {}, "recording_id"),
        ("estimate-com", {"recording_id": 7}, "recording_id"),
        ("estimate-com", {"recording_id": "x", "method": "magic"}, "method"),
        ("estimate-com", {"recording_id": "x", "surprise": 1}, "surprise"),
        ("simulate-recording", {"duration_s": 1e9}, "duration_s"),
        ("simulate-recording", {"noise": {"force_n": -1}}, "noise.force_n"),
    ],
)
def test_an_invalid_input_is_named(http: httpx.Client, kind: str, body: object, where: str) -> None:
    answer = http.post(f"{JOBS}/{kind}", json=body)
    assert refusal_code(answer) == (422, "invalid-request")
    assert answer.json()["errors"][0]["where"] == where


@pytest.mark.parametrize("priority", ["x", "101", "-101", "1e3", "9" * 30])
def test_an_absurd_priority_is_refused(http: httpx.Client, recording_id: str, priority: str) -> None:
    answer = http.post(f"{JOBS}/estimate-com", params={"priority": priority}, json={"recording_id": recording_id})
    assert refusal_code(answer) == (422, "invalid-request")


def test_the_same_key_is_the_same_job(http: httpx.Client, recording_id: str) -> None:
    headers = {"Idempotency-Key": f"key-{recording_id}"}
    first = http.post(f"{JOBS}/estimate-com", json={"recording_id": recording_id}, headers=headers)
    again = http.post(f"{JOBS}/estimate-com", json={"recording_id": recording_id}, headers=headers)
    assert first.status_code == again.status_code == 202
    assert first.json()["id"] == again.json()["id"]
    other = http.post(
        f"{JOBS}/estimate-com", json={"recording_id": recording_id, "method": "geometry"}, headers=headers
    )
    assert refusal_code(other) == (409, "idempotency-key-reused")


@pytest.mark.parametrize("key", ["", "x" * 201, "a b", "ü".encode()])
def test_an_odd_key_is_refused(http: httpx.Client, recording_id: str, key: str | bytes) -> None:
    headers = {"Idempotency-Key": key}
    answer = http.post(f"{JOBS}/estimate-com", json={"recording_id": recording_id}, headers=headers)  # type: ignore[arg-type]  # bytes are allowed
    assert refusal_code(answer) == (422, "invalid-request")


def test_a_full_queue_is_refused_with_retry_after(
    postgres: TestDatabases, tmp_path_factory: pytest.TempPathFactory
) -> None:
    data = tmp_path_factory.mktemp("data")
    with postgres.fresh() as url, served(url, data, queue_limit=2) as small, small.http() as http:
        answers = [http.post(f"{JOBS}/simulate-recording", json={"seed": seed}) for seed in range(4)]
        assert [answer.status_code for answer in answers] == [202, 202, 429, 429]
        assert refusal_code(answers[-1]) == (429, "queue-full")
        assert int(answers[-1].headers["retry-after"]) >= 1
        listed = http.get(JOBS, params={"state": "queued"}).json()["items"]
        assert sorted(item["queue_position"] for item in listed) == [1, 2]


def test_the_list_can_be_narrowed(http: httpx.Client, service: Served, recording_id: str) -> None:
    jobs = [service.run(add_job(service.parts, recording_id)) for _ in range(3)]
    service.run(fail_attempt(service.parts, service.run(start_job(service.parts, jobs[0]))))

    def listed(**params: str) -> list[str]:
        answer = http.get(JOBS, params={"recording_id": recording_id, **params})
        return [item["id"] for item in answer.json()["items"]]

    assert listed() == jobs[::-1]
    assert listed(state="failed") == [jobs[0]]
    assert listed(kind="simulate-recording") == []
    page = http.get(JOBS, params={"recording_id": recording_id, "limit": "2"}).json()
    assert [item["id"] for item in page["items"]] == jobs[:0:-1]
    rest = http.get(JOBS, params={"recording_id": recording_id, "limit": "2", "cursor": page["next"]}).json()
    assert ([item["id"] for item in rest["items"]], rest["next"]) == ([jobs[0]], None)
    for params in ({"state": "lost"}, {"kind": "a\x00"}, {"recording_id": "ü"}):
        assert refusal_code(http.get(JOBS, params=params)) == (422, "invalid-request")


def test_a_failed_job_gives_the_reason(http: httpx.Client, service: Served, job_id: str) -> None:
    service.run(fail_attempt(service.parts, service.run(start_job(service.parts, job_id))))
    body = http.get(f"{JOBS}/{job_id}").json()
    assert body["state"] == "failed"
    assert body["error"]["code"] == "no-plates"
    assert body["error"]["errors"] == [{"where": "plates", "message": "none"}]
    assert body["log_tail"] == "log"
    assert refusal_code(http.get(f"{JOBS}/{job_id}/result")) == (409, "job-without-result")
    assert refusal_code(http.get(f"{JOBS}/{job_id}/bundle.zip")) == (409, "job-without-result")


def test_waiting_ends_with_the_job(http: httpx.Client, service: Served, job_id: str) -> None:
    attempt = service.run(start_job(service.parts, job_id))
    states: list[str] = []

    def wait() -> None:
        states.append(http.get(f"{JOBS}/{job_id}", params={"wait": "25"}).json()["state"])

    waiting = threading.Thread(target=wait)
    waiting.start()
    time.sleep(0.3)
    assert waiting.is_alive()
    service.run(publish_result(service.parts, attempt))
    waiting.join(10)
    assert states == ["succeeded"]


def test_waiting_ends_after_its_time_limit(http: httpx.Client, job_id: str) -> None:
    assert http.get(f"{JOBS}/{job_id}", params={"wait": "0.2"}).json()["state"] == "queued"
    for wait in ("61", "-1", "nan", "inf", "x"):
        assert refusal_code(http.get(f"{JOBS}/{job_id}", params={"wait": wait})) == (422, "invalid-request")


def test_a_cancelled_job_stays_cancelled(http: httpx.Client, service: Served, job_id: str) -> None:
    only = {"cancel_only": "true"}
    assert http.delete(f"{JOBS}/{job_id}", params=only).json()["state"] == "cancelled"
    assert http.delete(f"{JOBS}/{job_id}", params=only).json()["state"] == "cancelled"
    finished_id = service.run(add_job(service.parts))
    service.run(publish_result(service.parts, service.run(start_job(service.parts, finished_id))))
    assert http.delete(f"{JOBS}/{finished_id}", params=only).json()["state"] == "succeeded"
    assert http.get(f"{JOBS}/{finished_id}").status_code == 200


def test_a_finished_job_is_deleted_with_its_files(http: httpx.Client, service: Served) -> None:
    before = service.stored_files()
    finished_id = service.run(add_job(service.parts))
    attempt = service.run(start_job(service.parts, finished_id))
    service.run(publish_result(service.parts, attempt, [("com.csv", "text/csv", b"time_s")]))
    assert f"{attempt.blob_prefix}/com.csv" in service.stored_files()
    assert http.delete(f"{JOBS}/{finished_id}").json()["state"] == "succeeded"
    assert refusal_code(http.get(f"{JOBS}/{finished_id}")) == (404, "job-not-found")
    assert not any(key.startswith("results/") for key in service.stored_files() - before)
    with psycopg.connect(str(service.parts.settings.database_url)) as connection:
        noted = connection.execute("SELECT action FROM audit WHERE what = %s", (finished_id,)).fetchall()
    assert noted == [("job-deleted",)]


def test_a_job_that_a_recording_needs_is_not_deleted(http: httpx.Client, service: Served) -> None:
    truth = service.run(add_job(service.parts))
    service.run(publish_result(service.parts, service.run(start_job(service.parts, truth))))
    simulated = service.run(add_recording(service.parts))
    with psycopg.connect(str(service.parts.settings.database_url)) as connection:
        connection.execute("UPDATE recording SET truth_job_id = %s WHERE id = %s", (truth, simulated))
    assert refusal_code(http.delete(f"{JOBS}/{truth}")) == (409, "job-holds-truth")
    assert http.get(f"{JOBS}/{truth}").status_code == 200


class Stream:
    """Events of a stream as they come, read by hand."""

    def __init__(self, response: httpx.Response) -> None:
        assert response.status_code == 200
        assert response.headers["content-type"].startswith("text/event-stream")
        assert "no-cache" in response.headers["cache-control"]
        self._lines = response.iter_lines()

    def __iter__(self) -> Iterator[dict[str, str]]:
        event: dict[str, str] = {}
        for line in self._lines:
            name, _, value = line.partition(": ")
            if line == "" and event:
                yield event
                event = {}
            elif name:
                event[name] = value


def test_events_come_as_they_happen_and_end_with_the_job(service: Served, job_id: str) -> None:
    with service.http() as http, http.stream("GET", f"{JOBS}/{job_id}/events") as response:
        events = iter(Stream(response))
        first = next(events)
        assert (first["event"], json.loads(first["data"])["state"]) == ("state", "queued")
        attempt = service.run(start_job(service.parts, job_id))
        assert json.loads(next(events)["data"])["state"] == "running"
        service.run(report_progress(service.parts, attempt, 0.5, "half"))
        half = next(events)
        assert half["event"] == "progress"
        assert json.loads(half["data"])["progress"] == {"fraction": 0.5, "message": "half", "text": "half"}
        service.run(publish_result(service.parts, attempt))
        last = next(events)
        assert (last["event"], json.loads(last["data"])["state"]) == ("state", "succeeded")
        assert next(events, None) is None


def test_events_resume_after_the_last_one_seen(service: Served, job_id: str) -> None:
    attempt = service.run(start_job(service.parts, job_id))
    for i in range(3):
        service.run(report_progress(service.parts, attempt, i / 3, str(i)))
    service.run(publish_result(service.parts, attempt))

    def events(**headers: str) -> list[dict[str, str]]:
        with service.http() as http, http.stream("GET", f"{JOBS}/{job_id}/events", headers=headers) as response:
            return list(Stream(response))

    everything = events()
    numbers = [int(event["id"]) for event in everything]
    assert numbers == sorted(set(numbers))
    assert len(everything) == 6
    for last_seq in range(6):
        resumed = events(**{"Last-Event-ID": everything[last_seq]["id"]})
        expected = [event["id"] for event in everything[last_seq + 1 :]]
        assert [event["id"] for event in resumed] == (expected or [everything[-1]["id"]])
        assert json.loads(resumed[-1]["data"])["state"] == "succeeded"


@pytest.mark.parametrize("last", ["x", "-1", "1.5", "9" * 20, "١"])
def test_an_odd_event_number_is_refused(http: httpx.Client, job_id: str, last: str) -> None:
    answer = http.get(f"{JOBS}/{job_id}/events", headers={"Last-Event-ID": last.encode()})  # type: ignore[dict-item]  # bytes are allowed
    assert refusal_code(answer) == (422, "invalid-event-id")


def test_a_stream_ends_when_its_job_is_deleted(service: Served, recording_id: str) -> None:
    job_id = service.run(add_job(service.parts, recording_id))
    with service.http() as http, http.stream("GET", f"{JOBS}/{job_id}/events") as response:
        events = iter(Stream(response))
        next(events)
        with service.http() as other:
            assert other.delete(f"/api/v1/recordings/{recording_id}").status_code == 204
        assert [json.loads(event["data"])["state"] for event in events] in ([], ["cancelled"])


def test_streams_and_polls_end_when_the_server_is_to_stop(
    postgres: TestDatabases, tmp_path_factory: pytest.TempPathFactory
) -> None:
    with postgres.fresh() as url, served(url, tmp_path_factory.mktemp("data")) as service, service.http() as http:
        job_id = service.run(add_job(service.parts))
        states: list[str] = []

        def wait() -> None:
            with service.http() as other:
                states.append(other.get(f"{JOBS}/{job_id}", params={"wait": "25"}).json()["state"])

        waiting = threading.Thread(target=wait)
        waiting.start()
        with http.stream("GET", f"{JOBS}/{job_id}/events") as response:
            events = iter(Stream(response))
            next(events)
            service.loop.call_soon_threadsafe(service.parts.closing.set)
            assert next(events, None) is None
        waiting.join(10)
        assert states == ["queued"]


def test_result_artifacts_and_bundle(http: httpx.Client, service: Served, recording_id: str) -> None:
    job_id = service.run(add_job(service.parts, recording_id))
    assert refusal_code(http.get(f"{JOBS}/{job_id}/result")) == (409, "job-not-finished")
    large = b"time_s,x_m\n" + b"0.0,1.0\n" * 200_000
    files = [
        ("com.csv", "text/csv", large),
        ("com.parquet", "application/vnd.apache.parquet", b"PAR1"),
    ]
    service.run(publish_result(service.parts, service.run(start_job(service.parts, job_id)), files))
    result = http.get(f"{JOBS}/{job_id}/result").json()
    assert result["kind"] == "estimate-com"
    assert result["input"]["recording_id"] == recording_id
    assert result["summary"] == {"mass_kg": 60.2}
    assert result["artifacts"] == [{"name": n, "media_type": m, "bytes": len(c), "sha256": None} for n, m, c in files]
    table = http.get(f"{JOBS}/{job_id}/artifacts/com.csv")
    assert table.content == large
    assert table.headers["content-type"].startswith("text/csv")
    assert "com.csv" in table.headers["content-disposition"]
    for name in ("nope", "..%2F..%2Fsecret", "%00", "com.csv%2F"):
        assert http.get(f"{JOBS}/{job_id}/artifacts/{name}").status_code == 404

    bundle = http.get(f"{JOBS}/{job_id}/bundle.zip")
    assert bundle.headers["content-type"] == "application/zip"
    with zipfile.ZipFile(io.BytesIO(bundle.content)) as archive:
        assert archive.testzip() is None
        assert set(archive.namelist()) == {
            "input.json",
            "result.json",
            "versions.json",
            "references.bib",
            "artifacts/com.csv",
            "artifacts/com.parquet",
            "input/walk.c3d",
        }
        assert archive.read("artifacts/com.csv") == large
        assert archive.read("input/walk.c3d") == recording_id.encode()
        assert json.loads(archive.read("result.json")) == result
        assert json.loads(archive.read("versions.json")) == result["versions"]
        assert b"@phdthesis{carpentier2017thesis," in archive.read("references.bib")


def test_a_missing_artifact_is_reported(http: httpx.Client, service: Served, job_id: str) -> None:
    attempt = service.run(start_job(service.parts, job_id))
    service.run(publish_result(service.parts, attempt, [("com.csv", "text/csv", b"x")]))
    service.run(service.parts.blobs.delete_prefix(f"results/{job_id}"))
    assert refusal_code(http.get(f"{JOBS}/{job_id}/artifacts/com.csv")) == (404, "file-gone")


def test_a_store_that_has_lost_the_content_of_a_file_is_reported(
    http: httpx.Client, service: Served, job_id: str, tmp_path: Path
) -> None:
    attempt = service.run(start_job(service.parts, job_id))
    service.run(publish_result(service.parts, attempt, [("com.csv", "text/csv", b"x")]))
    (tmp_path / "empty").touch()
    service.run(service.parts.blobs.put_file(f"{attempt.blob_prefix}/com.csv", tmp_path / "empty"))
    assert refusal_code(http.get(f"{JOBS}/{job_id}/artifacts/com.csv")) == (503, "stored-file-damaged")


def test_every_registered_kind_has_a_call(service: Served) -> None:
    paths = service.app.openapi()["paths"]
    called = {name for name in KINDS if f"{JOBS}/{name}" in paths}
    assert called == {name for name, kind in KINDS.items() if kind.offered} == set(KINDS) - {"read-batch"}


def test_jobs_have_the_same_verdict_in_the_list_and_alone(http: httpx.Client, service: Served) -> None:
    check = {"name": "vertical_bias", "value": 0.3, "limit": 0.022, "contradicted_above": 0.05, "passed": False}
    contradicted = {"quality": {"verdict": "contradicted", "checks": [check], "not_checked": {}}}
    certified = {"certificate": {"passed": True, "checks": []}, "replay": None}
    ids = [service.run(add_job(service.parts)) for _ in range(5)]
    attempts = [service.run(start_job(service.parts, job_id)) for job_id in ids[:4]]
    service.run(publish_result(service.parts, attempts[0], summary=contradicted))
    service.run(publish_result(service.parts, attempts[1], summary=certified))
    service.run(publish_result(service.parts, attempts[2]))
    partial: tuple[dict[str, Any], list[Any]] = ({"summary": contradicted, "references": [], "versions": {}}, [])
    service.run(fail_attempt(service.parts, attempts[3], partial))
    alone = {job_id: http.get(f"{JOBS}/{job_id}").json() for job_id in ids}
    listed = {job["id"]: job for job in http.get(JOBS, params={"limit": 200}).json()["items"]}
    verdicts = [alone[job_id]["verdict"] for job_id in ids]
    assert verdicts == [listed[job_id]["verdict"] for job_id in ids]
    assert verdicts[0] == {
        "outcome": "failed",
        "code": "sensors-contradict",
        "message": "Sensors contradict each other: vertical bias",
        "failed_checks": ["vertical_bias"],
    }
    assert (verdicts[1]["outcome"], verdicts[1]["code"]) == ("passed", "certified")
    assert verdicts[2:] == [None, None, None], (
        "nothing was checked; failed, though it has a partial result; still waiting"
    )


def test_jobs_say_what_they_are_about(service: Served) -> None:
    inputs: list[tuple[dict[str, Any], int | None, str | None]] = [
        ({"recording_ids": ["a", "b"]}, 2, None),
        ({"scenario": {"name": "Own <steps>", "robot": "talos"}, "robot": "hrp2"}, None, "Own <steps>"),
        ({"session_id": "s"}, None, "s"),
        ({"recording_ids": None, "item": "fig-2.6"}, None, "fig-2.6"),
        ({"robot": 3}, None, None),
    ]
    record = service.run(service.parts.store.get(service.run(add_job(service.parts))))
    for body, number, about in inputs:
        shown = job_of(replace(record, input=body, subject_name=None))
        assert (shown.n_recordings, shown.about) == (number, about)
    assert job_of(replace(record, input={"robot": "talos"})).about == record.subject_name == "walk.c3d"
