"""The disk under the whole service fills up: database, files and scratch at once. What was accepted is not lost."""

import contextlib
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from sqlalchemy.exc import DBAPIError

from stridelab.errors import StridelabError
from support.faults.disks import mounted_folder
from support.service.database import public_folder
from support.service.processes import Service, assert_sound, is_over, wait_until


@pytest.fixture
def disk() -> Iterator[Path]:
    """A file system of 128 MB."""
    with public_folder() as folder, mounted_folder(folder / "disk", "size=128m,mode=755") as disk:
        yield disk


def fill(disk: Path) -> Path:
    """Leave not a byte; returns what takes it."""
    ballast = disk / "ballast"
    with contextlib.suppress(OSError), ballast.open("wb", buffering=0) as file:
        while file.write(b"\0" * 65536):
            pass
    return ballast


def test_a_full_disk_refuses_what_it_cannot_keep_and_goes_on_afterwards(disk: Path) -> None:
    service = Service(disk / "data")
    service.start(STRIDELAB_STORAGE_PATIENCE_S="60")
    try:
        jobs, accepted = service.jobs, []
        accepted.append(jobs.submit("work"))
        jobs.until_final(accepted[0])
        ballast = fill(disk)
        refused, began = None, time.monotonic()
        while refused is None:  # the database has room in files that it has already; then it has not
            assert not is_over(began, 60.0), f"{len(accepted)} were accepted"
            try:
                accepted.append(jobs.submit("work"))
            except (DBAPIError, OSError, StridelabError) as error:
                refused = error
            fill(disk)
        with contextlib.suppress(httpx.TransportError):  # it may be starting again
            answer = httpx.get(f"http://127.0.0.1:{service.port}/api/v1/jobs", timeout=30.0)
            assert answer.status_code == 200 or answer.json()["code"] == "database-unreachable"
        ballast.unlink()
        wait_until(service.healthy, 60.0, "the service is back")
        ended = [jobs.until_final(job_id, 120.0) for job_id in accepted]
        assert {job.state for job in ended} <= {"succeeded", "failed"}
        codes = {job.error["code"] for job in ended if job.error is not None}
        assert codes <= {"scratch-full", "storage-unavailable"}, codes
        assert jobs.until_final(jobs.submit("work")).state == "succeeded"
        assert_sound(service.url, disk / "data" / "blobs", accepted)
    finally:
        service.stop()
