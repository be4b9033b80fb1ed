"""kill -9 of the web server, the worker, the postmaster and everything: a job ends once, succeeded, with one result.

So it does where nothing is killed and the whole machine is suspended.
"""

import contextlib
import os
import signal
import time
from pathlib import Path

import pytest

from support.service.database import public_folder
from support.service.processes import Service, assert_sound, running_service, wait_for_exit, wait_until
from support.service.supervisor_entry import API, WORKER

MEMBERS = {
    "web server": API,
    "worker": WORKER,
    "postmaster": "postgres",
}


def starts_and_ends(diary: Path, name: str) -> tuple[int, int]:
    lines = diary.read_text(encoding="utf-8").splitlines()
    return lines.count(f"{name} start"), lines.count(f"{name} end")


def assert_published_once(service: Service, job_id: str) -> None:
    record = service.jobs.get(job_id)
    assert record.state == "succeeded"
    store = service.folder / "blobs"
    assert [str(path.relative_to(store)) for path in (store / "results" / job_id).rglob("*.*")] == [
        f"{record.blob_prefix}/numbers.csv"
    ]
    assert_sound(service.url, store, [job_id])


@pytest.mark.parametrize("member", MEMBERS)
def test_running_job_survives_the_death_of(service: Service, member: str, tmp_path: Path) -> None:
    diary = tmp_path / "diary"
    job_id = service.jobs.submit("long-work", work_s=2.5, diary=str(diary), name="j")
    service.jobs.until_running(job_id)
    victim = service.member(MEMBERS[member])
    victim.kill()
    record = service.jobs.until_final(job_id)
    assert record.state == "succeeded", record.error
    assert_published_once(service, job_id)
    starts, ends = starts_and_ends(diary, "j")
    assert ends == 1
    # only the worker's death costs a second start; what the others' death interrupts goes on
    assert (starts, record.attempt) == ((2, 2) if member == "worker" else (1, 1))
    wait_until(service.healthy, 60, "a healthy service")


@pytest.mark.parametrize("member", MEMBERS)
def test_queued_job_survives_the_death_of(service: Service, member: str, tmp_path: Path) -> None:
    diary = tmp_path / "diary"
    ahead = service.jobs.submit("long-work", work_s=1.5, diary=str(diary), name="ahead")
    service.jobs.until_running(ahead)
    job_id = service.jobs.submit("long-work", diary=str(diary), name="j")
    assert service.jobs.get(job_id).state == "queued"
    service.member(MEMBERS[member]).kill()
    for waiting in (ahead, job_id):
        assert service.jobs.until_final(waiting).state == "succeeded"
        assert_published_once(service, waiting)
    assert starts_and_ends(diary, "j") == (1, 1)
    assert starts_and_ends(diary, "ahead")[1] == 1
    wait_until(service.healthy, 60, "a healthy service")


def test_a_suspended_machine_costs_no_attempt(service: Service, tmp_path: Path) -> None:
    """As with the lid of a laptop, for longer than a worker may be silent."""
    diary = tmp_path / "diary"
    job_id = service.jobs.submit("long-work", work_s=4.0, diary=str(diary), name="j")
    service.jobs.until_running(job_id)
    members = service.members()
    for process in members:
        process.suspend()
    time.sleep(5.0)
    for process in reversed(members):
        process.resume()
    record = service.jobs.until_final(job_id)
    assert (record.state, record.attempt) == ("succeeded", 1)
    assert starts_and_ends(diary, "j") == (1, 1)


def test_everything_killed_at_once_and_started_again(tmp_path: Path) -> None:
    diary = tmp_path / "diary"
    with public_folder() as folder:
        service = Service(folder / "data")
        service.start()
        running = service.jobs.submit("long-work", work_s=2.5, diary=str(diary), name="running")
        service.jobs.until_running(running)
        queued = service.jobs.submit("long-work", diary=str(diary), name="queued")
        members = service.members()
        for process in members:
            with contextlib.suppress(ProcessLookupError):  # it went with the one that was killed before it
                os.kill(process.pid, signal.SIGKILL)
        service.stop(signal.SIGKILL)
        wait_until(lambda: all(wait_for_exit(process) for process in members), 20, "everything ended")

        service.start()
        try:
            for job_id in (running, queued):
                assert service.jobs.until_final(job_id).state == "succeeded"
                assert_published_once(service, job_id)
            assert service.jobs.get(running).attempt == 2
            assert starts_and_ends(diary, "running") == (2, 1)
            assert starts_and_ends(diary, "queued") == (1, 1)
        finally:
            service.stop()


def test_two_services_side_by_side(service: Service) -> None:
    with running_service() as other:
        for each in (service, other):
            assert each.jobs.until_final(each.jobs.submit("work")).state == "succeeded"
            assert each.healthy()
        assert len({(each.port, each.url) for each in (service, other)}) == 2
