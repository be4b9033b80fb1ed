"""Job kinds for tests; they stage nothing and run ``support.service.computations``.

``python -m support.service.job_kinds`` is a worker for them, with ``--fork`` a process that forks workers
(``support.service.processes.WorkerForks``).
"""

import asyncio
import gc
import json
import os
import signal
import socket
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from pydantic import ConfigDict
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.schemas.base import Contract
from stridelab.service.jobs.worker import run_worker
from stridelab.service.kinds.base import Blobs, JobKind
from stridelab.service.kinds.provenance import software_versions
from stridelab.service.logging import configure_logging
from stridelab.service.processes import fork_server
from stridelab.service.processes.fork_server_client import ForkServerClient, child_environment
from stridelab.service.settings import current_settings


class AnyInput(Contract):
    model_config = ConfigDict(extra="allow", frozen=True)


async def stage(_connection: AsyncConnection, _blobs: Blobs, job_input: Contract, _folder: Path) -> dict[str, Any]:
    return job_input.model_dump()


def kind(name: str, function: str, **limits: Any) -> JobKind:
    """A kind whose computation may note outside of its folder what it did, for the test to read."""
    return JobKind(
        name=name,
        title=name,
        description="For tests.",
        input_model=AnyInput,
        summary_model=AnyInput,
        run=f"support.service.computations:{function}",
        stage=stage,
        sandbox=None,
        **limits,
    )


KINDS: Mapping[str, JobKind] = {
    job_kind.name: job_kind
    for job_kind in (
        kind("work", "write_outcome", lane="short"),
        kind("long-work", "write_outcome", lane="long"),
        kind("show-parts", "show_parts", shows_parts=True),
        kind("refuse", "refuse"),
        kind("stop-half-way", "stop_half_way"),
        kind("stumble", "stumble"),
        kind("segfault", "segfault"),
        kind("abort", "abort"),
        kind("hog", "reserve", memory_mb=300),
        kind("hang", "hang", timeout_s=1.0),
        kind("hang-in-a-stage", "hang_in_a_stage", timeout_s=1.0),
        kind("stumble-in-a-stage", "stumble_in_a_stage"),
        kind("spin", "spin", lane="long"),
        kind("crunch", "crunch", lane="long"),
        kind("mark", "mark"),
        kind("echo", "echo", lane="long"),
        kind("reproduce", "write_outcome", lane="long"),  # a name that the web server takes
    )
}


def work() -> None:
    """Run a worker with the settings of the environment."""
    configure_logging("info")
    asyncio.run(run_worker(current_settings(), KINDS))


def fork_workers() -> None:
    """Fork a worker for every line of the input, ``{"environment", "log"}``, and answer with its process id."""
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    software_versions()  # what every worker computes once
    gc.freeze()
    for line in sys.stdin:
        request = json.loads(line)
        if (pid := os.fork()) == 0:
            _work_in_fork(request)
        print(pid, flush=True)


def _work_in_fork(request: dict[str, Any]) -> NoReturn:
    try:
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        log = os.open(request["log"], os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        for ours, descriptor in enumerate((os.open(os.devnull, os.O_RDONLY), log, log)):
            os.dup2(descriptor, ours)
        os.environ.clear()
        os.environ.update(request["environment"])
        _fork_first_fork_server()
        work()
    finally:
        os._exit(0)


class _ForkedProcess:
    """What ``ForkServerClient`` needs of a process, for one that was forked."""

    def __init__(self, pid: int) -> None:
        self.pid = pid

    def kill(self) -> None:
        os.kill(self.pid, signal.SIGKILL)

    async def wait(self) -> int:
        return (await asyncio.to_thread(os.waitpid, self.pid, 0))[1]


def _fork_first_fork_server() -> None:
    """Fork the fork server of this worker, which then has all imports; should it end, another one starts as usual."""
    ours, theirs = socket.socketpair()
    worker_pid = os.getpid()
    if (pid := os.fork()) == 0:
        _serve_forks(worker_pid, theirs)
    theirs.close()
    start_another = ForkServerClient.start_server

    async def start_server(preload: Sequence[str]) -> ForkServerClient:
        ForkServerClient.start_server = staticmethod(start_another)  # type: ignore[method-assign]
        ours.setblocking(False)
        return ForkServerClient(_ForkedProcess(pid), ours)  # type: ignore[arg-type]

    ForkServerClient.start_server = staticmethod(start_server)  # type: ignore[method-assign]


def _serve_forks(worker_pid: int, control: socket.socket) -> NoReturn:
    try:
        os.setsid()
        os.dup2(control.fileno(), 0)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.closerange(3, 256)  # the worker's end of the connection among them
        variables = child_environment()
        os.environ.clear()
        os.environ.update(variables)
        fork_server.main(worker_pid, [])
    finally:
        os._exit(1)


if __name__ == "__main__":
    fork_workers() if sys.argv[1:] == ["--fork"] else work()
