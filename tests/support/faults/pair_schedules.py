"""Two jobs, two workers, one fault at any COMMIT of one of them: 20 000 schedules, each with a number.

``scripts/chaos --pair 17`` repeats one, ``--pairs 0:100`` runs many. A number stands for two kinds of job, the place of
the COMMIT among those of the disturbed worker (registration, claims, progress, publication, whatever it writes), what
becomes of it, the signal that the worker gets at that moment, how long a late answer takes, and how much later the
other worker starts. The order is shuffled once and for all, so that a range of numbers is a sample of all.
"""

import contextlib
import os
import random
import signal
import time
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, Final, LiteralString

import psycopg

from stridelab.schemas.jobs import FINAL_STATES
from support.faults.commits import (
    FAULTS,
    SIGNALS,
    STALL_S,
    Fault,
    Plan,
    Signal,
    commit_proxy,
    through_proxy,
)
from support.service.database import remove_orphans_now, run_with_engine, socket_of
from support.service.processes import Jobs, WorkerForks, assert_sound, wait_until

KINDS: Final = (
    *(("work", "work"), ("work", "stop-half-way"), ("stop-half-way", "work")),
    *(("stop-half-way", "stop-half-way"), ("long-work", "work")),
)
COMMITS: Final = range(1, 11)
DELAYS_S: Final = (1.0, 6.0)
"""Shorter and longer than the stall time, and than a stopping worker waits for its jobs."""
LATER_S: Final = (0.0, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.3, 1.7, 2.2)
_ALL: Final = list(product(KINDS, COMMITS, FAULTS, SIGNALS, DELAYS_S, LATER_S))
random.Random(35).shuffle(_ALL)
NUMBERS: Final = len(_ALL)
_LOOK_S: Final = 0.25
"""Pause between two looks at the jobs, which cost processor time."""
ENDS: Final = {"work": "succeeded", "long-work": "succeeded", "stop-half-way": "failed"}


@dataclass(frozen=True)
class PairSchedule:
    """One fault at one COMMIT of the disturbed worker, among two jobs and two workers."""

    kinds: tuple[str, str]
    commit: int
    fault: Fault
    signal: Signal
    delay_s: float
    later_s: float

    @staticmethod
    def of_number(number: int) -> "PairSchedule":
        """The schedule ``number``, from 0 to ``NUMBERS`` - 1."""
        return PairSchedule(*_ALL[number])

    def __str__(self) -> str:
        jobs, when = " and ".join(self.kinds), f"COMMIT {self.commit}"
        return f"{jobs}: {self.fault} of {when}, {self.signal}, {self.delay_s:g} s, the other {self.later_s:g} s later"


def run_pair(schedule: PairSchedule, url: str, folder: Path, forks: WorkerForks) -> str:
    """Do it on an empty database; returns what happened. Raises ``AssertionError`` naming all that is wrong."""
    jobs, times = Jobs(url), {"STRIDELAB_STALL_S": str(STALL_S), "STRIDELAB_HEARTBEAT_S": str(STALL_S / 4)}
    settings = {"STRIDELAB_BLOB_URL": (folder / "blobs").as_uri(), **times}
    ids = jobs.submit_all(schedule.kinds)
    n_seen = pid = 0

    def is_chosen(_text: str) -> bool:
        nonlocal n_seen
        n_seen += 1
        return n_seen == schedule.commit

    def send() -> None:
        if schedule.signal != "no signal":
            os.kill(pid, getattr(signal, schedule.signal))

    def column(name: LiteralString) -> list[Any]:
        """Values of both jobs."""
        values = {row[0]: row[1] for row in look.execute(f"SELECT id, {name} FROM job").fetchall()}
        return [values[job_id] for job_id in ids]

    def have_ended() -> bool:
        return FINAL_STATES.issuperset(column("state"))

    plan = Plan(is_chosen, schedule.fault, schedule.delay_s, send)
    with contextlib.ExitStack() as stack:
        look = stack.enter_context(psycopg.connect(url, autocommit=True))
        proxy = stack.enter_context(commit_proxy(socket_of(url), plan))
        first = stack.enter_context(forks.worker(through_proxy(url, proxy), folder / "a", **settings))
        pid = first.pid
        time.sleep(schedule.later_s)
        stack.enter_context(forks.worker(url, folder / "b", **settings))
        wait_until(lambda: proxy.struck.is_set() or have_ended(), 240, "the fault or the end", _LOOK_S)
        struck = proxy.struck.is_set()
        if struck:
            wait_until(proxy.over.is_set, 60, "the end of the fault")
            if schedule.signal == "SIGSTOP":
                time.sleep(2 * STALL_S if schedule.fault.startswith("lost") else 0.0)
                os.kill(pid, signal.SIGCONT)
        wait_until(have_ended, 240, "the end of both jobs", _LOOK_S)
        time.sleep(1.0)  # what the first worker has to say, it says now
        ends = column("state")
        assert ends == [ENDS[kind] for kind in schedule.kinds], f"{ends}: {column('error')}"
        assert_sound(url, folder / "blobs", ids)
        removed = run_with_engine(url, lambda engine: remove_orphans_now(engine, folder / "blobs"))
        assert_sound(url, folder / "blobs", ids)
        files = len(list((folder / "blobs" / "results").rglob("*.csv")))
        assert files == len(ids), f"{files} files after the janitor"
        starts = column("attempt")
    what = f"struck {proxy.commits[schedule.commit - 1][:60]!r}" if struck else f"not reached, {n_seen} COMMITs"
    return f"{what}; {starts} starts, {len(removed)} prefixes left to the janitor"


def run_numbered_pair(number: int, url: str, folder: Path, forks: WorkerForks) -> str:
    """``run_pair`` of the schedule ``number``; an error names it."""
    schedule = PairSchedule.of_number(number)
    try:
        return f"({schedule}): {run_pair(schedule, url, folder, forks)}"
    except AssertionError as error:
        raise AssertionError(f"({schedule}): {error}") from error
