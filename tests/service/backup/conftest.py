from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from stridelab.service.backup.archive import open_archive
from stridelab.service.backup.create import BackupContents, create_backup
from stridelab.service.backup.locations import BackupLocation
from stridelab.service.backup.restore import restore_backup
from stridelab.service.storage.blobs import BlobStore
from support.service.database import TestDatabases
from support.service.stored_rows import fill_tables


@pytest.fixture(scope="module")
def backup(postgres: TestDatabases, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A backup of a database with something in every table."""
    folder = tmp_path_factory.mktemp("source")
    with postgres.fresh() as url:
        fill_tables(url, folder / "blobs")
        create_backup(url, BlobStore.from_url((folder / "blobs").as_uri()), folder / "lab.backup")
    return folder / "lab.backup"


@pytest.fixture
def empty(postgres: TestDatabases) -> Iterator[str]:
    """A database without tables."""
    with postgres.fresh(migrated=False) as url:
        yield url


@pytest.fixture
def put_back(tmp_path: Path) -> Callable[..., BackupContents]:
    """Restore a backup into a database and the folder ``blobs`` of the test."""

    def run(path: Path, url: str, **options: bool) -> BackupContents:
        with open_archive(path) as archive:
            return restore_backup(archive, BackupLocation(url, (tmp_path / "blobs").as_uri(), {}), **options)

    return run
