"""``stridelab doctor --files``: reads every stored file that a row refers to and verifies its hash."""

import asyncio
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import psycopg

from stridelab.errors import NotFound, Unavailable
from stridelab.service.backup.archive import Progress, ignore_progress
from stridelab.service.backup.table_rows import TableRows, open_snapshot
from stridelab.service.storage.blobs import BlobStore, hash_in_key

_FILES: Final = """
    SELECT 'recording ' || id || ', the uploaded file', blob_key, sha256, bytes FROM recording
    UNION ALL SELECT 'recording ' || id || ', its tracks', tracks_key, NULL, NULL FROM recording
    UNION ALL SELECT 'robot ' || name || ', its description', bundle_key, NULL, NULL FROM robot
    UNION ALL SELECT 'robot ' || name || ', its meshes', links_key, NULL, NULL FROM robot
    UNION ALL SELECT 'robot ' || name || ', its densities', learned_key, NULL, NULL FROM robot
               WHERE learned_key IS NOT NULL
    UNION ALL SELECT 'job ' || id || ', ' || (artifact->>'name'), blob_prefix || '/' || (artifact->>'name'),
                     artifact->>'sha256', (artifact->>'bytes')::bigint
                FROM job, jsonb_array_elements(job.result->'artifacts') AS artifact WHERE blob_prefix IS NOT NULL
    ORDER BY 1
"""


@dataclass(frozen=True)
class ReferencedFile:
    """A stored file that a row refers to: its description, its key, and its hash and size according to the row."""

    description: str
    key: str
    sha256: str | None
    bytes: int | None


@dataclass(frozen=True)
class VerificationResult:
    """Result of a verification; ``without_hash`` counts files verified by size only, as they have no stored hash."""

    files: int
    bytes: int
    without_hash: int
    missing: tuple[ReferencedFile, ...]
    damaged: tuple[ReferencedFile, ...]

    @property
    def ok(self) -> bool:
        """Whether no file is missing or damaged."""
        return not self.missing and not self.damaged


def verify_stored_files(
    database_url: str, store: BlobStore, on_progress: Progress = ignore_progress
) -> VerificationResult:
    """Read and verify all stored files while none can be removed; the service may run.

    Raises ``Unavailable`` (``database-unreachable``, ``storage-unavailable``).
    """
    try:
        with open_snapshot(database_url) as rows:
            return asyncio.run(_verify_all(list(_referenced_files(rows)), store, on_progress))
    except psycopg.OperationalError as error:
        raise Unavailable("database-unreachable", "The database does not respond.") from error


def _referenced_files(rows: TableRows) -> Iterator[ReferencedFile]:
    for of, key, sha256, size in rows.connection.execute(_FILES):
        yield ReferencedFile(of, key, sha256 or hash_in_key(key), size)


async def _verify_all(referenced: list[ReferencedFile], store: BlobStore, on_progress: Progress) -> VerificationResult:
    read_bytes, missing, damaged = 0, [], []
    for place, one in enumerate(referenced):
        on_progress(place / len(referenced), f"reading {one.description}")
        try:
            info = await store.info(one.key)
            sha256 = await store.compute_sha256(one.key)
        except NotFound:
            missing.append(one)
            continue
        size = 0 if info is None else info.bytes
        read_bytes += size
        if one.sha256 not in (None, sha256) or one.bytes not in (None, size):
            damaged.append(one)
    without = sum(one.sha256 is None for one in referenced)
    return VerificationResult(len(referenced), read_bytes, without, tuple(missing), tuple(damaged))
