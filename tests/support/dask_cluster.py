"""A real Dask scheduler and real workers, each a process of its own, on loopback."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil

from support.service.processes import free_port

TESTS = Path(__file__).parents[1]
START_S = 60.0
_QUIET = {"DASK_DISTRIBUTED__WORKER__DAEMON": "True", "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "5s"}


class DaskCluster:
    """A scheduler, and workers with one thread each and a nanny, as ``dask worker`` starts them."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.port = folder, free_port()
        self.scheduler: subprocess.Popen[bytes] | None = None
        self.workers: list[subprocess.Popen[bytes]] = []

    @property
    def url(self) -> str:
        return f"tcp://127.0.0.1:{self.port}"

    def start_scheduler(self) -> None:
        options = ("--host", "127.0.0.1", "--port", str(self.port), "--no-dashboard")
        self.scheduler = self._start("scheduler", *options)

    def start_worker(self) -> subprocess.Popen[bytes]:
        options = ("--nthreads", "1", "--no-dashboard", "--local-directory", str(self.folder), "--memory-limit", "0")
        self.workers.append(self._start("worker", self.url, *options, "--host", "127.0.0.1"))
        return self.workers[-1]

    def kill_worker(self, worker: subprocess.Popen[bytes]) -> None:
        """Kill nanny, worker and the worker's processes at once, like a node that loses power."""
        family = [psutil.Process(worker.pid), *psutil.Process(worker.pid).children(recursive=True)]
        for process in family:
            with contextlib.suppress(psutil.NoSuchProcess):
                process.kill()
        worker.wait()

    def pieces(self) -> list[psutil.Process]:
        """Processes that compute an item now: the children of the workers' fork servers."""
        processes = []
        for worker in self.workers:
            with contextlib.suppress(psutil.NoSuchProcess):
                for process in psutil.Process(worker.pid).children(recursive=True):
                    if "multiprocessing.forkserver" in " ".join(process.cmdline()):
                        processes += process.children()
        return processes

    def count_transitions(self) -> int:
        """A number that grows with every task of the cluster."""
        from distributed import Client

        with Client(self.url, set_as_default=False) as client:
            return int(client.run_on_scheduler(lambda dask_scheduler: dask_scheduler.transition_counter))

    def wait_for_workers(self, n: int) -> None:
        from distributed import Client

        with Client(self.url, timeout=START_S, set_as_default=False) as client:
            client.wait_for_workers(n, timeout=START_S)

    def stop(self) -> None:
        for worker in self.workers:
            if worker.poll() is None:
                self.kill_worker(worker)
        if self.scheduler is not None:
            self.scheduler.kill()
            self.scheduler.wait()

    def _start(self, *command: str) -> subprocess.Popen[bytes]:
        environment = {**os.environ, **_QUIET, "PYTHONPATH": str(TESTS), "OMP_NUM_THREADS": "1"}
        environment.pop("STRIDELAB_DASK_URL", None)
        log = (self.folder / f"{command[0]}-{time.monotonic_ns()}.log").open("wb")
        with log:
            program = [sys.executable, "-m", "dask", *command]
            return subprocess.Popen(program, env=environment, stdout=log, stderr=log, start_new_session=True)


@contextlib.contextmanager
def dask_cluster(folder: Path, workers: int) -> Iterator[DaskCluster]:
    """A scheduler with so many workers, which are ready."""
    cluster = DaskCluster(folder)
    try:
        cluster.start_scheduler()
        for _ in range(workers):
            cluster.start_worker()
        cluster.wait_for_workers(workers)
        yield cluster
    finally:
        cluster.stop()


def wait_until(is_true: Any, timeout_s: float = 60.0) -> bool:
    end_s = time.monotonic() + timeout_s
    while not is_true() and time.monotonic() < end_s:
        time.sleep(0.1)
    return bool(is_true())


def restart_scheduler(cluster: DaskCluster) -> None:
    """Kill the scheduler, with which its workers end, and start others at its address."""
    assert cluster.scheduler is not None
    cluster.scheduler.send_signal(signal.SIGKILL)
    cluster.scheduler.wait()
    assert wait_until(lambda: all(worker.poll() is not None for worker in cluster.workers))
    cluster.start_scheduler()
    for _ in tuple(cluster.workers):
        cluster.start_worker()
