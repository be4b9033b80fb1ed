"""Both clients against a real server: they send the same calls and read the same answers."""

import inspect
import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from stridelab.client import AsyncClient, Client, ClientError, ProblemError, Unreachable, uploads
from stridelab.schemas.base import Problem
from stridelab.schemas.jobs import EstimateComInput, Job
from stridelab.schemas.recordings import PlateSwitch, RecordingPatch, SubjectFields, SubjectInput
from support.recordings.c3d_files import small_trial
from support.service.stored_rows import add_job, add_recording, fail_attempt, publish_result, report_progress, start_job
from support.service.web_server import Served


def test_both_clients_have_the_same_methods() -> None:
    def methods(kind: type) -> dict[str, list[str]]:
        return {
            name: list(inspect.signature(member).parameters)
            for name, member in vars(kind).items()
            if callable(member) and not name.startswith("_")
        }

    assert methods(Client) == methods(AsyncClient)


def test_the_synchronous_client_is_written_from_the_asynchronous_one() -> None:
    script = Path(__file__).parents[2] / "scripts" / "make_sync_client.py"
    assert subprocess.run([sys.executable, script, "--check"], check=False).returncode == 0


def test_a_running_service_is_healthy(lab: Client) -> None:
    assert lab.health().status == "ok"


def test_an_upload_reports_its_progress(lab: Client, tmp_path: Path) -> None:
    path = small_trial(tmp_path / 'Gang "Ü".c3d')
    progress: list[tuple[int, int]] = []
    subject = SubjectFields(name="P7", height_m=1.71, sex="male")
    recording = lab.upload(path, subject, progress=lambda sent, total: progress.append((sent, total)))
    assert recording.subject == subject
    assert recording.filename == "Gang %22Ü%22.c3d"
    assert recording.bytes == path.stat().st_size
    assert progress[-1] == (path.stat().st_size, path.stat().st_size)
    assert [sent for sent, _ in progress] == sorted({sent for sent, _ in progress})
    assert lab.recording(recording.id) == recording
    assert lab.download_file(recording.id, tmp_path / "back.c3d").read_bytes() == path.read_bytes()
    assert lab.download_tracks(recording.id, tmp_path / "tracks.parquet").read_bytes()[:4] == b"PAR1"


def test_recordings_are_listed_changed_and_deleted(lab: Client, service: Served) -> None:
    recording_id, other = (service.run(add_recording(service.parts)) for _ in range(2))
    page = lab.recordings(limit=1)
    assert [item.id for item in page.items] == [other]
    assert lab.recordings(limit=1, cursor=page.next).items[0].id == recording_id
    changed = lab.patch_recording(recording_id, RecordingPatch(static_recording_id=other))
    assert changed.static_recording_id == other
    assert lab.patch_recording(recording_id, RecordingPatch(static_recording_id=None)).static_recording_id is None
    lab.delete_recording(recording_id)
    with pytest.raises(ProblemError) as refused:
        lab.recording(recording_id)
    assert (refused.value.status, refused.value.code) == (404, "recording-not-found")


def test_a_refusal_has_code_sentence_and_places(lab: Client, service: Served) -> None:
    recording_id = service.run(add_recording(service.parts))
    with pytest.raises(ProblemError) as refused:
        lab.patch_recording(recording_id, RecordingPatch(plates={9: PlateSwitch(use=False)}))
    assert refused.value.code == "invalid-request"
    assert refused.value.errors[0].where == "plates.9"
    assert str(refused.value) == refused.value.detail
    assert "plates" in refused.value.detail


def test_a_subject_is_added_changed_and_deleted(lab: Client) -> None:
    subject = lab.add_subject(SubjectInput(name="P1", mass_kg=60.0))
    assert lab.subject(subject.subject_id) == subject
    assert lab.subjects(limit=1).items == [subject]
    changed = lab.patch_subject(subject.subject_id, SubjectInput(height_m=1.7))
    assert (changed.name, changed.height_m, changed.mass_kg) == ("P1", 1.7, 60.0)
    assert lab.patch_subject(subject.subject_id, SubjectInput(name=None)).name is None
    lab.delete_subject(subject.subject_id)
    with pytest.raises(ProblemError, match="no subject"):
        lab.subject(subject.subject_id)


def test_a_job_from_submission_to_files(lab: Client, service: Served, tmp_path: Path) -> None:
    recording_id = service.run(add_recording(service.parts))
    request = EstimateComInput(recording_id=recording_id, method="geometry")
    job = lab.submit("estimate-com", request, priority=3, idempotency_key=recording_id)
    assert (job.state, job.priority) == ("queued", 3)
    assert lab.submit("estimate-com", request, priority=3, idempotency_key=recording_id).id == job.id
    assert [item.id for item in lab.jobs(recording_id=recording_id, kind="estimate-com", state="queued").items] == [
        job.id
    ]
    service.run(
        publish_result(service.parts, service.run(start_job(service.parts, job.id)), [("com.csv", "text/csv", b"x")])
    )
    assert lab.wait(job.id, timeout_s=5.0).state == "succeeded"
    assert lab.result(job.id).input == {"recording_id": recording_id, "method": "geometry"}
    assert lab.read_artifact(job.id, "com.csv") == b"x"
    assert lab.download_artifact(job.id, "com.csv", tmp_path / "com.csv").read_bytes() == b"x"
    assert lab.download_bundle(job.id, tmp_path / "all.zip").read_bytes()[:2] == b"PK"
    with pytest.raises(ProblemError) as refused:
        lab.download_artifact(job.id, "none.csv", tmp_path / "none.csv")
    assert refused.value.code == "artifact-not-found"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["all.zip", "com.csv"]


def test_a_waiting_job_is_cancelled(lab: Client, service: Served) -> None:
    assert lab.cancel(service.run(add_job(service.parts))).state == "cancelled"


def later(work: Callable[[], Any], delay_s: float = 0.2) -> threading.Thread:
    thread = threading.Timer(delay_s, work)
    thread.start()
    return thread


def test_waiting_returns_as_soon_as_the_job_has_finished(lab: Client, service: Served) -> None:
    job_id = service.run(add_job(service.parts))
    attempt = service.run(start_job(service.parts, job_id))
    thread = later(lambda: service.run(fail_attempt(service.parts, attempt)))
    began_s = time.monotonic()
    job = lab.wait(job_id)
    assert job.state == "failed"
    assert job.error is not None
    assert job.error.code == "no-plates"
    assert time.monotonic() - began_s < 20
    thread.join()


def test_waiting_ends_at_its_time_limit(lab: Client, service: Served) -> None:
    with pytest.raises(TimeoutError, match="still queued"):
        lab.wait(service.run(add_job(service.parts)), timeout_s=0.2)


def test_events_are_received_until_the_job_ends(lab: Client, service: Served) -> None:
    job_id = service.run(add_job(service.parts))
    attempt = service.run(start_job(service.parts, job_id))

    def work() -> None:
        service.run(report_progress(service.parts, attempt, 0.5, "half"))
        service.run(publish_result(service.parts, attempt))

    thread = later(work)
    events = list(lab.events(job_id))
    thread.join()
    assert [event.state for event in events] == ["queued", "running", "running", "succeeded"]
    assert [event.progress.fraction for event in events] == [0.0, 0.0, 0.5, 1.0]
    assert [event.seq for event in lab.events(job_id, last_event_id=events[1].seq)] == [e.seq for e in events[2:]]


@pytest.mark.anyio
async def test_the_asynchronous_client_does_the_same(service: Served, tmp_path: Path) -> None:
    path = small_trial(tmp_path / "walk.c3d", with_plate=False)
    progress: list[int] = []
    async with AsyncClient(service.base_url) as lab:
        assert (await lab.health()).status == "ok"
        recording = await lab.upload(path, progress=lambda sent, total: progress.append(sent))
        assert progress[-1] == recording.bytes
        job = await lab.submit("estimate-com", {"recording_id": recording.id})
        attempt = service.run(start_job(service.parts, job.id))
        thread = later(lambda: service.run(publish_result(service.parts, attempt, [("com.csv", "text/csv", b"x")])))
        assert [event.state async for event in lab.events(job.id)][-1] == "succeeded"
        thread.join()
        assert (await lab.wait(job.id)).state == "succeeded"
        assert (await lab.result(job.id)).artifacts[0].name == "com.csv"
        target = await lab.download_artifact(job.id, "com.csv", tmp_path / "com.csv")
        assert target.read_bytes() == b"x"
        with pytest.raises(ProblemError):
            await lab.job("nope")
        await lab.delete_recording(recording.id)


def answering(handler: Callable[[httpx.Request], httpx.Response]) -> Client:
    return Client("http://lab", transport=httpx.MockTransport(handler))


JOB = {
    "id": "j",
    "kind": "k",
    "state": "queued",
    "priority": 0,
    "progress": {"fraction": 0.0, "message": ""},
    "attempt": 0,
    "created_at": "2026-01-01T00:00:00Z",
}


def event(seq: int, state: str) -> str:
    data = {"seq": seq, "at": "2026-01-01T00:00:00Z", "state": state, "attempt": 1, "progress": JOB["progress"]}
    return f"id: {seq}\nevent: state\ndata: {json.dumps(data)}\n\n"


class Broken(httpx.SyncByteStream):
    """A stream that breaks off in the middle of an event."""

    def __iter__(self) -> Iterator[bytes]:
        yield (event(1, "queued") + event(2, "running") + "id: 3\ndata: {").encode()
        raise httpx.ReadError("cut off")


def test_an_interrupted_stream_is_resumed_without_losing_or_repeating(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time, "sleep", lambda _: None)
    requested_ids: list[str | None] = []

    def handler(request: httpx.Request) -> httpx.Response:
        requested_ids.append(request.headers.get("last-event-id"))
        if len(requested_ids) == 1:
            return httpx.Response(200, stream=Broken())
        if len(requested_ids) == 2:
            return httpx.Response(503, json={"title": "-", "status": 503, "code": "c", "detail": "d"})
        if len(requested_ids) == 3:
            return httpx.Response(200, text=": nothing yet\n\n" + event(3, "running"))
        return httpx.Response(200, text=event(4, "succeeded"))

    with answering(handler) as lab:
        assert [e.seq for e in lab.events("j")] == [1, 2, 3, 4]
    assert requested_ids == [None, "2", "2", "3"]


def test_an_unreachable_service_is_reported_after_some_retries(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time, "sleep", lambda _: None)
    tries = 0

    def handler(request: httpx.Request) -> httpx.Response:
        nonlocal tries
        tries += 1
        raise httpx.ConnectError("refused", request=request)

    with answering(handler) as lab:
        with pytest.raises(Unreachable, match="http://lab"):
            lab.health()
        assert tries == 1
        for call in (lambda: list(lab.events("j")), lambda: lab.wait("j")):
            tries = 0
            with pytest.raises(Unreachable):
                call()
            assert tries > 3


def test_waiting_survives_a_restart_of_the_service(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time, "sleep", lambda _: None)
    answers = iter(["running", None, "running", None, "starting", "succeeded"])

    def handler(request: httpx.Request) -> httpx.Response:
        state = next(answers)
        if state is None:
            raise httpx.ConnectError("restarting", request=request)
        if state == "starting":
            problem = Problem(title="-", status=503, code="database-unreachable", detail="Wait.")
            return httpx.Response(503, json=problem.model_dump())
        return httpx.Response(200, json={**JOB, "state": state})

    with answering(handler) as lab:
        assert lab.wait("j").state == "succeeded"


def test_unknown_fields_of_a_newer_service_are_ignored() -> None:
    with answering(lambda _: httpx.Response(200, json={**JOB, "mood": "good"})) as lab:
        assert lab.job("j") == Job.model_validate(JOB)


def test_an_answer_that_is_not_json_is_reported() -> None:
    with (
        answering(lambda _: httpx.Response(200, text="<html>")) as lab,
        pytest.raises(ClientError, match="cannot parse"),
    ):
        lab.health()
    with answering(lambda _: httpx.Response(200, text="data: x\n\n")) as lab, pytest.raises(ClientError):
        list(lab.events("j"))


def test_a_refusal_of_a_proxy_is_a_problem_too() -> None:
    with answering(lambda _: httpx.Response(502, text="<html>")) as lab, pytest.raises(ProblemError) as refused:
        lab.health()
    assert (refused.value.status, refused.value.code) == (502, "http-error")


def test_a_full_queue_is_refused_with_retry_after() -> None:
    problem = Problem(title="Too Many Requests", status=429, code="queue-full", detail="Full.")
    answer = httpx.Response(429, json=problem.model_dump(), headers={"Retry-After": "5"})
    with answering(lambda _: answer) as lab, pytest.raises(ProblemError) as refused:
        lab.submit("estimate-com", {})
    assert refused.value.retry_after_s == 5.0


def test_tokens_and_unusual_ids_are_sent_safely() -> None:
    requests: list[httpx.Request] = []

    def handler(request: httpx.Request) -> httpx.Response:
        requests.append(request)
        return httpx.Response(200, json=JOB)

    with Client("http://lab", token="t", transport=httpx.MockTransport(handler)) as lab:
        lab.job("../x?y#z", wait_s=2.0)
    assert requests[0].headers["authorization"] == "Bearer t"
    assert requests[0].url.raw_path == b"/api/v1/jobs/..%2Fx%3Fy%23z?wait=2"


def test_the_announced_length_of_an_upload_is_that_of_its_body(tmp_path: Path) -> None:
    path = tmp_path / 'a"b\\ü\n.c3d'
    path.write_bytes(b"\x00" * 600_001)
    subject = SubjectFields(name="Ü\r\nx", mass_kg=60.5, age_years=0.0)
    request = httpx.Request(
        "POST", "http://lab", **uploads.form([(path.name, path)], uploads.text_fields(subject, "a"))
    )
    body = request.read()
    assert request.headers["Content-Length"] == str(len(body))
    assert b'filename="a%22b\xc3\xbc.c3d"' in body
    assert body.count(b"\x00") == 600_001
