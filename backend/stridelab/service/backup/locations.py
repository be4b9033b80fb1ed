"""Which database and which store a backup is made of: those that are configured, or the embedded ones of a folder."""

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
    """A database and a store of files, the latter with the options that reach it."""

    database_url: str
    blob_url: str
    blob_options: Mapping[str, str]

    def store(self) -> BlobStore:
        """The store, opened."""
        return BlobStore.from_url(self.blob_url, self.blob_options)


@contextmanager
def place(settings: Settings, *, alone: bool, create: bool = False) -> Iterator[Place]:
    """The service's database, started for the occasion where it is an embedded one that does not run.

    ``alone`` refuses while the service runs (``data-folder-in-use``), ``create`` makes a cluster where there is none;
    otherwise raises ``NotFound`` (``no-data``). Raises ``Unavailable`` as ``EmbeddedPostgres.start`` does.
    """
    url = database_url(settings)
    if url is not None:
        yield Place(url, settings.blob_address, settings.blob_options)
        return
    folder = settings.data_folder
    if not (folder / "postgres.json").exists() and not create:
        raise NotFound("no-data", f"There is no database in {folder}; STRIDELAB_DATA_DIR names the folder.")
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
