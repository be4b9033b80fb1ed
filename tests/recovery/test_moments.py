"""kill -9 of a worker at the two moments that are over in milliseconds: a job being started, and one being published.

The test stretches them by a lock that they have to wait for: on the events of jobs, of which a start writes one in the
statement that claims the job, and on the job's row.
"""

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import psycopg
import pytest

from support.service.processes import Jobs, assert_sound, is_over, wait_until, worker


@contextmanager
def events_held(url: str) -> Iterator[None]:
    """Lock the events of jobs against writing."""
    with psycopg.connect(url) as holder:
        holder.execute("LOCK TABLE job_event IN SHARE ROW EXCLUSIVE MODE")
        yield


@contextmanager
def held(url: str, job_id: str) -> Iterator[None]:
    """Lock the job's row."""
    with psycopg.connect(url) as holder:
        holder.execute("SELECT id FROM job WHERE id = %s FOR UPDATE", (job_id,))
        yield


def waiting(url: str, beginning: str) -> int:
    """How many transactions wait for a lock in a statement that begins like that."""
    with psycopg.connect(url) as look:
        row = look.execute(
            "SELECT count(*) FROM pg_stat_activity WHERE datname = current_database() AND wait_event_type = 'Lock'"
            " AND query LIKE %s",
            (f"{beginning}%",),
        ).fetchone()
    return int(row[0]) if row else 0


@pytest.mark.parametrize("moment", ["starting", "publishing"])
def test_a_worker_killed_at_any_moment_costs_no_job(moment: str, database_url: str, tmp_path: Path) -> None:
    jobs, diary = Jobs(database_url), tmp_path / "diary"
    blobs = {"STRIDELAB_BLOB_URL": (tmp_path / "blobs").as_uri()}
    with ExitStack() as stack:
        job_id = jobs.submit("long-work", work_s=0.5, diary=str(diary), name="j")
        with ExitStack() as lock:
            if moment == "starting":
                lock.enter_context(events_held(database_url))
                victim = stack.enter_context(worker(database_url, tmp_path / "a", **blobs))
                wait_until(lambda: waiting(database_url, "%WITH RECURSIVE first") >= 1, 30, "a start that waits")
            else:
                victim = stack.enter_context(worker(database_url, tmp_path / "a", **blobs))
                jobs.until_running(job_id)
                lock.enter_context(held(database_url, job_id))
                wait_until(lambda: any((tmp_path / "blobs").rglob("*.csv")), 30, "the stored file")
                wait_until(lambda: waiting(database_url, "%= 'succeeded'") >= 1, 30, "a publication that waits")
            victim.kill()
            victim.wait()
        killed_at = time.monotonic()
        stack.enter_context(worker(database_url, tmp_path / "b", **blobs))
        record = jobs.until_final(job_id)
        assert record.state == "succeeded"
        assert not is_over(killed_at, 30)
        assert_sound(database_url, tmp_path / "blobs", [job_id])
    ends = diary.read_text().splitlines().count("j end")
    # nothing had been committed: what was about to start starts once, what was about to be published is done again
    assert (record.attempt, ends) == ((1, 1) if moment == "starting" else (2, 2))
