"""Which database and which store a backup is made of: those that are configured, or the embedded ones of a folder."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from stridelab.errors import NotFound, Unavailable
from stridelab.service.embedded_postgres import EmbeddedPostgres
from stridelab.service.settings import Settings
from stridelab.service.storage.database import database_url


@dataclass(frozen=True)
class Place:
    """A database and a store of files."""

    database_url: str
    blob_url: str


def blob_url(settings: Settings) -> str:
    """Where the files are."""
    return settings.blob_url or (settings.data_folder / "blobs").as_uri()


@contextmanager
def place(settings: Settings, *, alone: bool, create: bool = False) -> Iterator[Place]:
    """The service's database, started for the occasion where it is an embedded one that does not run.

    ``alone`` refuses while the service runs (``data-folder-in-use``), ``create`` makes a cluster where there is none;
    otherwise raises ``NotFound`` (``no-data``). Raises ``Unavailable`` as ``EmbeddedPostgres.start`` does.
    """
    url = database_url(settings)
    if url is not None:
        yield Place(url, blob_url(settings))
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
        yield Place(url, blob_url(settings))
    finally:
        database.stop()


def running_url(folder: Path) -> str | None:
    """Address of the embedded server of ``folder``, where one runs."""
    try:
        known = json.loads((folder / "postgres.json").read_text(encoding="utf-8"))
        socket = Path(str(known["socket"]))
        runs = any(socket.glob(".s.PGSQL.*[0-9]"))
    except (OSError, ValueError, KeyError):
        return None
    return f"postgresql://postgres@/postgres?host={socket}" if runs else None
