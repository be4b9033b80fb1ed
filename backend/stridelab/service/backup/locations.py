"""Database and store of a backup: the configured ones, or the embedded ones of a data folder."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

from stridelab.errors import NotFound, Unavailable
from stridelab.service.postgres.embedded import EmbeddedPostgres, running_url
from stridelab.service.settings import Settings
from stridelab.service.storage.blobs import BlobStore
from stridelab.service.storage.database import database_url


@dataclass(frozen=True)
class BackupLocation:
    """A database and a file store with its connection options."""

    database_url: str
    blob_url: str
    blob_options: Mapping[str, str]

    def open_store(self) -> BlobStore:
        """Open the file store."""
        return BlobStore.from_url(self.blob_url, self.blob_options)


@contextmanager
def open_location(settings: Settings, *, require_stopped: bool, create: bool = False) -> Iterator[BackupLocation]:
    """The service's database and store; starts an embedded database that does not run for the block.

    ``require_stopped`` requires that the service does not run (``data-folder-in-use``); ``create`` creates a missing
    cluster instead of raising ``NotFound`` (``no-data``). Raises ``Unavailable`` as ``EmbeddedPostgres.start`` does.
    """
    url = database_url(settings)
    if url is not None:
        yield BackupLocation(url, settings.blob_address, settings.blob_options)
        return
    folder = settings.data_folder
    if not (folder / "postgres.json").exists() and not create:
        raise NotFound("no-data", f"There is no database in {folder}; set STRIDELAB_DATA_DIR to the data folder.")
    database = EmbeddedPostgres(folder, settings.pg_bin)
    try:
        try:
            url = database.start()
        except Unavailable as error:
            url = None if require_stopped or error.code != "data-folder-in-use" else running_url(folder)
            if url is None:
                raise
        yield BackupLocation(url, settings.blob_address, settings.blob_options)
    finally:
        database.stop()
