"""The parts of a cluster as processes of their own: database over TCP, object store, web server, two workers.

Nothing is shared between them but the database and the store: each has a data folder of its own.
"""

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest

from stridelab.service.storage.database import parse_url
from support.faults.network import relay
from support.service.database import TestDatabases
from support.service.external_services import ADDRESS, BUCKET, OPTIONS, Collector, Span, collector, span_attributes
from support.service.processes import assert_sound, environment, free_port, is_over, wait_until


@dataclass
class Cluster:
    """What was started, and how to start and end the store."""

    http: httpx.Client
    database_url: str
    folder: Path
    store_port: int
    heard: Collector
    store: "subprocess.Popen[bytes] | None" = None

    @property
    def objects(self) -> Path:
        return self.folder / "objects" / BUCKET / "data"

    def start_store(self) -> None:
        self.store = _program("support.service.external_services", str(self.store_port), str(self.folder / "objects"))
        wait_until(self._store_answers, 20.0, "the object store")

    def end_store(self) -> None:
        if self.store is not None:
            self.store.kill()
            self.store.wait()

    def finished(self, job_id: str, timeout_s: float = 90.0) -> dict[str, Any]:
        began = time.monotonic()
        while True:
            job: dict[str, Any] = self.http.get(f"/jobs/{job_id}").raise_for_status().json()
            if job["state"] not in ("queued", "running"):
                return job
            assert not is_over(began, timeout_s), job
            time.sleep(0.1)

    def submit(self, kind: str, body: dict[str, Any]) -> str:
        return str(self.http.post(f"/jobs/{kind}", json=body).raise_for_status().json()["id"])

    def _store_answers(self) -> bool:
        try:
            return httpx.get(f"http://127.0.0.1:{self.store_port}/").status_code == 200
        except httpx.TransportError:
            return False


def _program(module: str, *arguments: str, **settings: str) -> "subprocess.Popen[bytes]":
    return subprocess.Popen([sys.executable, "-m", module, *arguments], env=environment(**settings))


@contextmanager
def _running(module: str, **settings: str) -> Iterator[None]:
    process = _program(module, **settings)
    try:
        yield
    finally:
        process.kill()
        process.wait()


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory, postgres: TestDatabases) -> Iterator[Cluster]:
    folder = tmp_path_factory.mktemp("cluster")
    port, store_port = free_port(), free_port()
    credentials = folder / "credentials"
    given = OPTIONS | {"endpoint": f"http://127.0.0.1:{store_port}"}
    credentials.write_text("".join(f"{name}={value}\n" for name, value in given.items()), encoding="utf-8")
    with ExitStack() as stack:
        url = stack.enter_context(postgres.fresh())
        settings = {
            "STRIDELAB_DATABASE_URL": stack.enter_context(_over_tcp(url)),
            "STRIDELAB_BLOB_URL": ADDRESS,
            "STRIDELAB_BLOB_CREDENTIALS_FILE": str(credentials),
        }
        heard = stack.enter_context(collector())
        settings["STRIDELAB_OTLP_URL"] = heard.url
        http = stack.enter_context(httpx.Client(base_url=f"http://127.0.0.1:{port}/api/v1", timeout=30.0))
        made = Cluster(http, url, folder, store_port, heard)
        made.start_store()
        stack.callback(made.end_store)
        for name in ("a", "b"):
            own = settings | {"STRIDELAB_DATA_DIR": str(folder / name)}
            stack.enter_context(_running("stridelab.service.jobs.worker", **own))
        own = settings | {"STRIDELAB_DATA_DIR": str(folder / "web"), "STRIDELAB_PORT": str(port)}
        stack.enter_context(_running("stridelab.service.api", **own))
        wait_until(lambda: _answers(http), 120.0, "the web server")
        yield made


@contextmanager
def _over_tcp(url: str) -> Iterator[str]:
    """The address of the same database by TCP; an embedded server has a socket only."""
    address = parse_url(url)
    folder = address.query.get("host")
    if not isinstance(folder, str):
        yield url
        return
    with relay(f"{folder}/.s.PGSQL.5432") as cable:
        yield f"postgresql://{address.username}@127.0.0.1:{cable.port}/{address.database}?sslmode=disable"


def _answers(http: httpx.Client) -> bool:
    try:
        return http.get("/health").status_code == 200
    except httpx.TransportError:
        return False


@pytest.fixture(scope="module")
def recording(cluster: Cluster) -> str:
    made = cluster.submit("simulate-recording", {"seed": 1, "duration_s": 3.0})
    job = cluster.finished(made)
    assert job["state"] == "succeeded", job
    return str(cluster.http.get(f"/jobs/{made}/result").json()["summary"]["recording_id"])


def test_both_workers_share_the_work_and_files_go_through_the_store(cluster: Cluster, recording: str) -> None:
    ids = [cluster.submit("estimate-com", {"recording_id": recording, "latency": 0.001 * n}) for n in range(8)]
    jobs = [cluster.finished(job_id) for job_id in ids]
    assert [job["state"] for job in jobs] == ["succeeded"] * 8, jobs
    for job_id in ids:
        files = cluster.http.get(f"/jobs/{job_id}/result").raise_for_status().json()["artifacts"]
        assert {file["name"] for file in files} >= {"com.csv", "com.parquet"}
        for file in files:
            downloaded = cluster.http.get(f"/jobs/{job_id}/artifacts/{file['name']}").raise_for_status()
            assert len(downloaded.content) == file["bytes"]
    assert_sound(cluster.database_url, cluster.objects, ids)
    for name in ("a", "b", "web"):
        assert not list((cluster.folder / name).rglob("*.parquet")), "files lie in the store alone"
    started = [(job["started_at"], job["finished_at"]) for job in jobs]
    overlapping = sum(a[0] < b[1] and b[0] < a[1] for n, a in enumerate(started) for b in started[:n])
    assert overlapping, "no two of them were computed at a time"


def test_a_request_and_its_job_on_another_machine_are_one_trace(cluster: Cluster, recording: str) -> None:
    trace, above = "0af7651916cd43dd8448eb211c80319c", "b7ad6b7169203331"
    body = {"recording_id": recording, "latency": 0.05}
    sent = cluster.http.post("/jobs/estimate-com", json=body, headers={"traceparent": f"00-{trace}-{above}-01"})
    job_id = sent.raise_for_status().json()["id"]
    cluster.finished(job_id)

    def spans() -> list[tuple[str, Span]]:
        return [(service, span) for service, span in cluster.heard.spans if span.trace_id.hex() == trace]

    wait_until(lambda: len(spans()) >= 5, 30.0, "five spans of one trace")
    by_name = {span.name: (service, span) for service, span in spans()}
    assert {name: service for name, (service, _) in by_name.items()} == {
        "POST /jobs/estimate-com": "stridelab-api",
        "job estimate-com": "stridelab-worker",
        "stage": "stridelab-worker",
        "compute": "stridelab-worker",
        "publish": "stridelab-worker",
    }
    request, job = by_name["POST /jobs/estimate-com"][1], by_name["job estimate-com"][1]
    assert request.parent_span_id.hex() == above
    assert job.parent_span_id == request.span_id
    assert {by_name[name][1].parent_span_id for name in ("stage", "compute", "publish")} == {job.span_id}
    assert span_attributes(job) == {"job_id": job_id, "kind": "estimate-com", "attempt": 1, "state": "succeeded"}
    assert span_attributes(request).keys() == {"request_id", "http.response.status_code"}


def test_a_store_that_is_away_is_waited_for_and_reported(cluster: Cluster, recording: str) -> None:
    before = cluster.finished(cluster.submit("estimate-com", {"recording_id": recording, "latency": 0.02}))
    cluster.end_store()
    job_id = cluster.submit("estimate-com", {"recording_id": recording, "latency": 0.03})
    refusal = cluster.http.get(f"/jobs/{before['id']}/artifacts/com.csv", timeout=60.0)
    assert refusal.status_code == 503
    assert refusal.json()["code"] == "storage-unavailable"
    assert cluster.http.get(f"/jobs/{job_id}").json()["state"] in ("queued", "running")
    cluster.start_store()
    job = cluster.finished(job_id)
    assert (job["state"], job["attempt"]) == ("succeeded", 1), job
    assert cluster.http.get(f"/jobs/{before['id']}/artifacts/com.csv").status_code == 200
    assert_sound(cluster.database_url, cluster.objects, [before["id"], job_id])
