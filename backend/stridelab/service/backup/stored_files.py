"""Copies stored files to and from an archive, for programs without an event loop."""

import asyncio
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

from stridelab.errors import NotFound
from stridelab.service.backup.archive import ArchiveWriter, file_member
from stridelab.service.storage.blobs import BlobStore


class StoredFiles:
    """Context manager: synchronous access to a blob store."""

    def __init__(self, store: BlobStore) -> None:
        self._store = store
        self._runner = asyncio.Runner()

    def __enter__(self) -> "StoredFiles":  # noqa: PYI034 (the tests' type checks know no Self here)
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._runner.close()

    def pack_file(self, key: str, packer: ArchiveWriter) -> bool:
        """Copy a file into the archive; False if it is missing."""
        return self._runner.run(self._copy_to_archive(key, packer))

    async def _copy_to_archive(self, key: str, packer: ArchiveWriter) -> bool:
        pieces = self._store.stream(key)
        try:
            first = await anext(pieces, b"")
        except NotFound:
            return False
        with packer.add_member(file_member(key)) as append:
            append(first)
            async for piece in pieces:
                append(piece)
        return True

    def has_file(self, key: str) -> bool:
        """Whether the file exists."""
        return self._runner.run(self._store.exists(key))

    def store_file(self, key: str, pieces: Iterator[bytes], size: int) -> None:
        """Store a file unless one with this key and size exists: keys are never reused for other content."""
        stored = self._runner.run(self._store.info(key))
        if stored is not None and stored.bytes == size:
            return
        with tempfile.NamedTemporaryFile(prefix="stridelab-restore-") as draft:
            for piece in pieces:
                draft.write(piece)
            draft.flush()
            self._runner.run(self._store.put_file(key, Path(draft.name)))

    def delete_files(self, keys: list[str]) -> None:
        """Delete files; missing ones are ignored."""
        for key in keys:
            self._runner.run(self._store.delete(key))
