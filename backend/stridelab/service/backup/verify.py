"""``stridelab doctor --files``: reads every stored file that a row refers to and verifies its hash."""

import asyncio
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import psycopg

from stridelab.errors import NotFound, Unavailable
from stridelab.service.backup.archive import Progress, silent
from stridelab.service.backup.table_rows import Rows, snapshot
from stridelab.service.storage.blobs import BlobStore, named_hash

_FILES: Final = """
    SELECT 'recording ' || id || ', the uploaded file', blob_key, sha256, bytes FROM recording
    UNION ALL SELECT 'recording ' || id || ', its tracks', tracks_key, NULL, NULL FROM recording
    UNION ALL SELECT 'job ' || id || ', ' || (artifact->>'name'), blob_prefix || '/' || (artifact->>'name'),
                     artifact->>'sha256', (artifact->>'bytes')::bigint
                FROM job, jsonb_array_elements(job.result->'artifacts') AS artifact WHERE blob_prefix IS NOT NULL
    ORDER BY 1
"""


@dataclass(frozen=True)
class NamedFile:
    """A stored file that a row refers to: its description, its key, and its hash and size according to the row."""

    of: str
    key: str
    sha256: str | None
    bytes: int | None


@dataclass(frozen=True)
class Verified:
    """Result of a verification; ``without_hash`` counts files verified by size only, as they have no stored hash."""

    files: int
    bytes: int
    without_hash: int
    missing: tuple[NamedFile, ...]
    damaged: tuple[NamedFile, ...]

    @property
    def ok(self) -> bool:
        """Whether no file is missing or damaged."""
        return not self.missing and not self.damaged


def verify(database_url: str, store: BlobStore, on_progress: Progress = silent) -> Verified:
    """Read and verify all stored files while none can be removed; the service may run.

    Raises ``Unavailable`` (``database-unreachable``, ``storage-unavailable``).
    """
    try:
        with snapshot(database_url) as rows:
            return asyncio.run(_verify(list(_named(rows)), store, on_progress))
    except psycopg.OperationalError as error:
        raise Unavailable("database-unreachable", "The database does not respond.") from error


def _named(rows: Rows) -> Iterator[NamedFile]:
    for of, key, sha256, size in rows.connection.execute(_FILES):
        yield NamedFile(of, key, sha256 or named_hash(key), size)


async def _verify(named: list[NamedFile], store: BlobStore, on_progress: Progress) -> Verified:
    read_bytes, missing, damaged = 0, [], []
    for place, one in enumerate(named):
        on_progress(place / len(named), f"reading {one.of}")
        try:
            info = await store.info(one.key)
            sha256 = await store.sha256(one.key)
        except NotFound:
            missing.append(one)
            continue
        size = 0 if info is None else info.bytes
        read_bytes += size
        if one.sha256 not in (None, sha256) or one.bytes not in (None, size):
            damaged.append(one)
    without = sum(one.sha256 is None for one in named)
    return Verified(len(named), read_bytes, without, tuple(missing), tuple(damaged))
