"""``stridelab restore``: a whole backup, or nothing of it.

The archive is checked to its last byte first. Its rows then go into a schema of their own, made by the migrations of
the revision that the backup has, and are brought up to date there like a database of that age; only then do they
take the place of what there was. All that is one transaction: whatever fails, nothing has happened.
"""

import shutil
from contextlib import nullcontext
from pathlib import Path
from typing import Final
from urllib.parse import unquote, urlsplit

import psycopg
import sqlalchemy
from psycopg import sql

from stridelab.errors import Conflict, StorageFull, Unavailable, UnreadableFile
from stridelab.service.backup.archive import Archive, Progress, file_member, silent, table_member
from stridelab.service.backup.create import Taken
from stridelab.service.backup.locations import Place
from stridelab.service.backup.stored_files import Files
from stridelab.service.backup.table_rows import Connection, Rows, refuse_company
from stridelab.service.samples.recording import SHIPPED_JOBS
from stridelab.service.storage.migrate import engine_of, migrate, revisions, upgrade_on
from stridelab.service.storage.publication import Publication
from stridelab.service.storage.tables import token

_STAGE: Final = "stridelab_restore"
_SPARE_BYTES: Final = 50_000_000
_WAIT_FOR_LOCKS: Final = "10s"
_STARTED_AGAIN: Final = """
    UPDATE job SET state = 'queued', returned = returned + 1, fraction = 0, message = 'restored; waiting again'
     WHERE state = 'running'
"""
"""Their workers are not in the backup; the start that was interrupted does not count."""
_UNDELIVERED: Final = """
    UPDATE job SET queue_id = queued.place - 1000000000
      FROM (SELECT id, row_number() OVER (ORDER BY queue_id NULLS LAST, created_at) AS place
              FROM job WHERE state = 'queued') AS queued
     WHERE queued.id = job.id
"""
"""No delivery has a negative number: workers see that these are lost and deliver them again, in their old order."""


def restore(
    archive: Archive,
    target: Place,
    *,
    with_files: bool = True,
    with_tokens: bool = False,
    replace: bool = False,
    on_progress: Progress = silent,
) -> Taken:
    """Put a backup, checked by ``open_archive``, in the place of what ``target`` holds; returns what it held.

    Without ``with_files``, the files stay where they are. Without ``with_tokens``, API tokens stay those of
    ``target``: a backup from elsewhere would bring tokens that its author knows.

    Raises ``Conflict``: ``service-running`` while anything else uses the database, ``restore-over-data`` where it
    holds more than the samples and ``replace`` was not said; ``UnreadableFile`` (``backup-damaged``,
    ``backup-newer``), ``StorageFull`` (``no-room``), ``Unavailable``.
    """
    manifest = archive.manifest
    if manifest.revision not in revisions():
        raise UnreadableFile(
            "backup-newer", f"The backup has revision {manifest.revision}, which this version does not know."
        )
    if with_files:
        if not manifest.with_files:
            raise UnreadableFile("backup-damaged", "This backup has no files in it.")
        _refuse_small_disk(target.blob_url, manifest.file_bytes)
    migrate(target.database_url)
    engine = engine_of(target.database_url)
    new: list[str] = []
    publication = Publication()
    with Files(target.store()) if with_files else nullcontext() as files:
        try:
            with publication.synchronous_transaction(engine) as transaction:
                driver: Connection = transaction.connection.driver_connection  # type: ignore[assignment]
                named = _rows_in_place(transaction, driver, archive, with_tokens=with_tokens, replace=replace)
                if files is not None:
                    _put_files(files, named, archive, new, on_progress)
        except BaseException as error:
            if publication.in_doubt:
                raise _in_doubt() from error
            if files is not None:
                files.remove(new)
            raise _told(error) from error
        finally:
            engine.dispose()
    return Taken.of(manifest)


def _rows_in_place(
    transaction: sqlalchemy.Connection, driver: Connection, archive: Archive, *, with_tokens: bool, replace: bool
) -> set[str]:
    """The rows, not yet committed; returns the keys of the files that they name."""
    driver.execute(sql.SQL("SET LOCAL lock_timeout = {}").format(sql.Literal(_WAIT_FOR_LOCKS)))
    refuse_company(driver)
    if not replace:
        _refuse_data(driver)
    _stage(transaction, driver, archive)
    _exchange(driver, with_tokens=with_tokens)
    named = Rows(driver).named_files()
    manifest = archive.manifest
    lacking = named - set(manifest.files) - set(manifest.missing) if manifest.with_files else set()
    if lacking:
        raise UnreadableFile("backup-damaged", f"{len(lacking)} files that its rows name are not in the backup.")
    return named


def _told(error: BaseException) -> BaseException:
    """What a failure means to whoever restores."""
    cause = getattr(error, "orig", error)
    if isinstance(cause, psycopg.errors.LockNotAvailable):
        return Conflict("service-running", "Something else uses the tables. Stop the web servers and workers first.")
    if isinstance(cause, psycopg.DataError | psycopg.IntegrityError):
        return UnreadableFile("backup-damaged", _words("its rows do not fit together", cause))
    if isinstance(cause, psycopg.OperationalError):
        return Unavailable("database-unreachable", _words("the database gave up", cause))
    if isinstance(cause, OSError):
        return StorageFull("no-room", f"The files cannot be written: {cause.strerror or cause}. Nothing was restored.")
    return error


def _in_doubt() -> Unavailable:
    return Unavailable(
        "outcome-unknown",
        "The database did not say whether the restore was committed. The files stay; look with: stridelab doctor "
        "--files, and restore again if the recordings are not there.",
    )


def _stage(transaction: sqlalchemy.Connection, driver: Connection, archive: Archive) -> None:
    """The rows, up to date, in a schema of their own."""
    manifest = archive.manifest
    driver.execute(sql.SQL("DROP SCHEMA IF EXISTS {0} CASCADE").format(sql.Identifier(_STAGE)))
    driver.execute(sql.SQL("CREATE SCHEMA {0}").format(sql.Identifier(_STAGE)))
    home = driver.execute("SHOW search_path").fetchone()
    driver.execute(sql.SQL("SET LOCAL search_path TO {}").format(sql.Identifier(_STAGE)))
    upgrade_on(transaction, manifest.revision)
    rows = Rows(driver)
    there = rows.tables()
    promised = {name: table.columns for name, table in manifest.tables.items()}
    if {name: sorted(columns) for name, columns in there.items()} != {n: sorted(c) for n, c in promised.items()}:
        raise UnreadableFile("backup-damaged", "The backup's tables are not those of its revision.")
    with rows.without_references(list(there)):
        for name, table in manifest.tables.items():
            if rows.write(name, table.columns, archive.pieces(table_member(name))) != table.rows:
                raise UnreadableFile("backup-damaged", f"The table {name} has not the rows that the backup lists.")
    upgrade_on(transaction, "head")
    driver.execute(_STARTED_AGAIN)
    driver.execute("UPDATE job SET queue_id = NULL WHERE state <> 'queued'")
    driver.execute(_UNDELIVERED)
    driver.execute("SELECT set_config('search_path', %s, true)", home)


def _exchange(driver: Connection, *, with_tokens: bool) -> None:
    """The staged rows take the place of those in the tables."""
    rows = Rows(driver)
    tables = rows.tables()
    if not with_tokens:
        del tables[token.name]
    with rows.without_references(list(tables)):
        driver.execute(sql.SQL("TRUNCATE {}").format(sql.SQL(", ").join(map(sql.Identifier, tables))))
        driver.execute("DELETE FROM procrastinate_jobs")
        driver.execute("DELETE FROM procrastinate_workers")
        for name, columns in tables.items():
            listed = sql.SQL(", ").join(map(sql.Identifier, columns))
            driver.execute(
                sql.SQL("INSERT INTO {0} ({1}) OVERRIDING SYSTEM VALUE SELECT {1} FROM {2}").format(
                    sql.Identifier(name), listed, sql.Identifier(_STAGE, name)
                )
            )
    driver.execute(
        "SELECT setval(pg_get_serial_sequence('job_event', 'seq'), coalesce(max(seq), 0) + 1, false) FROM job_event"
    )
    driver.execute(sql.SQL("DROP SCHEMA {} CASCADE").format(sql.Identifier(_STAGE)))


def _put_files(files: Files, named: set[str], archive: Archive, new: list[str], on_progress: Progress) -> None:
    """Store what the rows name; ``new`` tells which keys were not there before."""
    for place, key in enumerate(sorted(named)):
        member = archive.manifest.members.get(file_member(key))
        if member is None:
            continue  # gone already when the backup was made
        on_progress(place / len(named), "storing files")
        is_new = not files.has(key)
        if is_new:
            new.append(key)
        files.put(key, archive.pieces(file_member(key)), member.bytes)


def _refuse_data(driver: Connection) -> None:
    held = driver.execute(
        "SELECT (SELECT count(*) FROM recording WHERE NOT bundled) + (SELECT count(*) FROM scenario WHERE NOT bundled)"
        " + (SELECT count(*) FROM subject) + (SELECT count(*) FROM job WHERE id <> ALL(%s))",
        (list(SHIPPED_JOBS),),
    ).fetchone()
    if held and held[0]:
        raise Conflict(
            "restore-over-data",
            "The database holds recordings, subjects, scenarios or jobs already. Make a backup of it, then say "
            "--replace to put the other one in its place.",
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


def _words(what: str, error: BaseException) -> str:
    said = str(error).strip().splitlines()
    return f"Nothing was restored: {what} ({said[0][:200] if said else type(error).__name__})."
