"""The network between a worker and the database is cut for longer than the stall time."""

import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from stridelab.service.storage.database import parse_url
from support.cut import relay
from support.ledger import assert_sound
from support.service import Jobs, wait_until, worker


def test_cut_off_worker_loses_its_job_to_another_and_publishes_nothing(database_url: str, tmp_path: Path) -> None:
    address = parse_url(database_url)
    folder = address.query.get("host")
    if not isinstance(folder, str):
        pytest.skip("the relay leads to an embedded server's socket")
    jobs, diary = Jobs(database_url), tmp_path / "diary"
    blobs = {"STRIDELAB_BLOB_URL": (tmp_path / "blobs").as_uri()}
    with relay(f"{folder}/.s.PGSQL.5432") as cable, ExitStack() as stack:
        by_wire = f"postgresql://{address.username}@127.0.0.1:{cable.port}/{address.database}?sslmode=disable"
        stack.enter_context(worker(by_wire, tmp_path / "far", **blobs))
        job_id = jobs.submit("long-work", work_s=3.0, diary=str(diary), name="j")
        jobs.until_running(job_id)
        cable.pull()
        stack.enter_context(worker(database_url, tmp_path / "near", **blobs))
        record = jobs.until_final(job_id)
        assert (record.state, record.attempt) == ("succeeded", 2)
        # the worker that was cut off has finished too, and has nothing to say once it is heard again
        wait_until(lambda: diary.read_text().split().count("end") == 2, 20, "both ends")
        cable.plug()
        time.sleep(3.0)
        assert jobs.get(job_id) == record
        assert_sound(database_url, tmp_path / "blobs", [job_id])
        kept = [str(path.relative_to(tmp_path / "blobs")) for path in (tmp_path / "blobs").rglob("*.csv")]
        assert kept == [f"results/{job_id}/2/numbers.csv"]
        # and it works again: two long jobs at a time, which the near worker alone cannot
        both = [jobs.submit("long-work", work_s=3.0, diary=str(diary), name=f"k{n}") for n in (1, 2)]
        wait_until(lambda: {jobs.get(one).state for one in both} == {"running"}, 30, "both at work")
        assert [jobs.until_final(one).state for one in both] == ["succeeded"] * 2
        assert_sound(database_url, tmp_path / "blobs", [job_id, *both])
