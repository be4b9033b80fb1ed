"""Children killed from outside, as the kernel does for want of memory: the job starts again, but not for ever."""

import os
import signal
from pathlib import Path

from support.service.processes import Jobs, assert_sound, worker


def kill_its_process(jobs: Jobs, job_id: str, attempt: int) -> None:
    record = jobs.until(job_id, lambda seen: seen.attempt == attempt and seen.message.startswith("pid "))
    os.kill(int(record.message.removeprefix("pid ")), signal.SIGKILL)


def test_job_of_a_killed_child_starts_again_and_fails_when_it_is_killed_every_time(
    database_url: str, tmp_path: Path
) -> None:
    jobs = Jobs(database_url)
    with worker(database_url, tmp_path, STRIDELAB_JOB_MAX_ATTEMPTS="2"):
        job_id = jobs.submit("spin")
        for attempt in (1, 2):
            kill_its_process(jobs, job_id, attempt)
        record = jobs.until_final(job_id)
        assert (record.state, record.attempt) == ("failed", 2)
        assert record.error is not None
        assert record.error["code"] == "computation-crashed"
        assert "SIGKILL" in record.error["detail"]
        crashed = jobs.until_final(jobs.submit("segfault"))
        assert (crashed.state, crashed.attempt) == ("failed", 1)  # what crashes by itself would crash again
        assert_sound(database_url, tmp_path / "blobs", [job_id, crashed.id])
