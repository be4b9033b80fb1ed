"""A long run under random kills: ``python -m support.faults.chaos --jobs 500 --kills 10`` (``make chaos``).

Jobs go to a whole service (supervisor, web server, worker, database) of their own while its programs are killed one
after another with SIGKILL. A submission whose answer is lost is sent again with its key. In the end every accepted job
must have succeeded once (``ledger``).

``--schedule N`` and ``--schedules A:B`` run numbered schedules of lost and late COMMITs instead (``commit_chaos``).
"""

import argparse
import asyncio
import random
import sys
import tempfile
import threading
import time
from collections import Counter
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import psutil
import psycopg
from psycopg import OperationalError as DriverError
from sqlalchemy.exc import OperationalError

from stridelab.service.jobs.store import JobStore
from stridelab.service.processes.child import PROCESS_NAME
from stridelab.service.storage.database import make_engine
from support.faults.commits import SCHEDULES
from support.faults.commits import main as run_schedules
from support.faults.pair_schedules import NUMBERS, run_numbered_pair
from support.service.job_kinds import KINDS
from support.service.processes import Service, WorkerForks, assert_sound, is_over, running_service
from support.service.supervisor_entry import API, WORKER

VICTIMS = {"worker": 4, "computation": 3, "postmaster": 2, "web server": 1}
"""How often each is chosen, relative to the others."""
LINES = {"worker": WORKER, "postmaster": "postgres", "web server": API}
SETTINGS = {"STRIDELAB_WORKER_SLOTS": "2", "STRIDELAB_JOB_MAX_ATTEMPTS": "1000"}
WAITING = 40
STATES = "SELECT state, count(*) FROM job WHERE kind = 'work' GROUP BY state"
STARTS = "SELECT sum(attempt - 1), max(attempt) FROM job WHERE kind = 'work'"


@dataclass
class Run:
    """State and counts of a run."""

    service: Service
    work_s: float
    accepted: list[str] = field(default_factory=list)
    again: int = 0
    killed: Counter[str] = field(default_factory=Counter)
    failure: list[BaseException] = field(default_factory=list)

    def submit(self, jobs: int) -> None:
        """Have ``jobs`` accepted, with some waiting at any time."""
        try:
            asyncio.run(self._submit(jobs))
        except BaseException as error:
            self.failure.append(error)
            raise

    async def _submit(self, jobs: int) -> None:
        engine = make_engine(self.service.url, pool_size=2)
        store = JobStore(engine, KINDS, queue_limit=10**6)
        try:
            for number in range(jobs):
                while True:
                    try:
                        task = {"work_s": self.work_s, "number": number}
                        submission = await store.submit("work", task, idempotency_key=f"chaos-{number}")
                        break
                    except (OperationalError, DriverError, OSError):
                        self.again += 1
                        await asyncio.sleep(0.2)
                self.accepted.append(submission.job_id)
                while number % 10 == 9 and self._open() > WAITING:
                    await asyncio.sleep(0.3)
        finally:
            await engine.dispose()

    def _open(self) -> int:
        return sum(count for state, count in self.counts().items() if state in {"queued", "running"})

    def counts(self) -> dict[str, int]:
        """Jobs by state; empty while the database is away."""
        try:
            with psycopg.connect(self.service.url, connect_timeout=5) as connection:
                return dict(
                    connection.execute("SELECT state, count(*) FROM job WHERE kind = 'work' GROUP BY state").fetchall()
                )
        except DriverError:
            return {}

    def errors(self) -> list[tuple[str, int, object]]:
        """State, attempt and error of every job that ended without success; empty while the database is away."""
        try:
            with psycopg.connect(self.service.url, connect_timeout=5) as connection:
                return connection.execute(
                    "SELECT state, attempt, error FROM job WHERE kind = 'work' "
                    "AND state NOT IN ('queued', 'running', 'succeeded')"
                ).fetchall()
        except DriverError:
            return []

    def kill(self, kind: str) -> bool:
        """SIGKILL one; False where there is none just now."""
        if kind == "computation":
            inside = self.service.member(LINES["worker"]).children(recursive=True)
            busy = [child for child in inside if _is_child(child)]
            if not busy:
                return False
            victim = random.choice(busy)
        else:
            victim = self.service.member(LINES[kind])
        victim.kill()
        self.killed[kind] += 1
        return True


def _is_child(process: psutil.Process) -> bool:
    try:
        return process.name() == PROCESS_NAME
    except psutil.NoSuchProcess:
        return False


def run(jobs: int, kills: int, *, work_s: float, pause_s: tuple[float, float], limit_s: float) -> str:
    """Run the jobs under kills; return the report. Raises ``AssertionError`` naming jobs lost, doubled or stuck."""
    began = time.monotonic()
    with running_service(**SETTINGS) as service:
        chaos = Run(service, work_s)
        submitting = threading.Thread(target=chaos.submit, args=(jobs,), daemon=True)
        submitting.start()
        while chaos.killed.total() < kills:
            time.sleep(random.uniform(*pause_s))
            assert not is_over(began, limit_s), f"{chaos.killed.total()} kills in {limit_s} s"
            try:
                chaos.kill(random.choices(list(VICTIMS), list(VICTIMS.values()))[0])
            except psutil.NoSuchProcess:
                continue
        while submitting.is_alive() and not is_over(began, limit_s):
            submitting.join(1.0)
        assert not chaos.failure, chaos.failure
        assert len(chaos.accepted) == jobs, f"{len(chaos.accepted)} of {jobs} accepted in {limit_s} s"
        while chaos.counts() != {"succeeded": jobs}:
            assert not (errors := chaos.errors()), errors
            assert not is_over(began, limit_s), f"after {limit_s} s: {chaos.counts()}"
            time.sleep(0.5)
        assert len(set(chaos.accepted)) == jobs
        assert_sound(service.url, service.folder / "blobs", chaos.accepted)
        with psycopg.connect(service.url) as connection:
            retries = connection.execute(
                "SELECT sum(attempt - 1), max(attempt) FROM job WHERE kind = 'work'"
            ).fetchone()
        repeated, most = retries or (0, 0)
    victims = ", ".join(f"{count} {kind}" for kind, count in sorted(chaos.killed.items()))
    return (
        f"{jobs} jobs under {kills} kills ({victims}): all finished exactly once in {time.monotonic() - began:.0f} s; "
        f"{repeated} second starts, at most {most} starts of one job; {chaos.again} submissions sent again"
    )


def _range(text: str | None, number: int) -> list[int]:
    if text is None:
        return []
    first, _, last = ("0", "", str(number)) if text == "all" else text.partition(":")
    return list(range(int(first), int(last or number)))


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(prog="make chaos", description=__doc__)
    parser.add_argument("--jobs", type=int, default=10_000)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--work", type=float, default=0.2, help="seconds that one job computes")
    parser.add_argument("--pause", type=float, default=15.0, help="mean seconds between two kills")
    parser.add_argument("--limit", type=float, default=6 * 3600.0, help="seconds until the run counts as stuck")
    parser.add_argument("--seed", type=int, default=None)
    numbered = parser.add_argument_group(
        "COMMITs that are lost or late (support.faults.commits), instead of random kills"
    )
    numbered.add_argument("--schedule", type=int, action="append", help=f"one of 0 to {len(SCHEDULES) - 1}")
    numbered.add_argument("--schedules", help="a range, as 0:32, or 'all'")
    numbered.add_argument("--pair", type=int, action="append", help=f"one of 0 to {NUMBERS - 1}, with two jobs")
    numbered.add_argument("--pairs", help="a range of these, as 0:100, or 'all'")
    numbered.add_argument("--at-once", type=int, default=4, help="schedules that run at the same time")
    arguments = parser.parse_args()
    chosen = [*(arguments.schedule or []), *_range(arguments.schedules, len(SCHEDULES))]
    pairs = [*(arguments.pair or []), *_range(arguments.pairs, NUMBERS)]
    if pairs:
        with tempfile.TemporaryDirectory() as folder, WorkerForks() as forks:
            run_one = partial(run_numbered_pair, forks=forks)
            sys.exit(run_schedules(pairs, Path(folder), arguments.at_once, "--pair", run_one))
    if chosen:
        with tempfile.TemporaryDirectory() as folder:
            sys.exit(run_schedules(chosen, Path(folder), arguments.at_once))
    seed = arguments.seed if arguments.seed is not None else random.randrange(10**6)
    random.seed(seed)
    pause_s = (0.2 * arguments.pause, 1.8 * arguments.pause)
    print(f"seed {seed}", flush=True)
    print(
        run(arguments.jobs, arguments.kills, work_s=arguments.work, pause_s=pause_s, limit_s=arguments.limit),
        flush=True,
    )


if __name__ == "__main__":
    main()
