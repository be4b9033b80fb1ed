"""Parts of the result of a running job over HTTP: what is there, what follows a cursor, and what is refused."""

import json

import httpx
import pytest

from stridelab.service.jobs.attempts import AttemptStore
from stridelab.service.kinds.registry import KINDS
from support.service.stored_rows import add_job, publish_result, start_job
from support.service.web_server import Served, refusal_code

JOBS = "/api/v1/jobs"


@pytest.fixture
def job_id(service: Served) -> str:
    return service.run(add_job(service.parts))


def test_parts_of_a_running_job_follow_a_cursor(http: httpx.Client, service: Served, job_id: str) -> None:
    path = f"{JOBS}/{job_id}/partial"
    assert http.get(path).json() == {
        "job_id": job_id,
        "state": "queued",
        "attempt": 0,
        "chunks": [],
        "next": "0.0",
    }
    attempt = service.run(start_job(service.parts, job_id))
    frames = {"kind": "motion", "run": 1, "time_s": [0.0], "poses": [[[0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0]]]}
    check = {"value": 0.1, "unit": "m", "limit": 1.0, "at_least": False, "passed": True}
    odd = {"name": "with NUL \0 and \\u0000", **check, "phase": None, "effector": None, "time_s": None}
    checked = {"kind": "certificate", "checks": [odd], "passed": True}
    store = AttemptStore(service.parts.engine, KINDS)
    chunks = [(k + 1, json.dumps(chunk)) for k, chunk in enumerate((frames, checked))]
    assert service.run(store.report_progress(attempt, 0.5, "half", chunks))
    answer = http.get(path)
    assert answer.headers["cache-control"] == "no-store"
    body = answer.json()
    assert (body["state"], body["attempt"], body["chunks"], body["next"]) == ("running", 1, [frames, checked], "1.2")
    assert http.get(path, params={"after": "1.1"}).json()["chunks"] == [checked]
    assert http.get(path, params={"after": "1.2"}).json()["chunks"] == []
    assert http.get(path, params={"after": "0.2"}).json()["chunks"] == [frames, checked]
    service.run(publish_result(service.parts, attempt))
    assert http.get(path).json()["chunks"] == []


@pytest.mark.parametrize("after", ["1", "1.", ".1", "1.2.3", "-1.2", "1.x", "1.99999999999", "\u0661.\u0662"])
def test_a_wrong_cursor_of_parts_is_refused(http: httpx.Client, job_id: str, after: str) -> None:
    assert refusal_code(http.get(f"{JOBS}/{job_id}/partial", params={"after": after})) == (422, "invalid-cursor")


def test_parts_of_an_unknown_job_are_not_found(http: httpx.Client) -> None:
    assert refusal_code(http.get(f"{JOBS}/{'f' * 32}/partial")) == (404, "job-not-found")
