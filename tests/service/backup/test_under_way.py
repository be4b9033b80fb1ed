"""Backups while others write, and restores that are killed."""

import asyncio
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from unittest import mock

import psycopg

from stridelab.service.api.app import create_app
from stridelab.service.api.robots.cache import RobotCache
from stridelab.service.backup.create import BackupContents, create_backup
from stridelab.service.backup.table_rows import open_snapshot
from stridelab.service.samples.recording import SAMPLE_ID
from stridelab.service.settings import Settings
from stridelab.service.storage import locks
from stridelab.service.storage.blobs import BlobStore
from support.service.database import TestDatabases
from support.service.processes import wait_until
from support.service.stored_rows import read_rows, read_stored_files
from support.service.web_server import LatePool

PutBack = Callable[..., BackupContents]
SLOW_RESTORE = """
import sys, time
from pathlib import Path
from stridelab.service.backup import restore as restoring
from stridelab.service.backup.archive import open_archive
from stridelab.service.backup.locations import BackupLocation
put = restoring.StoredFiles.store_file
def slowly(*how):
    put(*how)
    print("stored", flush=True)
    time.sleep(60)
restoring.StoredFiles.store_file = slowly
with open_archive(Path(sys.argv[1])) as archive:
    restoring.restore_backup(archive, BackupLocation(sys.argv[2], sys.argv[3], {}), replace=True)
"""


def come_and_go(url: str, blobs: Path, stop: threading.Event, busy: threading.Event) -> None:
    """Recordings that are made and deleted as the service does it: files before the row, the row before its files."""
    number = 0
    with psycopg.connect(url, autocommit=True) as connection:
        while not stop.is_set():
            number += 1
            folder = blobs / "recordings" / f"r{number}"
            folder.mkdir(parents=True)
            for name in ("trial", "tracks"):
                (folder / name).write_bytes(f"{name} {number}".encode())
            connection.execute(
                "INSERT INTO recording (id, filename, sha256, bytes, blob_key, tracks_key, facts, subject_fields)"
                " VALUES (%(id)s, 'f', 's', 1, 'recordings/' || %(id)s || '/trial',"
                " 'recordings/' || %(id)s || '/tracks', '{}', '{}')",
                {"id": f"r{number}"},
            )
            if number > 20:
                connection.execute("DELETE FROM recording WHERE id = %s", (f"r{number - 20}",))
                with connection.transaction():
                    lock_query = connection.execute("SELECT pg_try_advisory_xact_lock_shared(%s)", (locks.REMOVAL,))
                    if lock_query.fetchone() == (True,):
                        shutil.rmtree(blobs / "recordings" / f"r{number - 20}")
                busy.set()


def test_backups_among_writers_are_whole(
    postgres: TestDatabases, database_url: str, put_back: PutBack, tmp_path: Path
) -> None:
    blobs, stop, busy = tmp_path / "source", threading.Event(), threading.Event()
    blobs.mkdir()
    writer = threading.Thread(target=come_and_go, args=(database_url, blobs, stop, busy))
    writer.start()
    try:
        assert busy.wait(30), "no recording came and went"
        backups = []
        for number in range(4):
            backups.append(
                create_backup(database_url, BlobStore.from_url(blobs.as_uri()), tmp_path / f"{number}.backup")
            )
            time.sleep(0.2)
    finally:
        stop.set()
        writer.join()
    assert [one.missing for one in backups] == [()] * 4
    for number in range(4):
        with postgres.fresh(migrated=False) as url:
            put_back(tmp_path / f"{number}.backup", url)
            files = read_stored_files(tmp_path / "blobs")
            there = read_rows(url)["recording"]
            assert len(there) == backups[number].rows["recording"] >= 19
            for row in there:
                assert files[row["blob_key"]].decode() == f"trial {row['id'][1:]}"
                assert files[row["tracks_key"]].decode() == f"tracks {row['id'][1:]}"


def test_a_backup_waits_for_a_removal_at_work(database_url: str, tmp_path: Path) -> None:
    """Rows of a moment at which their files were just going would name what is not there."""
    store, target = BlobStore.from_url(tmp_path.as_uri()), tmp_path / "lab.backup"
    with psycopg.connect(database_url) as removing, psycopg.connect(database_url, autocommit=True) as watching:
        lock_query = removing.execute("SELECT pg_try_advisory_xact_lock_shared(%s)", (locks.REMOVAL,))
        assert lock_query.fetchone() == (True,)
        backup = threading.Thread(target=create_backup, args=(database_url, store, target))
        backup.start()
        waiting = "SELECT count(*) FROM pg_locks WHERE locktype = 'advisory' AND NOT granted"
        wait_until(lambda: watching.execute(waiting).fetchone() == (1,), 20, "a backup that waits")
        refused = watching.execute("SELECT pg_try_advisory_xact_lock_shared(%s)", (locks.REMOVAL,))
        assert refused.fetchone() == (False,), "removals that go on for ever would keep a backup waiting"
        removing.rollback()
        backup.join(20)
    assert target.exists()


def test_a_web_server_comes_up_while_a_backup_runs(database_url: str, tmp_path: Path) -> None:
    """The server brings its sample into the database at start, which removes no file and waits for no backup."""
    settings = Settings(database_url=database_url, data_dir=tmp_path / "data", min_free_disk_mb=0)
    (tmp_path / "data").mkdir()

    async def come_up() -> float:
        began = time.monotonic()
        app = create_app(settings, with_sample=True)
        async with asyncio.timeout(30.0), app.router.lifespan_context(app):
            return time.monotonic() - began

    with (
        open_snapshot(database_url),
        mock.patch("stridelab.service.api.app.IsolatedPool", LatePool),
        mock.patch.object(RobotCache, "prepare_all", mock.AsyncMock()),
    ):
        assert asyncio.run(come_up()) < 5.0
    assert [row["id"] for row in read_rows(database_url)["recording"]] == [SAMPLE_ID]


def test_a_restore_that_is_killed_has_changed_no_row(backup: Path, database_url: str, tmp_path: Path) -> None:
    with psycopg.connect(database_url) as connection:
        connection.execute("INSERT INTO subject (id, fields) VALUES ('kept', '{}')")
    before = read_rows(database_url)
    process = subprocess.Popen(
        [sys.executable, "-c", SLOW_RESTORE, str(backup), database_url, (tmp_path / "blobs").as_uri()],
        stdout=subprocess.PIPE,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == b"stored\n"
    process.send_signal(signal.SIGKILL)
    process.wait()
    process.stdout.close()

    def free() -> bool:
        with psycopg.connect(database_url) as connection:
            others = "SELECT count(*) FROM pg_stat_activity WHERE datname = current_database()"
            return connection.execute(others).fetchone() == (1,)

    wait_until(free, 20, "the server noticed")
    assert read_rows(database_url) == before
    assert len(read_stored_files(tmp_path / "blobs")) == 1  # which no row names: the janitor's
