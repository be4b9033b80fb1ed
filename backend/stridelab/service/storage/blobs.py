"""Blob storage in a folder or in S3, selected by URL (obstore).

Keys consist of ids and fixed names, never of user input; invalid keys are rejected, so that no key can point outside
the store. A key may end in the SHA-256 of its content (``hash_in_key``), which is then verified when the blob is read.
"""

import asyncio
import hashlib
import re
from collections.abc import AsyncIterator, Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Final, cast
from urllib.parse import unquote, urlsplit

import obstore
from obstore.exceptions import BaseError
from obstore.store import LocalStore, ObjectStore, from_url

from stridelab.errors import InvalidInput, NotFound, StorageFull, Unavailable, UnreadableFile, is_disk_full
from stridelab.service.storage.local_files import DISK, FileSystem, sync_durably, write_durably

if TYPE_CHECKING:
    from obstore.store import ClientConfig, RetryConfig, S3Config

CHUNK_BYTES: Final = 1 << 20
_KEY: Final = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]*(/[A-Za-z0-9_-][A-Za-z0-9._-]*)*")
_MAX_KEY_LENGTH: Final = 400
_HASH_IN_KEY: Final = re.compile(r"[/-]([0-9a-f]{64})(?:\.[a-z0-9]+)?$")

_RETRY: "Final[RetryConfig]" = {"max_retries": 4, "retry_timeout": timedelta(seconds=10)}
"""Fail within seconds if the store is unavailable (the default is minutes): clients may be waiting, and jobs have their
own retries, which can be cancelled."""


@dataclass(frozen=True)
class BlobInfo:
    """A stored file: its key, its size, and when it was written."""

    key: str
    bytes: int
    modified_at: datetime


@dataclass(frozen=True)
class BlobStore:
    """Blob store, created by ``from_url``.

    Operations raise ``Unavailable`` (``storage-unavailable``) if the store fails and ``StorageFull`` (``storage-full``)
    if it is full. ``folder`` is the root of a local store; None for an object store.
    """

    backend: ObjectStore
    folder: Path | None = None
    system: FileSystem = DISK

    @staticmethod
    def from_url(url: str, options: Mapping[str, str] | None = None) -> "BlobStore":
        """Store at ``file:///folder`` (created if missing) or ``s3://bucket/prefix``.

        ``options`` are obstore's S3 options (``endpoint``, ``access_key_id``, ``secret_access_key``, ...); missing ones
        come from the environment (``AWS_ENDPOINT``, ...). Raises ``InvalidInput`` (``blob-url-invalid``,
        ``blob-credentials-invalid``).
        """
        parts = urlsplit(url)
        if parts.scheme == "file" and parts.netloc in ("", "localhost") and parts.path:
            folder = Path(unquote(parts.path))
            folder.mkdir(parents=True, exist_ok=True)
            return BlobStore(LocalStore(folder, automatic_cleanup=True), folder)
        if parts.scheme == "s3" and parts.netloc:
            return BlobStore(_object_store(url, dict(options or {})))
        raise InvalidInput("blob-url-invalid", "STRIDELAB_BLOB_URL must be file:///folder or s3://bucket/prefix.")

    async def put_file(self, key: str, path: Path) -> int:
        """Store a file under ``key``, atomically and durably; returns its size in bytes.

        In a folder the file is then synchronised to disk (``local_files``); an object store has confirmed the upload
        and reports the size of the object: some answer 200 and store nothing.
        """
        _require_key(key)
        size = path.stat().st_size
        try:
            if self.folder is not None:
                await asyncio.to_thread(write_durably, self.folder, key, path, self.system)
            else:
                await obstore.put_async(self.backend, key, path, chunk_size=5 * CHUNK_BYTES, max_concurrency=2)
                stored = await self.info(key)
                if stored is None or stored.bytes != size:
                    raise Unavailable("storage-unavailable", "The file storage did not store a file that it confirmed.")
        except (BaseError, OSError) as error:
            raise _storage_error(error) from error
        return size

    async def keep_or_replace(self, key: str, path: Path, sha256: str) -> bool:
        """Store ``path`` under ``key`` unless an undamaged file with this content is there; returns whether it did."""
        try:
            if await self.compute_sha256(key) == sha256:
                if self.folder is not None:  # its writer may have been killed before it was synchronised to disk
                    await asyncio.to_thread(sync_durably, self.folder, key, self.system)
                return False
        except NotFound:
            pass
        except OSError as error:
            raise _storage_error(error) from error
        await self.put_file(key, path)
        return True

    async def get_file(self, key: str, path: Path, sha256: str | None = None) -> int:
        """Write the blob into ``path``; returns its size in bytes.

        Raises ``NotFound`` (``blob-not-found``), ``UnreadableFile`` (``stored-file-damaged``) if the content's SHA-256
        differs from ``sha256``, or else from the hash in the key.
        """
        written, digest = 0, hashlib.sha256()
        with path.open("wb") as file:
            async for chunk in self.stream(key):
                written += file.write(chunk)
                digest.update(chunk)
        if (sha256 or hash_in_key(key)) not in (None, digest.hexdigest()):
            path.unlink()
            raise damaged_file_error(key)
        return written

    async def compute_sha256(self, key: str) -> str:
        """SHA-256 of the blob. Raises ``NotFound`` (``blob-not-found``)."""
        digest = hashlib.sha256()
        async for chunk in self.stream(key):
            digest.update(chunk)
        return digest.hexdigest()

    async def stream(self, key: str) -> AsyncIterator[bytes]:
        """The blob in pieces. Raises ``NotFound`` (``blob-not-found``).

        An object store must send as many bytes as it lists: some answer 200 with nothing.
        """
        _require_key(key)
        try:
            response = await obstore.get_async(self.backend, key)
            listed = await self.info(key) if self.folder is None else None
            sent = 0
            async for chunk in response.stream(min_chunk_size=CHUNK_BYTES):
                sent += len(chunk)
                yield bytes(chunk)
            if listed is not None and sent != listed.bytes:
                raise Unavailable("storage-unavailable", f"The file storage sent {sent} of {listed.bytes} bytes.")
        except FileNotFoundError as error:
            raise _missing_file_error(key) from error
        except (BaseError, OSError) as error:
            raise _storage_error(error) from error

    async def info(self, key: str) -> BlobInfo | None:
        """Size and modification time of a blob; None if there is none."""
        _require_key(key)
        try:
            meta = await obstore.head_async(self.backend, key)
        except FileNotFoundError:
            return None
        except (BaseError, OSError) as error:
            raise _storage_error(error) from error
        return BlobInfo(meta["path"], meta["size"], meta["last_modified"])

    async def exists(self, key: str) -> bool:
        """Whether there is a blob with this key."""
        return await self.info(key) is not None

    async def list_prefix(self, prefix: str) -> AsyncIterator[BlobInfo]:
        """All blobs below ``prefix`` (whole path segments)."""
        _require_key(prefix)
        try:
            async for batch in obstore.list(self.backend, prefix=f"{prefix}/"):
                for meta in batch:
                    yield BlobInfo(meta["path"], meta["size"], meta["last_modified"])
        except (BaseError, OSError) as error:
            raise _storage_error(error) from error

    async def delete(self, key: str) -> None:
        """Delete one blob; no effect if it is missing."""
        _require_key(key)
        await self._delete_keys([key])

    async def delete_prefix(self, prefix: str) -> int:
        """Delete everything below ``prefix`` (whole path segments); returns how many blobs that were."""
        keys = [info.key async for info in self.list_prefix(prefix)]
        await self._delete_keys(keys)
        return len(keys)

    async def _delete_keys(self, keys: list[str]) -> None:
        for start in range(0, len(keys), 500):
            try:
                await obstore.delete_async(self.backend, keys[start : start + 500])
            except FileNotFoundError:
                continue  # already deleted by another process
            except (BaseError, OSError) as error:
                raise _storage_error(error) from error


def _object_store(url: str, options: dict[str, str]) -> ObjectStore:
    # an explicit http:// endpoint is allowed: a store inside the operator's network
    client: ClientConfig = {"allow_http": True} if options.get("endpoint", "").startswith("http://") else {}
    try:
        return from_url(url, config=cast("S3Config", options), client_options=client, retry_config=_RETRY)
    except BaseError as error:
        raise InvalidInput(
            "blob-credentials-invalid",
            "Cannot connect to the object store with the options in STRIDELAB_BLOB_CREDENTIALS_FILE: "
            f"{', '.join(sorted(options)) or 'none'}.",
        ) from error


def is_key(key: str) -> bool:
    """Whether ``key`` is a valid blob key."""
    return len(key) <= _MAX_KEY_LENGTH and _KEY.fullmatch(key) is not None


def hash_in_key(key: str) -> str | None:
    """SHA-256 at the end of a key, such as that of an upload; None if the key has none."""
    match = _HASH_IN_KEY.search(key)
    return match[1] if match else None


def damaged_file_error(key: str) -> UnreadableFile:
    """Error of a stored file whose content has changed."""
    return UnreadableFile(
        "stored-file-damaged",
        f"The stored file {key.rsplit('/', 1)[-1]} is damaged: its content differs from what was stored. "
        "Upload the same file again to repair it.",
    )


def _require_key(key: str) -> None:
    if not is_key(key):
        raise InvalidInput("blob-key-invalid", "Invalid name of a stored file.")


def _missing_file_error(key: str) -> NotFound:
    return NotFound("blob-not-found", f"The stored file {key.rsplit('/', 1)[-1]} is gone.")


def _storage_error(error: Exception) -> Unavailable:
    if is_disk_full(error):
        return StorageFull("storage-full", "The file storage is full; nothing was stored. Free some space.")
    return Unavailable("storage-unavailable", f"The file storage does not respond ({type(error).__name__}).")
