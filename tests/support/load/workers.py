"""Two workers on one database, measured: ``python -m support.load.workers speed|orphans``.

``speed`` (``scripts/two-workers``): how much faster two workers are than one, each with one slot and a core of its own,
on jobs that only compute. ``orphans`` (``scripts/orphans``): how long a job of a worker that was killed with SIGKILL
waits until the other one starts it, once with the settings of the tests and once with those of the service.
"""

import argparse
import asyncio
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from statistics import median

import psutil

from stridelab.service.jobs.store import JobStore
from stridelab.service.settings import Settings
from stridelab.service.storage.database import make_engine
from support.service.database import databases, public_folder
from support.service.job_kinds import KINDS
from support.service.processes import BRISK, Jobs, worker


@contextmanager
def pinned(core: int) -> Iterator[None]:
    """Processes started in the block run on one core only."""
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
        job_table = Jobs(url)
        for _ in cores:  # all are there before it begins
            job_table.until_final(job_table.submit("crunch", turns=turns))
        time.sleep(3.0)
        ids = asyncio.run(_submit(url, jobs, turns))
        records = [job_table.until_final(job_id, timeout_s=3600.0) for job_id in ids]
    assert {record.state for record in records} == {"succeeded"}
    ends = [record.finished_at for record in records if record.finished_at]
    starts = [record.started_at for record in records if record.started_at]
    return (max(ends) - min(starts)).total_seconds()


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options of ``compare_speeds``."""
    parser.add_argument("--jobs", type=int, default=20)
    parser.add_argument("--turns", type=int, default=20_000_000, help="size of a job; a million is about 0.05 s")
    parser.add_argument("--rounds", type=int, default=2)


def compare_speeds(given: argparse.Namespace) -> None:
    """Print times of one worker and of two, and their ratio."""
    cores = sorted(os.sched_getaffinity(0))[:2]
    if len(cores) < 2:
        raise SystemExit("this machine lets us use one core only")
    one, two = list[float](), list[float]()
    psutil.cpu_percent()
    time.sleep(2.0)
    busy, load = psutil.cpu_percent(), os.getloadavg()[0]
    with databases() as test_databases, test_databases.fresh() as url, public_folder() as folder:
        for _ in range(given.rounds):
            one.append(batch_s(url, folder, cores[:1], given.jobs, given.turns))
            two.append(batch_s(url, folder, cores, given.jobs, given.turns))
    sys.stdout.write(
        f"{given.jobs} jobs, {given.rounds} rounds: one worker {median(one):.1f} s ({min(one):.1f} to {max(one):.1f}), "
        f"two workers {median(two):.1f} s ({min(two):.1f} to {max(two):.1f}), {median(one) / median(two):.2f} times "
        f"faster; beforehand the machine was {busy:.0f} % busy, load {load:.1f}.\n"
    )


_SERVICE = Settings.model_fields
SETTINGS = {
    "of the tests": BRISK,
    "of the service": {
        "STRIDELAB_HEARTBEAT_S": str(_SERVICE["heartbeat_s"].default),
        "STRIDELAB_STALL_S": str(_SERVICE["stall_s"].default),
    },
}


def delay_s(url: str, settings: dict[str, str], folder: Path) -> float:
    """Seconds from the kill of a worker to the second start of its job."""
    jobs = Jobs(url)
    with ExitStack() as stack:
        pair = {name: stack.enter_context(worker(url, folder / name, **settings)) for name in "ab"}
        beat_s = float(settings["STRIDELAB_HEARTBEAT_S"])
        time.sleep(2.0 * beat_s + 3.0)  # a new worker requeues no jobs
        job_id = jobs.submit("long-work", work_s=600.0, diary=str(folder / "diary"), name="orphan")
        jobs.until_running(job_id)
        holder = next(name for name in pair if any((folder / name / "work").glob("*/*/")))
        pair[holder].kill()
        began = time.monotonic()
        jobs.until(job_id, lambda seen: seen.attempt == 2 and seen.message.startswith("step"), timeout_s=120.0)
        took_s = time.monotonic() - began
        jobs.ask(lambda store: store.request_cancel(job_id))
        return took_s


def measure_delays(kills: int) -> None:
    """Print the delays."""
    with databases() as server, tempfile.TemporaryDirectory() as scratch:
        for name, settings in SETTINGS.items():
            with server.fresh() as url:
                delays_s = [delay_s(url, dict(settings), Path(scratch, f"{name} {k}")) for k in range(kills)]
            sys.stdout.write(f"settings {name}: {', '.join(f'{s:.1f}' for s in sorted(delays_s))} s\n")
            sys.stdout.flush()


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__)
    measurements = parser.add_subparsers(dest="measurement", required=True)
    add_options(measurements.add_parser("speed", prog="scripts/two-workers"))
    measurements.add_parser("orphans", prog="scripts/orphans").add_argument("kills", type=int, nargs="?", default=3)
    arguments = parser.parse_args()
    if arguments.measurement == "speed":
        compare_speeds(arguments)
    else:
        measure_delays(arguments.kills)


if __name__ == "__main__":
    main()
