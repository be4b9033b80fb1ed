"""Workers that stall, die and come back, on a database that goes on."""

import os
import signal
import time
from contextlib import ExitStack
from pathlib import Path

import psycopg

from stridelab.service.jobs.queue import attempt_prefix
from stridelab.service.jobs.store import JobRecord
from support.service.processes import Jobs, assert_sound, worker


def test_zombie_publishes_nothing_and_a_survivor_takes_over(database_url: str, tmp_path: Path) -> None:
    """A worker is stopped past its stall time, another takes the job, the first one wakes: one result."""
    jobs, diary = Jobs(database_url), tmp_path / "diary"
    blobs = {"STRIDELAB_BLOB_URL": (tmp_path / "blobs").as_uri()}
    with ExitStack() as stack:
        sleeper = stack.enter_context(worker(database_url, tmp_path / "a", **blobs))
        job_id = jobs.submit("long-work", work_s=2.0, diary=str(diary), name="j")
        jobs.until_running(job_id)
        os.kill(sleeper.pid, signal.SIGSTOP)
        other = stack.enter_context(worker(database_url, tmp_path / "b", **blobs))
        jobs.until(job_id, lambda record: record.attempt == 2 and record.state == "running")
        os.kill(sleeper.pid, signal.SIGCONT)  # its child has finished: it tries to publish attempt 1
        record = jobs.until_final(job_id)
        time.sleep(1.0)
        assert (record.state, record.attempt) == ("succeeded", 2)
        assert jobs.get(job_id) == record
        assert jobs.states(job_id).count("succeeded") == 1
        stored = [str(p.relative_to(tmp_path / "blobs")) for p in (tmp_path / "blobs").rglob("*") if p.is_file()]
        assert stored == [f"{attempt_prefix(job_id, 2, record.started_at)}/numbers.csv"]

        # the awakened worker is sound: it finishes what the other one is killed with
        taken = jobs.submit("long-work", work_s=4.0, diary=str(diary), name="k")
        jobs.until_running(taken)
        (other if any((tmp_path / "b" / "work").glob("*/*/")) else sleeper).kill()
        record = jobs.until_final(taken)
        assert (record.state, record.attempt) == ("succeeded", 2)
        assert_sound(database_url, tmp_path / "blobs", [job_id, taken])
    assert [line for line in diary.read_text().splitlines() if line.startswith("k")] == ["k start", "k start", "k end"]


def test_a_clock_that_jumps_forward_costs_no_attempt(database_url: str, tmp_path: Path) -> None:
    """Every heartbeat is an hour old at once: none of two workers takes the other's job, nor its own."""
    jobs, diary = Jobs(database_url), tmp_path / "diary"
    blobs = {"STRIDELAB_BLOB_URL": (tmp_path / "blobs").as_uri()}
    with worker(database_url, tmp_path / "a", **blobs), worker(database_url, tmp_path / "b", **blobs):
        job_ids = [jobs.submit("long-work", work_s=8.0, diary=str(diary), name=name) for name in "jk"]
        for job_id in job_ids:
            jobs.until_running(job_id)
        for _ in range(4):
            time.sleep(1.3)  # at other moments of the workers' intervals
            with psycopg.connect(database_url) as connection:
                connection.execute("UPDATE worker SET last_heartbeat = last_heartbeat - interval '1 hour'")
        ended = [jobs.until_final(job_id) for job_id in job_ids]
    assert [(record.state, record.attempt) for record in ended] == [("succeeded", 1)] * 2
    assert sorted(diary.read_text().splitlines()) == ["j end", "j start", "k end", "k start"]


def test_job_that_kills_its_workers_fails_in_the_end(database_url: str, tmp_path: Path) -> None:
    jobs = Jobs(database_url)
    job_id = jobs.submit("spin")
    for attempt in (1, 2):
        with worker(database_url, tmp_path / "a", STRIDELAB_JOB_MAX_ATTEMPTS="2") as victim:

            def runs(record: JobRecord, n: int = attempt) -> bool:
                return record.state == "running" and record.attempt == n

            jobs.until(job_id, runs)
            victim.kill()
    with worker(database_url, tmp_path / "a", STRIDELAB_JOB_MAX_ATTEMPTS="2"):
        record = jobs.until_final(job_id)
        assert record.state == "failed"
        assert record.error is not None
        assert record.error["code"] == "worker-died"
        assert jobs.until_final(jobs.submit("work")).state == "succeeded"
        assert_sound(database_url, tmp_path / "a" / "blobs", [job_id])


def test_a_cancellation_that_a_dead_worker_missed_is_done_and_its_files_are_removed(
    database_url: str, tmp_path: Path
) -> None:
    jobs = Jobs(database_url)
    with worker(database_url, tmp_path / "a") as victim:
        job_id = jobs.submit("spin")
        jobs.until(job_id, lambda record: record.state == "running")
        victim.kill()
    left = list((tmp_path / "a" / "work").iterdir())
    assert len(left) == 1
    jobs.ask(lambda store: store.request_cancel(job_id))
    assert jobs.get(job_id).state == "running"
    with worker(database_url, tmp_path / "a"):
        assert jobs.until_final(job_id).state == "cancelled"
        assert not left[0].exists()
        assert_sound(database_url, tmp_path / "a" / "blobs", [job_id])
