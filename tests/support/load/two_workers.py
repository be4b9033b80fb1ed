"""How much faster two workers are than one, each with one slot and a core of its own, on jobs that only compute.

``scripts/two-workers`` prints both times, their ratio, and what else the machine was doing.
"""

import argparse
import asyncio
import os
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from statistics import median

import psutil

from stridelab.service.jobs.store import JobStore
from stridelab.service.storage.database import make_engine
from support.service.database import databases, public_folder
from support.service.job_kinds import KINDS
from support.service.processes import Jobs, worker


@contextmanager
def pinned(core: int) -> Iterator[None]:
    """What is started meanwhile runs on one core only."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {core})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


async def _submit(url: str, jobs: int, turns: int) -> list[str]:
    engine = make_engine(url, pool_size=1)
    store = JobStore(engine, KINDS, queue_limit=10**6)
    try:
        return [(await store.submit("crunch", {"turns": turns, "number": n})).job_id for n in range(jobs)]
    finally:
        await engine.dispose()


def batch_s(url: str, folder: Path, cores: list[int], jobs: int, turns: int) -> float:
    """Seconds from the first start to the last end of ``jobs`` jobs, with a worker on each of ``cores``."""
    with ExitStack() as workers:
        for core in cores:
            with pinned(core):
                workers.enter_context(worker(url, folder / f"core-{core}"))
        made = Jobs(url)
        for _ in cores:  # all are there before it begins
            made.until_final(made.submit("crunch", turns=turns))
        time.sleep(3.0)
        ids = asyncio.run(_submit(url, jobs, turns))
        records = [made.until_final(job_id, timeout_s=3600.0) for job_id in ids]
    assert {record.state for record in records} == {"succeeded"}
    ends = [record.finished_at for record in records if record.finished_at]
    starts = [record.started_at for record in records if record.started_at]
    return (max(ends) - min(starts)).total_seconds()


def main() -> None:
    """Entry point."""
    asked = argparse.ArgumentParser(prog="scripts/two-workers", description=__doc__)
    asked.add_argument("--jobs", type=int, default=20)
    asked.add_argument("--turns", type=int, default=20_000_000, help="size of a job; a million is about 0.05 s")
    asked.add_argument("--rounds", type=int, default=2)
    given = asked.parse_args()
    cores = sorted(os.sched_getaffinity(0))[:2]
    if len(cores) < 2:
        raise SystemExit("this machine lets us use one core only")
    one, two = list[float](), list[float]()
    psutil.cpu_percent()
    time.sleep(2.0)
    busy, load = psutil.cpu_percent(), os.getloadavg()[0]
    with databases() as made, made.fresh() as url, public_folder() as folder:
        for _ in range(given.rounds):
            one.append(batch_s(url, folder, cores[:1], given.jobs, given.turns))
            two.append(batch_s(url, folder, cores, given.jobs, given.turns))
    sys.stdout.write(
        f"{given.jobs} jobs, {given.rounds} rounds: one worker {median(one):.1f} s ({min(one):.1f} to {max(one):.1f}), "
        f"two workers {median(two):.1f} s ({min(two):.1f} to {max(two):.1f}), {median(one) / median(two):.2f} times "
        f"faster; beforehand the machine was {busy:.0f} % busy, load {load:.1f}.\n"
    )


if __name__ == "__main__":
    main()
