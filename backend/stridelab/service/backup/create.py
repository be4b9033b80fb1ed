"""``stridelab backup``: a snapshot of the rows and all files that they refer to, while the service runs.

Stored files are never changed, only added and removed, and none is removed during a backup: every file that the rows of
the snapshot refer to can be copied at any time after it. Files that were missing before are reported.
"""

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import psycopg

from stridelab import __version__
from stridelab.errors import Conflict, Unavailable
from stridelab.service.backup.archive import (
    FORMAT_VERSION,
    ArchiveWriter,
    Manifest,
    Progress,
    ignore_progress,
    table_member,
)
from stridelab.service.backup.stored_files import StoredFiles
from stridelab.service.backup.table_rows import TableRows, open_snapshot
from stridelab.service.storage.blobs import BlobStore
from stridelab.service.storage.migrate import present_revision


@dataclass(frozen=True)
class BackupContents:
    """Contents of a backup, and the files that rows refer to but that were missing."""

    rows: dict[str, int]
    files: int
    bytes: int
    missing: tuple[str, ...]

    @staticmethod
    def from_manifest(manifest: Manifest) -> "BackupContents":
        """The counts of a manifest."""
        rows = {name: table.rows for name, table in manifest.tables.items()}
        return BackupContents(rows, len(manifest.file_keys), manifest.file_bytes, tuple(manifest.missing))


def create_backup(
    database_url: str,
    store: BlobStore | None,
    target: Path,
    *,
    force: bool = False,
    on_progress: Progress = ignore_progress,
) -> BackupContents:
    """Write the backup ``target``; without ``store`` the rows only.

    Raises as ``ArchiveWriter`` does, ``Conflict`` (``nothing-to-back-up``) if the database has no tables,
    ``Unavailable`` (``database-unreachable``, ``storage-unavailable``).
    """
    try:
        revision = present_revision(database_url)
        if revision is None:
            raise Conflict("nothing-to-back-up", "This database has no tables of stridelab.")
        with ArchiveWriter(target, force=force) as packer, open_snapshot(database_url) as rows:
            missing = None if store is None else _pack_files(packer, rows, store, on_progress)
            manifest = _pack_rows(packer, rows, revision, missing)
            packer.finish_archive(manifest)
    except psycopg.OperationalError as error:
        raise Unavailable("database-unreachable", "The database does not respond.") from error
    return BackupContents.from_manifest(manifest)


def _pack_files(packer: ArchiveWriter, rows: TableRows, store: BlobStore, on_progress: Progress) -> list[str]:
    """Copy the files that rows refer to; returns the keys of missing ones."""
    named = sorted(rows.referenced_files())
    missing = []
    with StoredFiles(store) as files:
        for number, key in enumerate(named):
            on_progress(number / len(named), "copying files")
            if not files.pack_file(key, packer):
                missing.append(key)
    return missing


def _pack_rows(packer: ArchiveWriter, rows: TableRows, revision: str, missing: list[str] | None) -> Manifest:
    tables = {}
    for table, columns in rows.table_columns().items():
        with packer.add_member(table_member(table), compress=True) as append:
            tables[table] = rows.copy_rows_out(table, columns, append)
    return Manifest(
        format=FORMAT_VERSION,
        kind="stridelab-backup",
        made_at=datetime.now(UTC).isoformat(timespec="seconds"),
        program=__version__,
        revision=revision,
        with_files=missing is not None,
        tables=tables,
        members=packer.members,
        missing=missing or [],
    )
