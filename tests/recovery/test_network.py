"""The network between a worker and the database is cut for longer than the stall time."""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import pytest

from stridelab.service.jobs.queue import attempt_prefix
from stridelab.service.storage.database import parse_url
from support.faults.network import HERE, hosts, relay
from support.service.processes import Jobs, assert_sound, environment, wait_until, worker


class Cable(Protocol):
    """What can be pulled and put back."""

    def pull(self) -> None: ...

    def plug(self) -> None: ...


@dataclass(frozen=True)
class Far:
    """A way to the database that can be cut: its address, and what goes before a command that shall use it."""

    cable: Cable
    url: str
    on: tuple[str, ...] = ()


@contextmanager
def by_wire(database_url: str) -> Iterator[Far]:
    """On this machine, through a relay that stops forwarding: connections stay, and nothing comes through."""
    address = parse_url(database_url)
    with relay(_socket(database_url)) as cable:
        yield Far(cable, f"postgresql://{address.username}@127.0.0.1:{cable.port}/{address.database}?sslmode=disable")


@contextmanager
def by_net(database_url: str) -> Iterator[Far]:
    """On a host of its own whose cable is pulled: packets are lost, and connections may die of it."""
    address, port = parse_url(database_url), 5432
    with hosts() as pair:
        door = [*pair.here, sys.executable, "-m", "support.faults.network", _socket(database_url), HERE, str(port)]
        process = subprocess.Popen(door, env=environment())
        try:
            url = f"postgresql://{address.username}@{HERE}:{port}/{address.database}?sslmode=disable"
            yield Far(pair, url, pair.there)
        finally:
            process.kill()
            process.wait()


def _socket(database_url: str) -> str:
    folder = parse_url(database_url).query.get("host")
    if not isinstance(folder, str):
        pytest.skip("the relay leads to an embedded server's socket")
    return f"{folder}/.s.PGSQL.5432"


@pytest.mark.parametrize("way", [by_wire, by_net])
def test_cut_off_worker_loses_its_job_to_another_and_publishes_nothing(
    database_url: str, tmp_path: Path, way: Callable[[str], AbstractContextManager[Far]]
) -> None:
    jobs, diary = Jobs(database_url), tmp_path / "diary"
    blobs = {"STRIDELAB_BLOB_URL": (tmp_path / "blobs").as_uri()}
    with way(database_url) as far, ExitStack() as stack:
        stack.enter_context(worker(far.url, tmp_path / "far", on=far.on, **blobs))
        job_id = jobs.submit("long-work", work_s=3.0, diary=str(diary), name="j")
        jobs.until_running(job_id)
        far.cable.pull()
        stack.enter_context(worker(database_url, tmp_path / "near", **blobs))
        record = jobs.until_final(job_id)
        assert (record.state, record.attempt) == ("succeeded", 2)
        # the worker that was cut off has finished too, and has nothing to say once it is heard again
        wait_until(lambda: diary.read_text().split().count("end") == 2, 20, "both ends")
        far.cable.plug()
        time.sleep(3.0)
        assert jobs.get(job_id) == record
        assert_sound(database_url, tmp_path / "blobs", [job_id])
        stored = [str(path.relative_to(tmp_path / "blobs")) for path in (tmp_path / "blobs").rglob("*.csv")]
        assert stored == [f"{attempt_prefix(job_id, 2, record.started_at)}/numbers.csv"]
        # and it works again: two long jobs at a time, which the near worker alone cannot
        both = [jobs.submit("long-work", work_s=3.0, diary=str(diary), name=f"k{n}") for n in (1, 2)]
        wait_until(lambda: {jobs.get(one).state for one in both} == {"running"}, 45, "both at work")
        assert [jobs.until_final(one).state for one in both] == ["succeeded"] * 2
        assert_sound(database_url, tmp_path / "blobs", [job_id, *both])
