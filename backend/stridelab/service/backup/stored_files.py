"""Copies stored files to and from an archive, for programs without an event loop."""

import asyncio
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

from stridelab.errors import NotFound
from stridelab.service.backup.archive import Packer, file_member
from stridelab.service.storage.blobs import BlobStore


class Files:
    """Context manager: synchronous access to a blob store."""

    def __init__(self, store: BlobStore) -> None:
        self._store = store
        self._runner = asyncio.Runner()

    def __enter__(self) -> "Files":  # noqa: PYI034 (the tests' type checks know no Self here)
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._runner.close()

    def pack(self, key: str, packer: Packer) -> bool:
        """Copy a file into the archive; False if it is missing."""
        return self._runner.run(self._pack(key, packer))

    async def _pack(self, key: str, packer: Packer) -> bool:
        pieces = self._store.stream(key)
        try:
            first = await anext(pieces, b"")
        except NotFound:
            return False
        with packer.member(file_member(key)) as append:
            append(first)
            async for piece in pieces:
                append(piece)
        return True

    def has(self, key: str) -> bool:
        """Whether the file exists."""
        return self._runner.run(self._store.exists(key))

    def put(self, key: str, pieces: Iterator[bytes], size: int) -> None:
        """Store a file unless one with this key and size exists: keys are never reused for other content."""
        stored = self._runner.run(self._store.info(key))
        if stored is not None and stored.bytes == size:
            return
        with tempfile.NamedTemporaryFile(prefix="stridelab-restore-") as draft:
            for piece in pieces:
                draft.write(piece)
            draft.flush()
            self._runner.run(self._store.put_file(key, Path(draft.name)))

    def remove(self, keys: list[str]) -> None:
        """Delete files; missing ones are ignored."""
        for key in keys:
            self._runner.run(self._store.delete(key))
