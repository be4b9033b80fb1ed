"""What must hold of jobs after anything: nothing lost, no result twice, no job stuck."""

import asyncio
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import psycopg
from psycopg.rows import dict_row

from stridelab.schemas.jobs import FINAL_STATES
from stridelab.service.samples.recording import SHIPPED_JOBS
from stridelab.service.storage.blobs import BlobStore

NEXT = {
    "queued": {"queued", "running", *FINAL_STATES},  # from queued to an end: cancelled, or given up by the reaper
    "running": {"running", "queued", *FINAL_STATES},
}
Row = dict[str, Any]


def faults(url: str, blobs: Path | str, accepted: Iterable[str] = ()) -> list[str]:
    """Everything that is wrong with the jobs of a database whose files lie in the folder or at the URL ``blobs``.

    ``accepted`` are the jobs that must be there; all that are there must have ended.
    """
    with psycopg.connect(url, row_factory=dict_row) as connection:
        rows = connection.execute("SELECT * FROM job").fetchall()
        jobs = {row["id"]: row for row in rows if row["id"] not in SHIPPED_JOBS}  # these were never run here
        events: dict[str, list[Row]] = defaultdict(list)
        for row in connection.execute("SELECT * FROM job_event ORDER BY seq"):
            events[row["job_id"]].append(row)
    found = [f"{job_id} was accepted and is lost" for job_id in accepted if job_id not in jobs]
    for row in jobs.values():
        found += [f"{row['id']}: {fault}" for fault in (*_of_row(row), *_of_events(row, events[row["id"]]))]
    return found + _of_files(jobs, _stored(blobs))


def assert_sound(url: str, blobs: Path | str, accepted: Iterable[str] = (), timeout_s: float = 15.0) -> None:
    """Assert that nothing is wrong, as soon as workers have ended what they hold."""
    wanted, deadline = list(accepted), time.monotonic() + timeout_s
    while found := faults(url, blobs, wanted):
        assert time.monotonic() < deadline, "\n".join(found)
        time.sleep(0.2)


def _of_row(row: Row) -> Iterator[str]:
    if row["state"] not in FINAL_STATES:
        yield f"is stuck as {row['state']}"
    elif row["finished_at"] is None:
        yield "has ended at no time"
    if row["state"] == "succeeded" and row["result"] is None:
        yield "succeeded without a result"
    if row["blob_prefix"] not in (None, f"results/{row['id']}/{row['attempt']}"):
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
    found = [f"{key} should have {size} bytes" for key, size in named.items() if stored.get(key) != size]
    for key in stored.keys() - named.keys():
        _, job_id, attempt, *_ = key.split("/")
        row = jobs.get(job_id)
        if job_id in SHIPPED_JOBS:
            continue
        if row is None or (row["state"] == "succeeded" and int(attempt) >= row["attempt"]):
            found.append(f"{key} is named by no result")
    return found


def _stored(blobs: Path | str) -> dict[str, int]:
    url = blobs.as_uri() if isinstance(blobs, Path) else blobs

    async def listed() -> dict[str, int]:
        return {info.key: info.bytes async for info in BlobStore.from_url(url).list_prefix("results")}

    return asyncio.run(listed())
