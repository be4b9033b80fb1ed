"""``stridelab adopt``: copies the data of an embedded service into the configured database and store."""

import tempfile
from pathlib import Path

from stridelab.errors import InvalidInput
from stridelab.service.backup.archive import Progress, ignore_progress, open_archive
from stridelab.service.backup.create import BackupContents, create_backup
from stridelab.service.backup.locations import BackupLocation, open_location
from stridelab.service.backup.restore import restore_backup
from stridelab.service.settings import Settings


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
