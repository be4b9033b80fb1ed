"""Measure what every job kind costs, on a service of its own; writes docs/job_costs.json, which the sizing page uses.

Processor time is that of the job's child, read from the account of ended children of the process that they are forked
from, so it holds on a busy machine, too. Wall times are given beside it and mean something on an idle machine only.
usage: measure_jobs.py [ROUNDS] [KIND ...]    with kinds, only these are measured anew, and the other figures stay
"""

import contextlib
import json
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx
import psutil
import psycopg

from stridelab.service.postgres.embedded import running_url

TARGET = Path(__file__).parents[1] / "docs" / "job_costs.json"
SUBMISSIONS, READINGS, REPORTS, CLIENTS = 200, 400, 2000, 8
SLOW_S = 60.0
"""What takes longer is measured once."""


@contextlib.contextmanager
def service(folder: Path) -> Iterator[tuple[httpx.Client, psutil.Process]]:
    """A service with one slot, and its supervisor."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    settings = {"DATA_DIR": folder, "PORT": port, "WORKER_SLOTS": 1, "QUEUE_LIMIT": 10_000}
    environment = os.environ | {f"STRIDELAB_{name}": str(value) for name, value in settings.items()}
    process = subprocess.Popen([sys.executable, "-m", "stridelab.cli", "serve"], env=environment)
    with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=700.0, trust_env=False) as http:
        try:
            for _ in range(300):
                with contextlib.suppress(httpx.TransportError):
                    if http.get("/api/v1/health").status_code == 200:
                        break
                time.sleep(0.5)
            yield http, psutil.Process(process.pid)
        finally:
            process.terminate()
            process.wait(30)


def member(supervisor: psutil.Process, module: str) -> psutil.Process:
    """The process below the service's that runs ``module``, as soon as it is there."""
    until = time.monotonic() + 60.0
    while time.monotonic() < until:
        for child in supervisor.children(recursive=True):
            if module in child.cmdline():
                return child
        time.sleep(0.2)
    raise SystemExit(f"nothing runs {module}")


def nursery(supervisor: psutil.Process) -> psutil.Process:
    """The worker's fork server, after it has imported everything."""
    process = member(member(supervisor, "stridelab.service.jobs.worker"), "stridelab.service.processes.fork_server")
    while process.status() == psutil.STATUS_RUNNING:
        time.sleep(0.5)
    return process


def ended_children_s(process: psutil.Process) -> float:
    """Processor time of the children that have ended."""
    times = process.cpu_times()
    return float(times.children_user + times.children_system)


def own_s(process: psutil.Process) -> float:
    """Processor time of the process itself."""
    times = process.cpu_times()
    return float(times.user + times.system)


def run(http: httpx.Client, forked_from: psutil.Process, kind: str, body: Any) -> dict[str, float]:
    """Run one job; return its processor time, its wall-clock time and the bytes that it leaves."""
    before = ended_children_s(forked_from)
    job = http.post(f"/api/v1/jobs/{kind}", json=body).raise_for_status().json()
    while (job := http.get(f"/api/v1/jobs/{job['id']}?wait=30").json())["state"] in ("queued", "running"):
        pass
    if job["state"] != "succeeded":
        raise SystemExit(f"{kind} ended as {job['state']}: {job.get('error')}")
    time.sleep(1.0)
    result = http.get(f"/api/v1/jobs/{job['id']}/result").json()
    clock = [time.mktime(time.strptime(job[name][:19], "%Y-%m-%dT%H:%M:%S")) for name in ("started_at", "finished_at")]
    return {
        "cpu_s": round(ended_children_s(forked_from) - before, 2),
        "wall_s": clock[1] - clock[0],
        "bytes": sum(artifact["bytes"] for artifact in result["artifacts"]),
    }


def kinds(
    http: httpx.Client, forked_from: psutil.Process, rounds: int, wanted: Sequence[str] = ()
) -> dict[str, list[dict[str, float]]]:
    """The ``wanted`` kinds, by default all, with the first of their examples."""
    measured: dict[str, list[dict[str, float]]] = {}
    for path, calls in http.get("/api/v1/openapi.json").json()["paths"].items():
        content = calls.get("post", {}).get("requestBody", {}).get("content", {}).get("application/json", {})
        if not path.startswith("/api/v1/jobs/") or not content.get("examples"):
            continue
        kind = path.rsplit("/", 1)[1]
        if wanted and kind not in wanted:
            continue
        body = next(iter(content["examples"].values()))["value"]
        measured[kind] = [run(http, forked_from, kind, body)]
        while len(measured[kind]) < rounds and measured[kind][0]["cpu_s"] < SLOW_S:
            measured[kind].append(run(http, forked_from, kind, body))
        sys.stdout.write(f"{kind} {measured[kind]}\n")
        sys.stdout.flush()
    return measured


def calls(http: httpx.Client, api: psutil.Process) -> dict[str, float]:
    """Submissions and reads per second of web server and database, and the processor time of each."""

    def submit(number: int) -> str:
        body = {"item": "fig-2.5", "seeds": 1 + number % 10}
        return str(http.post("/api/v1/jobs/reproduce", json=body).raise_for_status().json()["id"])

    with ThreadPoolExecutor(CLIENTS) as pool:
        before, began = own_s(api), time.monotonic()
        ids = list(pool.map(submit, range(SUBMISSIONS)))
        submitted_s, submit_cpu_s = time.monotonic() - began, own_s(api) - before
        before, began = own_s(api), time.monotonic()
        list(pool.map(lambda n: http.get(f"/api/v1/jobs/{ids[n % len(ids)]}").raise_for_status(), range(READINGS)))
        read_s, read_cpu_s = time.monotonic() - began, own_s(api) - before
        list(pool.map(lambda job_id: http.delete(f"/api/v1/jobs/{job_id}"), ids))
    return {
        "submissions_per_s": round(SUBMISSIONS / submitted_s, 1),
        "submission_cpu_ms": round(1e3 * submit_cpu_s / SUBMISSIONS, 2),
        "readings_per_s": round(READINGS / read_s, 1),
        "reading_cpu_ms": round(1e3 * read_cpu_s / READINGS, 2),
    }


def progress(url: str) -> dict[str, float]:
    """Reports of progress per second, as ``Attempts.report`` writes them: a row, an event and a notification."""

    def report(number: int) -> None:
        with psycopg.connect(url, autocommit=True) as connection:
            for step in range(REPORTS // CLIENTS):
                with connection.transaction():
                    connection.execute("UPDATE job SET fraction = %s WHERE id = %s", (step / REPORTS, f"load-{number}"))
                    connection.execute(
                        "INSERT INTO job_event (job_id, state, attempt, fraction, message)"
                        " SELECT id, state, attempt, fraction, message FROM job WHERE id = %s",
                        (f"load-{number}",),
                    )
                    connection.execute("SELECT pg_notify('stridelab_job', %s)", (f"load-{number}",))

    with psycopg.connect(url) as connection:
        for number in range(CLIENTS):
            connection.execute(
                "INSERT INTO job (id, kind, state, input, input_hash) VALUES (%s, 'load', 'cancelled', '{}', '')",
                (f"load-{number}",),
            )
    began = time.monotonic()
    with ThreadPoolExecutor(CLIENTS) as pool:
        list(pool.map(report, range(CLIENTS)))
    return {"reports_per_s": round(REPORTS / (time.monotonic() - began), 1)}


def measure_again(rounds: int, wanted: Sequence[str]) -> None:
    """Measure the ``wanted`` kinds and replace their figures."""
    measured = json.loads(TARGET.read_text(encoding="utf-8"))
    with (
        tempfile.TemporaryDirectory(prefix="stridelab-measure-") as folder,
        service(Path(folder)) as (http, supervisor),
    ):
        measured["kinds"] |= kinds(http, nursery(supervisor), rounds, wanted)
    TARGET.write_text(json.dumps(measured, indent=1) + "\n", encoding="utf-8")


def main(rounds: int) -> None:
    """Measure everything and write it down."""
    with (
        tempfile.TemporaryDirectory(prefix="stridelab-measure-") as folder,
        service(Path(folder)) as (http, supervisor),
    ):
        forked_from = nursery(supervisor)
        imports_s = own_s(forked_from)
        measured: dict[str, Any] = {
            "imports_cpu_s": round(imports_s, 2),
            "nursery_mb": forked_from.memory_info().rss >> 20,
            "machine": {"cores": os.cpu_count(), "load_at_start": round(os.getloadavg()[0], 1)},
            "kinds": kinds(http, forked_from, rounds),
            "calls": calls(http, member(supervisor, "stridelab.service.api")),
            "progress": progress(str(running_url(Path(folder)))),
        }
    measured["machine"]["load_at_end"] = round(os.getloadavg()[0], 1)
    TARGET.write_text(json.dumps(measured, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    given = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    measure_again(given, sys.argv[2:]) if sys.argv[2:] else main(given)
