"""COMMITs whose answer is lost or late, and workers that are signalled meanwhile: every schedule has a number.

``scripts/chaos --schedule 17`` repeats one, ``--schedules 0:128`` runs many. In each, a worker does one job through a
proxy that breaks at one chosen transaction; another worker, which is not disturbed, takes over what is left. In the
end the job has ended once, every file that its row names is there, and the janitor finds nothing to take that is
needed (``support.service.processes``).
"""

import contextlib
import os
import re
import signal
import threading
import time
import traceback
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import timedelta
from itertools import product
from pathlib import Path
from subprocess import TimeoutExpired
from typing import Final, Literal

from sqlalchemy.ext.asyncio import AsyncEngine

from stridelab.schemas.jobs import FINAL_STATES
from stridelab.service.jobs.retention import remove_orphans
from stridelab.service.storage.blobs import BlobStore
from stridelab.service.storage.database import parse_url
from support.faults.commit_proxy import FAULTS, CommitProxy, Fault, Plan, commit_proxy
from support.service.database import TestDatabases, databases, within
from support.service.processes import Jobs, assert_sound, wait_until, worker

Signal = Literal["no signal", "SIGTERM", "SIGSTOP", "SIGKILL"]
SIGNALS: Final[tuple[Signal, ...]] = ("no signal", "SIGTERM", "SIGSTOP", "SIGKILL")
TRANSACTIONS: Final[dict[str, str]] = {
    "claim": r"UPDATE job SET state = 'running', attempt = attempt",
    "publish": r"UPDATE job SET .*finished_at=now\(\).*job\.attempt = ",
}
"""What a worker commits while it does a job, in this order, and how the statements are recognised."""
HAND_BACK: Final = r"UPDATE job SET .*returned=\(job\.returned \+"
STALL_S: Final = 3.0
DELAY_S: Final = 6.0
"""Longer than a worker that is told to stop waits for its jobs, and than a silent one is waited for."""


@dataclass(frozen=True)
class Schedule:
    """One job, one transaction, what becomes of its COMMIT, and what the worker is sent at that moment."""

    kind: str
    transaction: str
    fault: Fault
    signal: Signal

    def __str__(self) -> str:
        return f"{self.kind}: {self.fault} of the COMMIT of '{self.transaction}', {self.signal}"


SCHEDULES: Final[tuple[Schedule, ...]] = (
    *(Schedule(*each) for each in product(("work", "stop-half-way"), TRANSACTIONS, FAULTS, SIGNALS)),
    *(Schedule("long-work", "hand back", *each) for each in product(FAULTS, ("no signal", "SIGKILL"))),
)
"""A schedule's number is its place here; new ones go to the end."""


def run(schedule: Schedule, url: str, folder: Path) -> str:
    """Do it on an empty database; returns how the job ended. Raises ``AssertionError`` naming all that is wrong."""
    jobs, blobs = Jobs(url), {"STRIDELAB_BLOB_URL": (folder / "blobs").as_uri(), "STRIDELAB_STALL_S": str(STALL_S)}
    hands_back = schedule.transaction == "hand back"
    job_id = jobs.submit(schedule.kind, **({"work_s": 3.0} if hands_back else {}))
    pattern = re.compile(TRANSACTIONS.get(schedule.transaction, HAND_BACK), re.DOTALL)
    pid = 0

    def send() -> None:
        if schedule.signal != "no signal":
            os.kill(pid, getattr(signal, schedule.signal))

    plan = Plan(lambda text: pattern.search(text) is not None, schedule.fault, DELAY_S, send)
    with contextlib.ExitStack() as stack:
        proxy = stack.enter_context(commit_proxy(socket_of(url), plan))
        first = stack.enter_context(worker(through_proxy(url, proxy), folder / "a", **blobs))
        pid = first.pid
        if hands_back:
            jobs.until(job_id, lambda record: record.state == "running" and record.message.startswith("step"))
            first.send_signal(signal.SIGTERM)
        wait_until(proxy.struck.is_set, 60, f"a COMMIT of '{schedule.transaction}'")
        stack.enter_context(worker(url, folder / "b", **blobs))
        wait_until(proxy.over.is_set, 60, "the end of the fault")
        if schedule.signal == "SIGSTOP":
            time.sleep(2 * STALL_S if schedule.fault.startswith("lost") else 0.0)
            os.kill(pid, signal.SIGCONT)
        record = jobs.until_final(job_id, 90)
        time.sleep(1.0)  # what the first worker has to say, it says now
        if schedule.signal in ("SIGTERM", "SIGKILL") or hands_back:
            try:
                first.wait(30)
            except TimeoutExpired as error:
                raise AssertionError("the worker did not stop within 30 s") from error
        expected = "failed" if schedule.kind == "stop-half-way" else "succeeded"
        assert record.state == expected, f"{record.state}: {record.error}"
        if record.error is not None:
            assert record.error["code"] == "stopped", record.error
        assert record.state in FINAL_STATES
        assert_sound(url, folder / "blobs", [job_id])
        removed = within(url, lambda engine: remove_orphans_now(engine, folder / "blobs"))
        assert_sound(url, folder / "blobs", [job_id])
        kept = list((folder / "blobs" / "results").rglob("*.csv"))
        assert len(kept) == 1, f"{len(kept)} files after the janitor"
        starts = jobs.get(job_id).attempt
    return f"{record.state} after {starts} starts, {len(removed)} prefixes left to the janitor"


async def remove_orphans_now(engine: AsyncEngine, blobs: Path) -> list[str]:
    """What the janitor removes once everything is old."""
    async with engine.connect() as connection:
        return await remove_orphans(connection, BlobStore.from_url(blobs.as_uri()), timedelta(seconds=-1))


def socket_of(url: str) -> str:
    """Socket of an embedded server."""
    folder = parse_url(url).query.get("host")
    assert isinstance(folder, str), "the proxy leads to an embedded server's socket"
    return f"{folder}/.s.PGSQL.5432"


def through_proxy(url: str, proxy: CommitProxy) -> str:
    """URL of the same database by way of ``proxy``."""
    address = parse_url(url)
    return f"postgresql://{address.username}@127.0.0.1:{proxy.port}/{address.database}?sslmode=disable"


def run_numbered(number: int, url: str, folder: Path) -> str:
    """``run`` of the schedule ``number``."""
    return f"({SCHEDULES[number]}): {run(SCHEDULES[number], url, folder)}"


def run_all(
    numbers: Iterable[int],
    server: TestDatabases,
    folder: Path,
    *,
    at_once: int = 4,
    say: Callable[[str], None] = print,
    run_one: Callable[[int, str, Path], str] = run_numbered,
) -> list[int]:
    """Run schedules, some at the same time; returns the numbers of those that failed."""
    failed: list[int] = []
    lock = threading.Lock()

    def one(number: int) -> None:
        began = time.monotonic()
        try:
            with server.fresh() as url:
                said = run_one(number, url, folder / str(number))
        except Exception as error:
            said = f"FAILED: {error or ''.join(traceback.format_exception(error))}"
            with lock:
                failed.append(number)
        say(f"schedule {number} {said} [{time.monotonic() - began:.0f} s]")

    with ThreadPoolExecutor(at_once) as threads:
        list(threads.map(one, numbers))
    return sorted(failed)


def main(
    numbers: list[int],
    folder: Path,
    at_once: int,
    option: str = "--schedule",
    run_one: Callable[[int, str, Path], str] = run_numbered,
) -> int:
    """Run schedules from the command line; returns an exit status."""
    with databases() as server:
        failed = run_all(
            numbers, server, folder, at_once=at_once, say=lambda line: print(line, flush=True), run_one=run_one
        )
    again = " ".join(f"scripts/chaos {option} {number};" for number in failed)
    print(f"{len(numbers)} schedules, {len(failed)} failed. {again}")
    return 1 if failed else 0
