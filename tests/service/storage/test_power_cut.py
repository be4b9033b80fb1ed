"""Files are on the disk before the rows that name them are committed: a power cut at any commit loses none."""

import asyncio
import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psycopg
import pytest
import sqlalchemy
from sqlalchemy import event

from stridelab.service.jobs.notifications import JobNotifications
from stridelab.service.jobs.store import JobStore
from stridelab.service.jobs.worker import Worker
from stridelab.service.settings import Settings
from stridelab.service.storage.blobs import BlobStore
from stridelab.service.storage.database import make_engine
from stridelab.service.storage.local_files import write_durably
from support.faults.disks import VolatileFileSystem
from support.recordings.c3d_files import small_trial
from support.service.job_kinds import KINDS
from support.service.web_server import served, upload

PUBLISHING = ("INSERT INTO recording ", "UPDATE recording SET", "finished_at = now()")


def store_on(system: VolatileFileSystem, folder: Path) -> BlobStore:
    store = BlobStore.from_url(folder.as_uri())
    return BlobStore(store.backend, store.folder, system)


def test_a_file_is_lost_where_nothing_is_synchronised(tmp_path: Path) -> None:
    """The simulation can lose a file: otherwise the tests below would show nothing."""
    (tmp_path / "file").write_bytes(b"content")
    for syncs, remaining in ((False, {}), (True, {"results/a/1/x": b"content"})):
        system = VolatileFileSystem(tmp_path / f"blobs-{syncs}", syncs=syncs)
        store = store_on(system, tmp_path / f"blobs-{syncs}")
        asyncio.run(store.put_file("results/a/1/x", tmp_path / "file"))
        assert system.after_power_cut() == remaining


@pytest.mark.parametrize("left_out", ["file", "folder", "parent"])
def test_each_sync_is_needed(left_out: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the file's the content is lost, without a folder's the name."""
    (tmp_path / "file").write_bytes(b"content")
    root = tmp_path / "blobs"
    root.mkdir()

    class Forgetful(VolatileFileSystem):
        def sync(self, path: Path) -> None:
            what = "file" if not path.is_dir() else "folder" if path == root / "a" / "b" else "parent"
            if what != left_out:
                super().sync(path)

    system = Forgetful(root)
    write_durably(root, "a/b/x", tmp_path / "file", system)
    assert system.after_power_cut() != {"a/b/x": b"content"}


Disk = dict[str, bytes]


class Cuts:
    """What a power cut would leave right before the COMMIT of every transaction that publishes files."""

    def __init__(self, system: VolatileFileSystem) -> None:
        self.disks: list[Disk] = []
        self._system, self._publishing = system, set[int]()

    def executed(self, connection: Any, _cursor: Any, statement: str, *_: Any) -> None:
        if any(words in statement for words in PUBLISHING):
            self._publishing.add(id(connection))

    def committed(self, connection: Any) -> None:
        if id(connection) in self._publishing:
            self._publishing.discard(id(connection))
            self.disks.append(self._system.after_power_cut())


@pytest.fixture
def system(tmp_path: Path) -> VolatileFileSystem:
    return VolatileFileSystem(tmp_path / "blobs")


@pytest.fixture
def cuts(system: VolatileFileSystem) -> Iterator[Cuts]:
    power_cuts = Cuts(system)
    heard = (("before_cursor_execute", power_cuts.executed), ("commit", power_cuts.committed))
    for name, act in heard:
        event.listen(sqlalchemy.Engine, name, act)
    try:
        yield power_cuts
    finally:
        for name, act in heard:
            event.remove(sqlalchemy.Engine, name, act)


def test_uploads_and_changes_are_on_the_disk_when_they_are_committed(
    database_url: str, tmp_path: Path, system: VolatileFileSystem, cuts: Cuts, monkeypatch: pytest.MonkeyPatch
) -> None:
    store, content = store_on(system, tmp_path / "blobs"), small_trial(tmp_path / "walk.c3d").read_bytes()
    monkeypatch.setattr(BlobStore, "from_url", lambda *_: store)
    with served(database_url, tmp_path / "data") as lab, lab.http() as http:
        cuts.disks.clear()
        recordings = [upload(http, content).json() for _ in range(2)]  # the second one finds the file of the first
        first = recordings[0]["id"]
        assert http.patch(f"/api/v1/recordings/{first}", json={"plates": {"1": {"use": False}}}).status_code == 200
    assert len(cuts.disks) == 3
    with psycopg.connect(database_url) as connection:
        rows: dict[str, str] = dict(
            connection.execute("SELECT id, tracks_key FROM recording WHERE NOT bundled").fetchall()
        )
    blob = f"uploads/{hashlib.sha256(content).hexdigest()}"
    for disk in cuts.disks:
        assert disk[blob] == content
    after_both, after_change = cuts.disks[1], cuts.disks[2]
    assert any(key.startswith(f"recordings/{first}/") for key in after_both)
    for disk, recording in ((after_both, recordings[1]["id"]), (after_change, first)):
        key = rows[recording]
        assert disk[key] == (tmp_path / "blobs" / key).read_bytes()


def test_a_file_that_was_never_synchronised_is_when_another_recording_uses_it(
    tmp_path: Path, system: VolatileFileSystem
) -> None:
    """Its writer was killed before; the second upload of the bytes does not store them again."""
    content, store = b"the same bytes", store_on(system, tmp_path / "blobs")
    (tmp_path / "file").write_bytes(content)
    sha256 = hashlib.sha256(content).hexdigest()
    key = f"uploads/{sha256}"
    (tmp_path / "blobs" / "uploads").mkdir()
    (tmp_path / "blobs" / key).write_bytes(content)
    assert system.after_power_cut() == {}
    assert asyncio.run(store.keep_or_replace(key, tmp_path / "file", sha256)) is False
    assert system.after_power_cut() == {key: content}


@pytest.mark.parametrize(("kind", "state"), [("work", "succeeded"), ("stop-half-way", "failed")])
def test_results_are_on_the_disk_when_they_are_committed(
    kind: str,
    state: str,
    database_url: str,
    tmp_path: Path,
    system: VolatileFileSystem,
    cuts: Cuts,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))  # the children import support.service.computations
    store, limits = store_on(system, tmp_path / "blobs"), Settings(data_dir=tmp_path, worker_slots=1)

    async def act() -> Any:
        engine = make_engine(database_url)
        worker = Worker(database_url, store, KINDS, limits)
        working = asyncio.create_task(worker.run())
        try:
            async with JobNotifications(database_url) as board:
                jobs = JobStore(engine, KINDS)
                record = await board.wait_for_end(jobs, (await jobs.submit(kind, {})).job_id, 30.0)
                return record, await jobs.result(record.id)
        finally:
            worker.stop()
            await working
            await engine.dispose()

    record, result = asyncio.run(act())
    assert record.state == state
    (artifact,) = result.artifacts
    (disk,) = cuts.disks
    content = disk[f"{record.blob_prefix}/{artifact.name}"]
    assert (len(content), hashlib.sha256(content).hexdigest()) == (artifact.bytes, artifact.sha256)
