"""What is backed up comes back: every row, every byte, open jobs waiting again; or nothing happens at all."""

import shutil
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import psycopg
import pytest

from stridelab.errors import Conflict, InvalidInput, StorageFull, TooLarge, Unavailable, UnreadableFile
from stridelab.service.backup import archive as archive_module
from stridelab.service.backup.archive import open_archive
from stridelab.service.backup.create import BackupContents, create_backup
from stridelab.service.backup.stored_files import StoredFiles
from stridelab.service.storage.blobs import BlobStore
from stridelab.service.storage.migrate import is_migrated
from support.service.database import TestDatabases, migrate_to
from support.service.processes import Jobs, worker
from support.service.stored_rows import AWKWARD, FILES, fill_tables, read_rows, read_stored_files

PutBack = Callable[..., BackupContents]


def of(folder: Path) -> BlobStore:
    return BlobStore.from_url(folder.as_uri())


def test_everything_comes_back(postgres: TestDatabases, empty: str, put_back: PutBack, tmp_path: Path) -> None:
    with postgres.fresh() as url:
        fill_tables(url, tmp_path / "source")
        before = read_rows(url)
        backup = create_backup(url, of(tmp_path / "source"), tmp_path / "lab.backup")
        assert read_rows(url) == before
    assert put_back(tmp_path / "lab.backup", empty) == backup
    assert is_migrated(empty)
    after = read_rows(empty)
    assert {name: after[name] for name in after if name != "job"} == {n: before[n] for n in before if n != "job"}
    assert after["recording"][0]["filename"] == AWKWARD
    assert read_stored_files(tmp_path / "blobs") == FILES
    assert (backup.files, backup.bytes, backup.missing) == (len(FILES), sum(map(len, FILES.values())), ())
    assert backup.rows == {
        "subject": 1,
        "scenario": 1,
        "recording": 2,
        "job": 6,
        "job_event": 6,
        "token": 0,
        "audit": 0,
        "marker_set": 0,
        "robot": 0,
    }
    assert (tmp_path / "lab.backup").stat().st_mode & 0o777 == 0o600

    was, now = ({row["id"]: row for row in side["job"]} for side in (before, after))
    for job_id in ("done", "half", "gone"):
        assert now[job_id] == was[job_id]
    interrupted = {"state": "queued", "returned": 1, "message": "restored; waiting again", "fraction": 0.0}
    assert now["at-work"] == {**was["at-work"], **interrupted}


def test_parts_of_running_jobs_are_not_in_a_backup_and_gone_after_a_restore(
    postgres: TestDatabases, put_back: PutBack, tmp_path: Path
) -> None:
    with postgres.fresh() as url:
        fill_tables(url, tmp_path / "source")
        with psycopg.connect(url) as connection:
            for attempt in (1, 2, 3):
                connection.execute("INSERT INTO job_partial SELECT id, %s, 1, '{}' FROM job", (attempt,))
        taken = create_backup(url, of(tmp_path / "source"), tmp_path / "lab.backup")
        assert "job_partial" not in taken.rows
        put_back(tmp_path / "lab.backup", url, replace=True)
        with psycopg.connect(url) as connection:
            assert connection.execute("SELECT count(*) FROM job").fetchone() == (6,)
            assert connection.execute("SELECT count(*) FROM job_partial").fetchone() == (0,)


def test_restored_jobs_run_in_their_old_order_and_new_ones_after_them(
    backup: Path, empty: str, put_back: PutBack, tmp_path: Path
) -> None:
    put_back(backup, empty)
    jobs = Jobs(empty)
    with psycopg.connect(empty) as connection:
        last = connection.execute("SELECT max(seq) FROM job_event").fetchone()
    new = jobs.submit("work")
    with worker(empty, tmp_path / "w", STRIDELAB_BLOB_URL=(tmp_path / "blobs").as_uri()):
        ended = [jobs.until_final(job_id) for job_id in ("at-work", "first", "second", new)]
    assert [record.state for record in ended] == ["succeeded"] * 4
    assert [record.attempt for record in ended] == [3, 1, 1, 1]
    starts = [record.started_at for record in ended[:3]]
    assert all(starts)
    # two slots take their jobs in order, and may be a moment apart when they say so
    behind_s = [(after - before).total_seconds() for before, after in pairwise(filter(None, starts))]
    assert min(behind_s) > -0.1
    with psycopg.connect(empty) as connection:
        assert last is not None
        first = connection.execute("SELECT min(seq) FROM job_event WHERE job_id = %s", (new,)).fetchone()
        assert first is not None
        assert first > last


def test_a_backup_of_the_first_schema_is_brought_up_to_date(
    postgres: TestDatabases, empty: str, put_back: PutBack, tmp_path: Path
) -> None:
    with postgres.fresh(migrated=False) as url:
        migrate_to(url, "0001")
        fill_tables(url, tmp_path / "source")
        create_backup(url, of(tmp_path / "source"), tmp_path / "old.backup")
    put_back(tmp_path / "old.backup", empty)
    assert is_migrated(empty)
    assert [row["updated_at"] == row["created_at"] for row in read_rows(empty)["scenario"]] == [True]
    assert read_stored_files(tmp_path / "blobs") == FILES
    with psycopg.connect(empty) as connection, pytest.raises(psycopg.errors.ForeignKeyViolation):
        connection.execute("UPDATE job SET scenario_id = 'nowhere'")


def test_data_are_replaced_only_with_replace(
    backup: Path, database_url: str, put_back: PutBack, tmp_path: Path
) -> None:
    with psycopg.connect(database_url) as connection:
        connection.execute("INSERT INTO subject (id, fields) VALUES ('other', '{}')")
    with pytest.raises(Conflict) as caught:
        put_back(backup, database_url)
    assert caught.value.code == "restore-over-data"
    assert not read_stored_files(tmp_path / "blobs")
    put_back(backup, database_url, replace=True)
    assert [row["id"] for row in read_rows(database_url)["subject"]] == ["p1"]
    put_back(backup, database_url, replace=True)  # and once more over itself
    assert read_stored_files(tmp_path / "blobs") == FILES
    with psycopg.connect(database_url) as connection:
        keys = connection.execute(
            "SELECT count(*) FROM pg_constraint WHERE contype = 'f' AND conrelid = 'job'::regclass"
        )
        assert keys.fetchone() == (2,)


def test_a_running_service_is_not_restored_under(backup: Path, database_url: str, put_back: PutBack) -> None:
    with psycopg.connect(database_url), pytest.raises(Conflict) as caught:
        put_back(backup, database_url)
    assert caught.value.code == "service-running"


def test_a_restore_that_fails_leaves_everything_as_it_was(
    backup: Path, database_url: str, put_back: PutBack, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with psycopg.connect(database_url) as connection:
        connection.execute("INSERT INTO subject (id, fields) VALUES ('other', '{}')")
    before, real = read_rows(database_url), StoredFiles.store_file
    for failure, expected in (
        (OSError(28, "No space left on device"), StorageFull),
        (KeyboardInterrupt(), KeyboardInterrupt),
    ):

        def put(files: StoredFiles, key: str, *rest: Any, how: BaseException = failure) -> None:
            if key.startswith("uploads/"):
                raise how
            real(files, key, *rest)

        monkeypatch.setattr(StoredFiles, "store_file", put)
        with pytest.raises(expected):
            put_back(backup, database_url, replace=True)
        assert read_rows(database_url) == before
        assert read_stored_files(tmp_path / "blobs") == {}
        with psycopg.connect(database_url) as connection:
            assert connection.execute("SELECT to_regnamespace('stridelab_restore')").fetchone() == (None,)


def test_a_small_disk_is_reported_before_anything_is_done(
    backup: Path, empty: str, put_back: PutBack, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shutil.disk_usage", lambda _: type("Usage", (), {"free": 1000})())
    with pytest.raises(StorageFull, match="MB left"):
        put_back(backup, empty)
    assert not is_migrated(empty)


def test_an_already_missing_file_is_reported_and_the_rest_is_saved(
    database_url: str, empty: str, put_back: PutBack, tmp_path: Path
) -> None:
    fill_tables(database_url, tmp_path / "source")
    lost = "results/done/1/com.csv"
    (tmp_path / "source" / lost).unlink()
    assert create_backup(database_url, of(tmp_path / "source"), tmp_path / "lab.backup").missing == (lost,)
    assert put_back(tmp_path / "lab.backup", empty).missing == (lost,)
    assert read_stored_files(tmp_path / "blobs") == {key: body for key, body in FILES.items() if key != lost}


def test_more_files_than_a_backup_lists_are_refused_at_once(
    database_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fill_tables(database_url, tmp_path / "source")
    monkeypatch.setattr(archive_module, "MAX_MANIFEST_BYTES", 1000)
    with pytest.raises(TooLarge, match="6 files"):
        create_backup(database_url, of(tmp_path / "source"), tmp_path / "lab.backup")
    assert not list(tmp_path.glob("*.backup*"))


def test_an_earlier_backup_is_not_overwritten_by_default(database_url: str, tmp_path: Path) -> None:
    target, blobs = tmp_path / "lab.backup", of(tmp_path / "blobs")
    target.write_text("precious")
    with pytest.raises(Conflict) as caught:
        create_backup(database_url, blobs, target)
    assert caught.value.code == "backup-exists"
    assert target.read_text() == "precious"
    create_backup(database_url, blobs, target, force=True)
    with open_archive(target) as archive:
        assert archive.manifest.with_files
    with pytest.raises(InvalidInput, match="does not exist"):
        create_backup(database_url, blobs, tmp_path / "nowhere" / "lab.backup")


def test_a_backup_that_fails_leaves_nothing(database_url: str, empty: str, tmp_path: Path) -> None:
    fill_tables(database_url, tmp_path / "source")
    folder = tmp_path / "backups"
    folder.mkdir()
    shutil.rmtree(tmp_path / "source" / "uploads")
    (tmp_path / "source" / "uploads").write_text("a file where a folder should be")
    with pytest.raises(Unavailable) as caught:
        create_backup(database_url, of(tmp_path / "source"), folder / "lab.backup")
    assert caught.value.code == "storage-unavailable"
    with pytest.raises(Conflict) as refused:
        create_backup(empty, of(tmp_path / "source"), folder / "lab.backup")
    assert refused.value.code == "nothing-to-back-up"
    with pytest.raises(Unavailable) as away:
        create_backup("postgresql://x@127.0.0.1:9/y", None, folder / "lab.backup")
    assert away.value.code == "database-unreachable"
    assert list(folder.iterdir()) == []


def test_rows_alone_do_not_restore_files(database_url: str, empty: str, put_back: PutBack, tmp_path: Path) -> None:
    create_backup(database_url, None, tmp_path / "rows")
    with pytest.raises(UnreadableFile, match="no files"):
        put_back(tmp_path / "rows", empty)


def _add_token(url: str, name: str) -> None:
    with psycopg.connect(url) as connection:
        connection.execute(
            "INSERT INTO token (id, name, scope, token_hash) VALUES (%s, %s, 'admin', %s)",
            (name, name, f"hash of {name}"),
        )


def _tokens(url: str) -> list[str]:
    with psycopg.connect(url) as connection:
        return [name for (name,) in connection.execute("SELECT name FROM token ORDER BY name")]


@pytest.mark.parametrize(("options", "there"), [({}, ["own"]), ({"with_tokens": True}, ["theirs"])])
def test_tokens_of_a_backup_are_restored_only_on_request(
    postgres: TestDatabases,
    database_url: str,
    put_back: PutBack,
    tmp_path: Path,
    options: dict[str, bool],
    there: list[str],
) -> None:
    with postgres.fresh() as url:
        fill_tables(url, tmp_path / "source")
        _add_token(url, "theirs")
        create_backup(url, of(tmp_path / "source"), tmp_path / "lab.backup")
    _add_token(database_url, "own")
    put_back(tmp_path / "lab.backup", database_url, **options)
    assert _tokens(database_url) == there
    assert len(read_rows(database_url)["recording"]) == 2
