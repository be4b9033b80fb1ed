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
from stridelab.service.backup.archive import FORMAT, Manifest, Packer, Progress, silent, table_member
from stridelab.service.backup.stored_files import Files
from stridelab.service.backup.table_rows import Rows, snapshot
from stridelab.service.storage.blobs import BlobStore
from stridelab.service.storage.migrate import present_revision


@dataclass(frozen=True)
class Taken:
    """Contents of a backup, and the files that rows refer to but that were missing."""

    rows: dict[str, int]
    files: int
    bytes: int
    missing: tuple[str, ...]

    @staticmethod
    def of(manifest: Manifest) -> "Taken":
        """The counts of a manifest."""
        rows = {name: table.rows for name, table in manifest.tables.items()}
        return Taken(rows, len(manifest.files), manifest.file_bytes, tuple(manifest.missing))


def take(
    database_url: str,
    store: BlobStore | None,
    target: Path,
    *,
    force: bool = False,
    on_progress: Progress = silent,
) -> Taken:
    """Write the backup ``target``; without ``store`` the rows only.

    Raises as ``ArchiveWriter`` does, ``Conflict`` (``nothing-to-back-up``) if the database has no tables,
    ``Unavailable`` (``database-unreachable``, ``storage-unavailable``).
    """
    try:
        revision = present_revision(database_url)
        if revision is None:
            raise Conflict("nothing-to-back-up", "This database has no tables of stridelab.")
        with Packer(target, force=force) as packer, snapshot(database_url) as rows:
            missing = None if store is None else _pack_files(packer, rows, store, on_progress)
            manifest = _pack_rows(packer, rows, revision, missing)
            packer.finish(manifest)
    except psycopg.OperationalError as error:
        raise Unavailable("database-unreachable", "The database does not respond.") from error
    return Taken.of(manifest)


def _pack_files(packer: Packer, rows: Rows, store: BlobStore, on_progress: Progress) -> list[str]:
    """Copy the files that rows refer to; returns the keys of missing ones."""
    named = sorted(rows.named_files())
    missing = []
    with Files(store) as files:
        for number, key in enumerate(named):
            on_progress(number / len(named), "copying files")
            if not files.pack(key, packer):
                missing.append(key)
    return missing


def _pack_rows(packer: Packer, rows: Rows, revision: str, missing: list[str] | None) -> Manifest:
    tables = {}
    for table, columns in rows.tables().items():
        with packer.member(table_member(table), compress=True) as append:
            tables[table] = rows.read(table, columns, append)
    return Manifest(
        format=FORMAT,
        kind="stridelab-backup",
        made_at=datetime.now(UTC).isoformat(timespec="seconds"),
        program=__version__,
        revision=revision,
        with_files=missing is not None,
        tables=tables,
        members=packer.members,
        missing=missing or [],
    )
