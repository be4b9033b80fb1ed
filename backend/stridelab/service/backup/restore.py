"""``stridelab restore``: restores a backup completely or not at all.

The whole archive is verified first. Its rows are then loaded into a staging schema, created by the migrations up to the
backup's revision, and upgraded there to the newest revision; then they replace the rows of the database. All of this is
one transaction, which is rolled back on any failure.

``stridelab adopt``: copies the data of an embedded service into the configured database and store.
"""

import shutil
import tempfile
from contextlib import nullcontext
from pathlib import Path
from typing import Final
from urllib.parse import unquote, urlsplit

import psycopg
import sqlalchemy
from psycopg import sql

from stridelab.errors import Conflict, InvalidInput, StorageFull, Unavailable, UnreadableFile
from stridelab.service.backup.archive import Archive, Progress, file_member, ignore_progress, open_archive, table_member
from stridelab.service.backup.create import BackupContents, create_backup
from stridelab.service.backup.locations import BackupLocation, open_location
from stridelab.service.backup.stored_files import StoredFiles
from stridelab.service.backup.table_rows import Connection, TableRows, refuse_other_connections
from stridelab.service.samples.recording import SHIPPED_JOBS
from stridelab.service.settings import Settings
from stridelab.service.storage.migrate import all_revisions, engine_of, migrate, upgrade_on
from stridelab.service.storage.publication import Publication
from stridelab.service.storage.tables import job_partial, token

_STAGING_SCHEMA: Final = "stridelab_restore"
_SPARE_BYTES: Final = 50_000_000
_LOCK_TIMEOUT: Final = "10s"
_REQUEUE_RUNNING: Final = """
    UPDATE job SET state = 'queued', returned = returned + 1, fraction = 0, started_at = NULL, worker_id = NULL,
                   message = 'restored; waiting again'
     WHERE state = 'running'
"""
"""Queues running jobs again, as their workers are not in the backup; the interrupted start does not count."""


def restore_backup(
    archive: Archive,
    target: BackupLocation,
    *,
    with_files: bool = True,
    with_tokens: bool = False,
    replace: bool = False,
    on_progress: Progress = ignore_progress,
) -> BackupContents:
    """Replace the data of ``target`` by a backup opened with ``open_archive``; returns the contents of the backup.

    Without ``with_files``, no files are restored. Without ``with_tokens``, the API tokens of ``target`` stay: the
    author of a foreign backup may know the tokens in it.

    Raises ``Conflict``: ``service-running`` while another process uses the database, ``restore-over-data`` if the
    database contains more than the samples and ``replace`` is False; ``UnreadableFile`` (``backup-damaged``,
    ``backup-newer``), ``StorageFull`` (``no-room``), ``Unavailable``.
    """
    manifest = archive.manifest
    if manifest.revision not in all_revisions():
        raise UnreadableFile(
            "backup-newer", f"The backup has revision {manifest.revision}, which is unknown to this version."
        )
    if with_files:
        if not manifest.with_files:
            raise UnreadableFile("backup-damaged", "This backup contains no files.")
        _refuse_small_disk(target.blob_url, manifest.file_bytes)
    migrate(target.database_url)
    engine = engine_of(target.database_url)
    new: list[str] = []
    publication = Publication()
    with StoredFiles(target.open_store()) if with_files else nullcontext() as files:
        try:
            with publication.synchronous_transaction(engine) as transaction:
                driver: Connection = transaction.connection.driver_connection  # type: ignore[assignment]
                file_keys = _replace_rows(transaction, driver, archive, with_tokens=with_tokens, replace=replace)
                if files is not None:
                    _put_files(files, file_keys, archive, new, on_progress)
        except BaseException as error:
            if publication.in_doubt:
                raise _unknown_outcome_error() from error
            if files is not None:
                files.delete_files(new)
            raise _restore_error(error) from error
        finally:
            engine.dispose()
    return BackupContents.from_manifest(manifest)


def _replace_rows(
    transaction: sqlalchemy.Connection, driver: Connection, archive: Archive, *, with_tokens: bool, replace: bool
) -> set[str]:
    """Replace the rows without committing; returns the keys of the files that they refer to."""
    driver.execute(sql.SQL("SET LOCAL lock_timeout = {}").format(sql.Literal(_LOCK_TIMEOUT)))
    refuse_other_connections(driver)
    if not replace:
        _refuse_data(driver)
    _load_staging_schema(transaction, driver, archive)
    _swap_rows(driver, with_tokens=with_tokens)
    file_keys = TableRows(driver).referenced_files()
    manifest = archive.manifest
    missing = file_keys - set(manifest.file_keys) - set(manifest.missing) if manifest.with_files else set()
    if missing:
        raise UnreadableFile("backup-damaged", f"{len(missing)} files that its rows refer to are not in the backup.")
    return file_keys


def _restore_error(error: BaseException) -> BaseException:
    """Convert an exception of the restore to an error of this project."""
    cause = getattr(error, "orig", error)
    if isinstance(cause, psycopg.errors.LockNotAvailable):
        return Conflict("service-running", "Another process uses the tables. Stop the web servers and workers first.")
    if isinstance(cause, psycopg.DataError | psycopg.IntegrityError):
        return UnreadableFile("backup-damaged", _failure_message("its rows are inconsistent", cause))
    if isinstance(cause, psycopg.OperationalError):
        return Unavailable("database-unreachable", _failure_message("the database failed", cause))
    if isinstance(cause, OSError):
        return StorageFull("no-room", f"The files cannot be written: {cause.strerror or cause}. Nothing was restored.")
    return error


def _unknown_outcome_error() -> Unavailable:
    return Unavailable(
        "outcome-unknown",
        "The database did not confirm whether the restore was committed. The files stay; check with `stridelab doctor "
        "--files`, and restore again if the recordings are missing.",
    )


def _load_staging_schema(transaction: sqlalchemy.Connection, driver: Connection, archive: Archive) -> None:
    """Load the rows into the staging schema and upgrade them to the newest revision."""
    manifest = archive.manifest
    driver.execute(sql.SQL("DROP SCHEMA IF EXISTS {0} CASCADE").format(sql.Identifier(_STAGING_SCHEMA)))
    driver.execute(sql.SQL("CREATE SCHEMA {0}").format(sql.Identifier(_STAGING_SCHEMA)))
    home = driver.execute("SHOW search_path").fetchone()
    driver.execute(sql.SQL("SET LOCAL search_path TO {}").format(sql.Identifier(_STAGING_SCHEMA)))
    upgrade_on(transaction, manifest.revision)
    rows = TableRows(driver)
    there = rows.table_columns()
    promised = {name: table.columns for name, table in manifest.tables.items()}
    if {name: sorted(columns) for name, columns in there.items()} != {n: sorted(c) for n, c in promised.items()}:
        raise UnreadableFile("backup-damaged", "The backup's tables do not match its revision.")
    with rows.without_foreign_keys(list(there)):
        for name, table in manifest.tables.items():
            if rows.copy_rows_in(name, table.columns, archive.read_pieces(table_member(name))) != table.rows:
                raise UnreadableFile("backup-damaged", f"The number of rows of {name} differs from the manifest.")
    upgrade_on(transaction, "head")
    driver.execute(_REQUEUE_RUNNING)
    driver.execute("SELECT set_config('search_path', %s, true)", home)


def _swap_rows(driver: Connection, *, with_tokens: bool) -> None:
    """Replace the rows of the tables by the staged ones."""
    rows = TableRows(driver)
    tables = rows.table_columns()
    if not with_tokens:
        del tables[token.name]
    with rows.without_foreign_keys(list(tables)):
        emptied = [
            *tables,
            job_partial.name,
        ]  # parts of jobs that were running here belong to none of the restored ones
        driver.execute(sql.SQL("TRUNCATE {}").format(sql.SQL(", ").join(map(sql.Identifier, emptied))))
        for name, columns in tables.items():
            listed = sql.SQL(", ").join(map(sql.Identifier, columns))
            driver.execute(
                sql.SQL("INSERT INTO {0} ({1}) OVERRIDING SYSTEM VALUE SELECT {1} FROM {2}").format(
                    sql.Identifier(name), listed, sql.Identifier(_STAGING_SCHEMA, name)
                )
            )
    driver.execute(
        "SELECT setval(pg_get_serial_sequence('job_event', 'seq'), coalesce(max(seq), 0) + 1, false) FROM job_event"
    )
    driver.execute(sql.SQL("DROP SCHEMA {} CASCADE").format(sql.Identifier(_STAGING_SCHEMA)))


def _put_files(
    files: StoredFiles, file_keys: set[str], archive: Archive, new: list[str], on_progress: Progress
) -> None:
    """Store the files that rows refer to; appends the keys that did not exist before to ``new``."""
    for place, key in enumerate(sorted(file_keys)):
        member = archive.manifest.members.get(file_member(key))
        if member is None:
            continue  # already missing when the backup was made
        on_progress(place / len(file_keys), "storing files")
        is_new = not files.has_file(key)
        if is_new:
            new.append(key)
        files.store_file(key, archive.read_pieces(file_member(key)), member.bytes)


def _refuse_data(driver: Connection) -> None:
    held = driver.execute(
        "SELECT (SELECT count(*) FROM recording WHERE NOT bundled) + (SELECT count(*) FROM scenario WHERE NOT bundled)"
        " + (SELECT count(*) FROM subject) + (SELECT count(*) FROM job WHERE id <> ALL(%s))",
        (list(SHIPPED_JOBS),),
    ).fetchone()
    if held and held[0]:
        raise Conflict(
            "restore-over-data",
            "The database already contains recordings, subjects, scenarios or jobs. Make a backup of it, then use "
            "--replace to replace its data.",
        )


def _refuse_small_disk(blob_url: str, wanted_bytes: int) -> None:
    parts = urlsplit(blob_url)
    if parts.scheme != "file":
        return
    folder = Path(unquote(parts.path))
    nearest = next(path for path in (folder, *folder.parents) if path.exists())
    free = shutil.disk_usage(nearest).free
    if free < wanted_bytes + _SPARE_BYTES:
        raise StorageFull(
            "no-room", f"The backup's files take {wanted_bytes / 1e6:,.0f} MB, {nearest} has {free / 1e6:,.0f} MB left."
        )


def _failure_message(reason: str, error: BaseException) -> str:
    lines = str(error).strip().splitlines()
    return f"Nothing was restored: {reason} ({lines[0][:200] if lines else type(error).__name__})."


def adopt_data_folder(
    folder: Path, settings: Settings, *, replace: bool = False, on_progress: Progress = ignore_progress
) -> BackupContents:
    """Copy the data folder of an embedded service, which must not run, into the database of ``settings``.

    Files are copied if ``settings`` has another store. The folder is not changed. Equivalent to a backup and a restore;
    raises their errors.
    """
    if settings.database_url is None:
        raise InvalidInput(
            "database-url-missing", "stridelab adopt needs STRIDELAB_DATABASE_URL: the server to copy the data to."
        )
    embedded = settings.model_copy(
        update={"data_dir": folder, "database_url": None, "blob_url": _store_url(folder, settings)}
    )
    with (
        tempfile.TemporaryDirectory(prefix=".stridelab-adopt-", dir=folder if folder.is_dir() else None) as scratch,
        open_location(embedded, require_stopped=True) as source,
    ):
        same_store = source.blob_url == settings.blob_address
        archive = Path(scratch) / "all"
        create_backup(
            source.database_url, None if same_store else source.open_store(), archive, on_progress=on_progress
        )
        with open_archive(archive, on_progress) as opened:
            target = BackupLocation(str(settings.database_dsn), settings.blob_address, settings.blob_options)
            return restore_backup(
                opened, target, with_files=not same_store, with_tokens=True, replace=replace, on_progress=on_progress
            )


def _store_url(folder: Path, settings: Settings) -> str | None:
    """None for the folder's own store; the configured store if the folder has none and therefore used that one."""
    return None if (folder.expanduser() / "blobs").is_dir() else settings.blob_url
