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
class Place:
    """A database and a file store with its connection options."""

    database_url: str
    blob_url: str
    blob_options: Mapping[str, str]

    def store(self) -> BlobStore:
        """Open the file store."""
        return BlobStore.from_url(self.blob_url, self.blob_options)


@contextmanager
def place(settings: Settings, *, alone: bool, create: bool = False) -> Iterator[Place]:
    """The service's database and store; starts an embedded database that does not run for the block.

    ``alone`` requires that the service does not run (``data-folder-in-use``); ``create`` creates a missing cluster
    instead of raising ``NotFound`` (``no-data``). Raises ``Unavailable`` as ``EmbeddedPostgres.start`` does.
    """
    url = database_url(settings)
    if url is not None:
        yield Place(url, settings.blob_address, settings.blob_options)
        return
    folder = settings.data_folder
    if not (folder / "postgres.json").exists() and not create:
        raise NotFound("no-data", f"There is no database in {folder}; set STRIDELAB_DATA_DIR to the data folder.")
    database = EmbeddedPostgres(folder, settings.pg_bin)
    try:
        try:
            url = database.start()
        except Unavailable as error:
            url = None if alone or error.code != "data-folder-in-use" else running_url(folder)
            if url is None:
                raise
        yield Place(url, settings.blob_address, settings.blob_options)
    finally:
        database.stop()
