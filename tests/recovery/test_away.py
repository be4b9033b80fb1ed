"""File storage that is away for a while, and a worker whose disk is full: finished computations are not lost."""

import contextlib
import os
import shutil
import time
from collections.abc import Iterator
from itertools import count
from pathlib import Path

import pytest

from support.faults.disks import mounted_folder
from support.service.processes import Jobs, assert_sound, wait_until, worker


def take_away(store: Path) -> None:
    """Put a file where the folder was, so that nothing can be written or read below."""
    store.rename(store.with_suffix(".away"))
    store.touch()


def bring_back(store: Path) -> None:
    store.unlink()
    store.with_suffix(".away").rename(store)


def lines(diary: Path) -> list[str]:
    return diary.read_text(encoding="utf-8").splitlines() if diary.exists() else []


def test_finished_computation_waits_for_storage(database_url: str, tmp_path: Path) -> None:
    jobs, store, diary = Jobs(database_url), tmp_path / "blobs", tmp_path / "diary"
    with worker(database_url, tmp_path):
        first = jobs.submit("work")
        jobs.until_final(first)
        take_away(store)
        job_id = jobs.submit("long-work", work_s=0.2, diary=str(diary), name="j")
        wait_until(lambda: "j end" in lines(diary), 30, "the end of the computation")
        time.sleep(1.5)
        assert jobs.get(job_id).state == "running"
        bring_back(store)
        record = jobs.until_final(job_id)
        assert (record.state, record.attempt) == ("succeeded", 1), record.error
        assert_sound(database_url, store, [first, job_id])
    assert lines(diary) == ["j start", "j end"]


def test_storage_that_stays_away_ends_the_wait_and_a_cancelled_job_does_not_wait(
    database_url: str, tmp_path: Path
) -> None:
    jobs, store = Jobs(database_url), tmp_path / "blobs"
    with worker(database_url, tmp_path, STRIDELAB_STORAGE_PATIENCE_S="4"):
        jobs.until_final(jobs.submit("work"))
        take_away(store)
        cancelled = jobs.submit("long-work")
        jobs.until(cancelled, lambda record: record.fraction == 1.0)
        jobs.ask(lambda shop: shop.request_cancel(cancelled))
        assert jobs.until_final(cancelled, 3.0).state == "cancelled"
        given_up = jobs.until_final(jobs.submit("long-work"))
        assert given_up.error is not None
        assert given_up.error["code"] == "storage-unavailable"
        bring_back(store)
        assert jobs.until_final(jobs.submit("work")).state == "succeeded"
        assert_sound(database_url, store)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system with room for 64 files and folders."""
    with mounted_folder(tmp_path / "small", "size=2m,nr_inodes=64") as folder:
        yield folder


def fill(disk: Path) -> Path:
    """Leave room for not one folder more, once the worker has removed those of ended jobs; returns what takes it."""
    wait_until(lambda: not [path for path in disk.glob("work/*/*") if path.is_dir()], 30, "an empty work folder")
    ballast = disk / "ballast"
    ballast.mkdir(exist_ok=True)
    with contextlib.suppress(OSError):
        for number in count():
            (ballast / str(number)).touch()
    assert os.statvfs(disk).f_ffree == 0
    return ballast


def test_job_waits_for_room_on_the_disk_of_its_worker(database_url: str, tmp_path: Path, small_disk: Path) -> None:
    jobs = Jobs(database_url)
    blobs = {"STRIDELAB_BLOB_URL": (tmp_path / "blobs").as_uri(), "STRIDELAB_STORAGE_PATIENCE_S": "6"}
    with worker(database_url, tmp_path / "logs", STRIDELAB_DATA_DIR=str(small_disk), **blobs) as process:
        done = jobs.until_final(jobs.submit("work"))
        ballast = fill(small_disk)
        waiting = jobs.submit("long-work")
        jobs.until(waiting, lambda record: record.state == "running")
        time.sleep(1.0)
        assert jobs.get(waiting).message == ""  # it has not begun to compute
        shutil.rmtree(ballast)
        assert jobs.until_final(waiting).state == "succeeded"
        fill(small_disk)
        refused = jobs.until_final(jobs.submit("work"))
        assert refused.error is not None
        assert refused.error["code"] == "scratch-full"
        assert process.poll() is None
        assert_sound(database_url, tmp_path / "blobs", [done.id, waiting, refused.id])
