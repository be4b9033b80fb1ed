"""The checker that follows every chaos case finds each thing that must not be."""

from pathlib import Path

import psycopg
import pytest

from support.service.processes import Jobs, assert_sound, find_job_faults

JOB = "a" * 32
STARTED = [("queued", 0), ("running", 1)]
RESULT = '{"artifacts": [{"name": "x.csv", "media_type": "text/csv", "bytes": 1}]}'


def put(blobs: Path, key: str, content: bytes = b"x") -> None:
    (blobs / key).parent.mkdir(parents=True, exist_ok=True)
    (blobs / key).write_bytes(content)


@pytest.fixture
def blobs(database_url: str, tmp_path: Path) -> Path:
    """A database with one job that succeeded in its second attempt, and its file."""
    steps = [*STARTED, ("queued", 1), ("running", 2), ("running", 2), ("succeeded", 2)]
    with psycopg.connect(database_url) as connection:
        connection.execute(
            "INSERT INTO job (id, kind, state, attempt, input, input_hash, finished_at, blob_prefix, result)"
            " VALUES (%s, 'work', 'succeeded', 2, '{}', 'h', now(), %s, %s)",
            (JOB, f"results/{JOB}/2", RESULT),
        )
        for state, attempt in steps:
            connection.execute(
                "INSERT INTO job_event (job_id, state, attempt, fraction, message) VALUES (%s, %s, %s, 0, '')",
                (JOB, state, attempt),
            )
    put(tmp_path, f"results/{JOB}/2/x.csv")
    put(tmp_path, f"results/{JOB}/1/x.csv")  # left by the attempt that was lost
    return tmp_path


def test_sound_database_has_no_faults(database_url: str, blobs: Path) -> None:
    assert find_job_faults(database_url, blobs, [JOB]) == []
    assert_sound(database_url, blobs, [JOB], timeout_s=0.0)


ADD = "INSERT INTO job_event (job_id, state, attempt, fraction, message) VALUES ('{}', '{}', {}, 0, '')".format


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("DELETE FROM job", "is lost"),
        ("UPDATE job SET state = 'running', finished_at = NULL", "is stuck as running"),
        ("UPDATE job SET finished_at = NULL", "at no time"),
        ("UPDATE job SET result = NULL", "without a result"),
        ("UPDATE job SET attempt = 3", "files of another attempt"),
        ("UPDATE job SET state = 'failed'", "its last event says otherwise"),
        ("DELETE FROM job_event WHERE state = 'queued' AND attempt = 0", "did not begin as queued"),
        (ADD(JOB, "succeeded", 2), "ended 2 times"),
        ("UPDATE job_event SET attempt = 1 WHERE state = 'succeeded'", "went from attempt 2 running to 1 succeeded"),
        ("UPDATE job_event SET state = 'failed' WHERE attempt = 1 AND state = 'running'", "went from failed to queued"),
    ],
)
def test_invalid_rows_are_reported(database_url: str, blobs: Path, change: str, message: str) -> None:
    with psycopg.connect(database_url) as connection:
        connection.execute(change.encode())
    assert any(message in fault for fault in find_job_faults(database_url, blobs, [JOB])), find_job_faults(
        database_url, blobs, [JOB]
    )
    with pytest.raises(AssertionError, match=JOB):
        assert_sound(database_url, blobs, [JOB], timeout_s=0.0)


def test_missing_short_and_unnamed_files_are_reported(database_url: str, blobs: Path) -> None:
    named = f"results/{JOB}/2/x.csv"
    put(blobs, named, b"")
    assert find_job_faults(database_url, blobs) == [f"{named} should have 1 bytes"]
    (blobs / named).unlink()
    assert find_job_faults(database_url, blobs) == [f"{named} should have 1 bytes"]
    put(blobs, named)
    for unnamed in (f"results/{JOB}/2/y.csv", f"results/{JOB}/3/x.csv", "results/other/1/x.csv"):
        put(blobs, unnamed)
        assert find_job_faults(database_url, blobs) == [f"{unnamed} is named by no result"]
        (blobs / unnamed).unlink()


def test_a_job_that_was_only_submitted_is_reported_as_stuck(database_url: str, tmp_path: Path) -> None:
    job_id = Jobs(database_url).submit("work")
    assert f"{job_id}: is stuck as queued" in find_job_faults(database_url, tmp_path)
