"""Real processes for tests (the whole service, or workers alone), and what must hold of their jobs.

No job is lost, stuck, or has two results.
"""

import asyncio
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from collections import defaultdict
from collections.abc import Awaitable, Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, Self, cast

import psutil
import psycopg
from psycopg.rows import dict_row

from stridelab.schemas.jobs import FINAL_STATES
from stridelab.service.jobs.queue import attempt_prefix
from stridelab.service.jobs.store import JobRecord, JobStore
from stridelab.service.samples.recording import SHIPPED_JOBS
from stridelab.service.storage.blobs import BlobStore
from support.service.database import public_folder, run_with_engine
from support.service.job_kinds import KINDS
from support.service.supervisor_entry import WORKER

TESTS = Path(__file__).parents[2]
SERVE = ("stridelab.cli", "serve")
"""What ``make serve`` runs, with the real kinds of job."""
BRISK = {"STRIDELAB_HEARTBEAT_S": "0.4", "STRIDELAB_STALL_S": "3", "STRIDELAB_WORKER_SLOTS": "1"}


def share_robot_files(data: Path) -> None:
    """Link ``robots`` in the store of a service that is about to start to those of the other services of this run.

    The names of the files are hashes of what they are computed from. ``scripts/test`` names the common folder; without
    one, each service prepares all robots itself, in 13 s of processor time.
    """
    if common := os.environ.get("STRIDELAB_TEST_ROBOT_FILES"):
        (data / "blobs").mkdir(parents=True)
        (data / "blobs" / "robots").symlink_to(common, target_is_directory=True)


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def environment(**settings: str) -> dict[str, str]:
    variables = {key: value for key, value in os.environ.items() if not key.startswith("STRIDELAB_")}
    return {**variables, "PYTHONPATH": str(TESTS), **BRISK, **settings}


def wait_for_exit(process: psutil.Process) -> bool:
    try:
        return process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def crowding() -> float:
    """How many processes share a core, at least 1: limits of time are those of a machine that does nothing else."""
    return max(1.0, max(os.getloadavg()[:2]) / (os.cpu_count() or 1))


def is_over(began: float, limit_s: float) -> bool:
    """Whether more than ``limit_s``, times the crowding, have passed since ``began`` (``time.monotonic``)."""
    return time.monotonic() - began > limit_s * crowding()


def wait_until(true: Callable[[], bool], timeout_s: float, what: str, pause_s: float = 0.05) -> None:
    began = time.monotonic()
    while not true():
        assert not is_over(began, timeout_s), f"not within {timeout_s} s on {crowding():.1f} times the load: {what}"
        time.sleep(pause_s)


@dataclass
class Jobs:
    """The jobs of one database, for tests that wait by looking."""

    url: str

    def ask(self, act: Callable[[JobStore], Awaitable[Any]]) -> Any:
        return run_with_engine(self.url, lambda engine: act(JobStore(engine, KINDS)))

    def submit(self, kind: str, **task: Any) -> str:
        return str(self.ask(lambda store: store.submit(kind, task)).job_id)

    def submit_all(self, kinds: Sequence[str]) -> list[str]:
        """Submit a job of each kind, without tasks, on one connection."""

        async def submit(store: JobStore) -> list[str]:
            return [str((await store.submit(kind, {})).job_id) for kind in kinds]

        return cast("list[str]", self.ask(submit))

    def get(self, job_id: str) -> JobRecord:
        record = self.ask(lambda store: store.get(job_id))
        assert isinstance(record, JobRecord)
        return record

    def states(self, job_id: str) -> list[str]:
        return [event.state for event in self.ask(lambda store: store.events_after(job_id))]

    def until(self, job_id: str, condition: Callable[[JobRecord], bool], timeout_s: float = 60.0) -> JobRecord:
        began = time.monotonic()

        async def look(store: JobStore) -> JobRecord:
            while True:
                try:
                    record = await store.get(job_id)
                    if condition(record):
                        return record
                    state = f"{record.state}, attempt {record.attempt}"
                except OSError as error:
                    state = repr(error)
                except Exception as error:
                    if "connection" not in str(error):
                        raise
                    state = "the database is away"
                assert not is_over(began, timeout_s), f"not within {timeout_s} s: {state}"
                await asyncio.sleep(0.1)

        record = self.ask(look)
        assert isinstance(record, JobRecord)
        return record

    def until_running(self, job_id: str) -> JobRecord:
        return self.until(job_id, lambda record: record.state == "running" and record.message.startswith("step"))

    def until_final(self, job_id: str, timeout_s: float = 60.0) -> JobRecord:
        return self.until(job_id, lambda record: record.is_final, timeout_s)


@dataclass
class Service:
    """``supervisor_entry``, or the module and arguments of ``command``, on a data folder of its own."""

    folder: Path
    port: int = field(default_factory=free_port)
    command: tuple[str, ...] = ("support.service.supervisor_entry",)
    process: subprocess.Popen[str] | None = None

    def start(self, **settings: str) -> float:
        """Start and wait for the address; returns how many seconds that took."""
        began = time.monotonic()
        if self.command == SERVE and not self.folder.exists():
            share_robot_files(self.folder)
        self.process = subprocess.Popen(
            [sys.executable, "-m", *self.command],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=environment(STRIDELAB_DATA_DIR=str(self.folder), STRIDELAB_PORT=str(self.port), **settings),
        )
        startup_lines = []
        assert self.process.stdout is not None
        for line in self.process.stdout:
            startup_lines.append(line)
            if "is running on" in line:
                return time.monotonic() - began
        raise AssertionError("".join(startup_lines) or "it ended without a word")

    @property
    def url(self) -> str:
        record = json.loads((self.folder / "postgres.json").read_text(encoding="utf-8"))
        return f"postgresql://postgres@/postgres?host={record['socket']}"

    @property
    def jobs(self) -> Jobs:
        return Jobs(self.url)

    def members(self) -> list[psutil.Process]:
        """Every process that the supervisor started, itself first."""
        assert self.process is not None
        supervisor = psutil.Process(self.process.pid)
        return [supervisor, *supervisor.children(recursive=True)]

    def member(self, words: str, timeout_s: float = 60.0) -> psutil.Process:
        """The direct child whose command line holds ``words``, as soon as it is there."""
        assert self.process is not None
        began = time.monotonic()
        while True:
            for child in psutil.Process(self.process.pid).children():
                try:
                    line = child.cmdline()
                except psutil.NoSuchProcess:
                    continue
                if words in line or any(part.endswith(f"/{words}") for part in line[:1]):
                    return child
            assert not is_over(began, timeout_s), f"no {words} within {timeout_s} s"
            time.sleep(0.05)

    def healthy(self) -> bool:
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{self.port}/api/v1/health", timeout=2) as answer:
                return bool(answer.status == 200)
        except OSError:
            return False

    def stop(self, signum: int = signal.SIGTERM) -> float:
        """End it; returns how many seconds that took."""
        assert self.process is not None
        began = time.monotonic()
        self.process.send_signal(signum)
        self.process.wait(60)
        if self.process.stdout is not None:
            self.process.stdout.close()
        return time.monotonic() - began


@contextmanager
def running_service(*command: str, **settings: str) -> Iterator[Service]:
    """A service on a folder of its own until the end of the block; ``command`` as ``Service`` has it."""
    with public_folder() as folder:
        service = Service(folder / "data", command=command) if command else Service(folder / "data")
        service.start(**settings)
        try:
            yield service
        finally:
            service.stop()


@contextmanager
def worker(url: str, folder: Path, *, on: tuple[str, ...] = (), **settings: str) -> Iterator[subprocess.Popen[bytes]]:
    """A worker of its own on an existing database; ``on`` goes before its command line."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / f"worker-{time.monotonic_ns()}.log").open("wb") as log:
        process = subprocess.Popen(
            [*on, sys.executable, "-m", WORKER],
            stdout=log,
            stderr=log,
            env=environment(**{"STRIDELAB_DATABASE_URL": url, "STRIDELAB_DATA_DIR": str(folder), **settings}),
        )
        try:
            yield process
        finally:
            process.kill()
            process.wait()


class WorkerForks:
    """A process that has imported what workers import, and forks them: they start with a tenth of the processor time.

    To be closed; its workers are to be killed before.
    """

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", WORKER, "--fork"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment(),
        )
        self._asking = threading.Lock()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate()

    @contextmanager
    def worker(self, url: str, folder: Path, **settings: str) -> Iterator[psutil.Process]:
        """As the function ``worker``."""
        folder.mkdir(parents=True)
        settings = {"STRIDELAB_DATABASE_URL": url, "STRIDELAB_DATA_DIR": str(folder), **settings}
        request = {"environment": environment(**settings), "log": str(folder / "worker.log")}
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with self._asking:
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
            process = psutil.Process(int(self._process.stdout.readline()))
        try:
            yield process
        finally:
            with suppress(psutil.NoSuchProcess):
                process.kill()
            process.wait()


NEXT = {
    "queued": {"queued", "running", *FINAL_STATES},  # from queued to an end: cancelled, or given up by the reaper
    "running": {"running", "queued", *FINAL_STATES},
}
Row = dict[str, Any]


def find_job_faults(url: str, blobs: Path | str, accepted: Iterable[str] = ()) -> list[str]:
    """Everything that is wrong with the jobs of a database whose files lie in the folder or at the URL ``blobs``.

    ``accepted`` are the jobs that must be there; all that are there must have ended.
    """
    with psycopg.connect(url, row_factory=dict_row) as connection:
        rows = connection.execute("SELECT * FROM job").fetchall()
        jobs = {row["id"]: row for row in rows if row["id"] not in SHIPPED_JOBS}  # these were never run here
        events: dict[str, list[Row]] = defaultdict(list)
        for row in connection.execute("SELECT * FROM job_event ORDER BY seq"):
            events[row["job_id"]].append(row)
    messages = [f"{job_id} was accepted and is lost" for job_id in accepted if job_id not in jobs]
    for row in jobs.values():
        messages += [f"{row['id']}: {fault}" for fault in (*_of_row(row), *_of_events(row, events[row["id"]]))]
    return messages + _of_files(jobs, _stored(blobs))


def assert_sound(url: str, blobs: Path | str, accepted: Iterable[str] = (), timeout_s: float = 15.0) -> None:
    """Assert that nothing is wrong, as soon as workers have ended what they hold."""
    job_ids, began = list(accepted), time.monotonic()
    while remaining_faults := find_job_faults(url, blobs, job_ids):
        assert not is_over(began, timeout_s), "\n".join(remaining_faults)
        time.sleep(0.2)


def _of_row(row: Row) -> Iterator[str]:
    if row["state"] not in FINAL_STATES:
        yield f"is stuck as {row['state']}"
    elif row["finished_at"] is None:
        yield "has ended at no time"
    if row["state"] == "succeeded" and row["result"] is None:
        yield "succeeded without a result"
    if row["blob_prefix"] not in (None, attempt_prefix(row["id"], row["attempt"], row["started_at"])):
        yield f"names the files of another attempt, {row['blob_prefix']}"


def _of_events(row: Row, events: list[Row]) -> Iterator[str]:
    """From queued to one end, each step allowed, and no attempt heard of after the next has begun."""
    if not events or events[0]["state"] != "queued":
        yield "did not begin as queued"
        return
    ends = [event["state"] for event in events if event["state"] in FINAL_STATES]
    if len(ends) > 1:
        yield f"ended {len(ends)} times: {', '.join(ends)}"
    if events[-1]["state"] != row["state"] or events[-1]["attempt"] != row["attempt"]:
        yield f"is {row['state']} in attempt {row['attempt']}, but its last event says otherwise"
    for earlier, later in pairwise(events):
        begins = (earlier["state"], later["state"]) == ("queued", "running")
        if later["state"] not in NEXT.get(earlier["state"], set()):
            yield f"went from {earlier['state']} to {later['state']}"
        if later["attempt"] != earlier["attempt"] + begins:
            yield f"went from attempt {earlier['attempt']} {earlier['state']} to {later['attempt']} {later['state']}"


def _of_files(jobs: dict[str, Row], stored: dict[str, int]) -> list[str]:
    """Every named file is there as a whole; a file that no result names belongs to an attempt that lost its worker."""
    named = {
        f"{row['blob_prefix']}/{artifact['name']}": artifact["bytes"]
        for row in jobs.values()
        if row["result"] is not None
        for artifact in row["result"]["artifacts"]
    }
    messages = [f"{key} should have {size} bytes" for key, size in named.items() if stored.get(key) != size]
    for key in stored.keys() - named.keys():
        _, job_id, attempt, *_ = key.split("/")
        row = jobs.get(job_id)
        if job_id in SHIPPED_JOBS:
            continue
        if row is None or (row["state"] == "succeeded" and int(attempt.partition("-")[0]) >= row["attempt"]):
            messages.append(f"{key} is named by no result")
    return messages


def _stored(blobs: Path | str) -> dict[str, int]:
    url = blobs.as_uri() if isinstance(blobs, Path) else blobs

    async def listed() -> dict[str, int]:
        return {info.key: info.bytes async for info in BlobStore.from_url(url).list_prefix("results")}

    return asyncio.run(listed())
