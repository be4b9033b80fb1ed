"""SIGSTOP of each process: the service is healthy again within 15 s, and no accepted job is lost."""

import os
import signal
import time
from collections.abc import Iterator

import httpx
import psutil
import pytest

from support.service.processes import SERVE, Service, running_service, wait_until

WITHIN_S = 15.0
MEMBERS = {
    "web server": "stridelab.service.api",
    "worker": "stridelab.service.jobs.worker",
    "viewer": "stridelab_web.viewer",
    "postmaster": "postgres",
}
NURSERIES = {"nursery of the web server": "stridelab.service.api", "nursery of the worker": MEMBERS["worker"]}
SIMULATION = "/api/v1/jobs/simulate-recording"


@pytest.fixture(scope="module")
def service() -> Iterator[Service]:
    """With the real kinds of job, and all processes that a user has."""
    with running_service(*SERVE, STRIDELAB_MIN_FREE_DISK_MB="0") as made:
        made.member(MEMBERS["viewer"])
        with client(made) as http:
            first = http.post(SIMULATION, json={}).json()["id"]
            wait_until(lambda: job_is_done(http, first), 120, "a first job")
        yield made


def client(service: Service) -> httpx.Client:
    return httpx.Client(base_url=f"http://127.0.0.1:{service.port}", timeout=5.0, trust_env=False)


def nursery_of(service: Service, parent: str) -> psutil.Process:
    servers: list[psutil.Process] = []

    def there() -> bool:
        children = service.member(parent).children()
        servers[:] = [child for child in children if "stridelab.service.processes.fork_server" in child.cmdline()]
        return bool(servers)

    wait_until(there, 60, f"a nursery of {parent}")
    return servers[0]


def job_is_done(http: httpx.Client, job_id: str) -> bool:
    try:
        return bool(http.get(f"/api/v1/jobs/{job_id}").json().get("state") == "succeeded")
    except httpx.TransportError:
        return False


def replaced(process: psutil.Process) -> bool:
    try:
        return process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


@pytest.mark.quiet
@pytest.mark.parametrize("name", [*MEMBERS, *NURSERIES])
def test_a_stopped_process_is_replaced_and_jobs_go_on(service: Service, name: str) -> None:
    with client(service) as http:
        victim = service.member(MEMBERS[name]) if name in MEMBERS else nursery_of(service, NURSERIES[name])
        accepted = http.post(SIMULATION, json={}).json()["id"]
        began = time.monotonic()
        os.kill(victim.pid, signal.SIGSTOP)
        wait_until(lambda: replaced(victim), WITHIN_S, f"another {name}")
        wait_until(service.healthy, max(WITHIN_S - (time.monotonic() - began), 0.1), "a healthy service")
        assert time.monotonic() - began < WITHIN_S
        if name in MEMBERS:
            another = service.member(MEMBERS[name], timeout_s=WITHIN_S)
            assert another.pid != victim.pid
        wait_until(lambda: job_is_done(http, accepted), 120, "the accepted job")
