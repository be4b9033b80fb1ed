"""Bodies of uploads: multipart forms whose length is known and whose files are read piece by piece."""

import secrets
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from stridelab.client.calls import API
from stridelab.schemas.recordings import SubjectFields

PATH = f"{API}/recordings"
BATCH_PATH = f"{PATH}/batch"
READING_S = 900.0
"""How long the service may read a bulk upload before it answers."""
PIECE_BYTES = 256 * 1024
ProgressCallback = Callable[[int, int], None]
"""Called with the bytes sent so far and the bytes to send."""


@dataclass(frozen=True)
class Upload:
    """One file with the text fields beside it."""

    path: Path
    subject: SubjectFields = field(default_factory=SubjectFields)
    filename: str | None = None
    boundary: str = field(default_factory=lambda: secrets.token_hex(16))

    def headers(self) -> dict[str, str]:
        """Headers that describe the body."""
        length = len(self._head()) + self.path.stat().st_size + len(self._tail())
        return {"Content-Type": f"multipart/form-data; boundary={self.boundary}", "Content-Length": str(length)}

    def pieces(self, progress: ProgressCallback | None = None) -> Iterator[bytes]:
        """The body, in pieces."""
        yield self._head()
        total, sent = self.path.stat().st_size, 0
        with self.path.open("rb") as source:
            while piece := source.read(PIECE_BYTES):
                yield piece
                sent += len(piece)
                if progress is not None:
                    progress(sent, total)
        yield self._tail()

    async def async_pieces(self, progress: ProgressCallback | None = None) -> AsyncIterator[bytes]:
        """The body, in pieces."""
        for piece in self.pieces(progress):
            yield piece

    def _head(self) -> bytes:
        parts = [
            f'--{self.boundary}\r\nContent-Disposition: form-data; name="{name}"\r\n\r\n{value}\r\n'
            for name, value in self._fields().items()
        ]
        parts.append(f"--{self.boundary}\r\n{_file_part(self.filename or self.path.name)}")
        return "".join(parts).encode("utf-8", "replace")

    def _tail(self) -> bytes:
        return f"\r\n--{self.boundary}--\r\n".encode()

    def _fields(self) -> Mapping[str, str]:
        stated = self.subject.model_dump(exclude_none=True)
        return {("subject_name" if name == "name" else name): str(value) for name, value in stated.items()}


@dataclass(frozen=True)
class BatchUpload:
    """Many files in one form; ``names`` are told to the service, ``table`` is the CSV of the subjects."""

    files: Sequence[tuple[str, Path]]
    table: str | None = None
    boundary: str = field(default_factory=lambda: secrets.token_hex(16))

    def headers(self) -> dict[str, str]:
        """Headers that describe the body."""
        heads = sum(len(self._head(name)) + path.stat().st_size for name, path in self.files)
        length = heads + len(self._table()) + len(self._tail())
        return {"Content-Type": f"multipart/form-data; boundary={self.boundary}", "Content-Length": str(length)}

    def pieces(self, progress: ProgressCallback | None = None) -> Iterator[bytes]:
        """The body, in pieces."""
        yield self._table()
        total, sent = sum(path.stat().st_size for _, path in self.files), 0
        for name, path in self.files:
            yield self._head(name)
            with path.open("rb") as source:
                while piece := source.read(PIECE_BYTES):
                    yield piece
                    sent += len(piece)
                    if progress is not None:
                        progress(sent, total)
        yield self._tail()

    async def async_pieces(self, progress: ProgressCallback | None = None) -> AsyncIterator[bytes]:
        """The body, in pieces."""
        for piece in self.pieces(progress):
            yield piece

    def _table(self) -> bytes:
        if self.table is None:
            return b""
        head = f'--{self.boundary}\r\nContent-Disposition: form-data; name="subjects"'
        return f"{head}\r\n\r\n{self.table}".encode()

    def _head(self, name: str) -> bytes:
        # what stands before the first boundary is no part, so every file may begin with an end of line
        return f"\r\n--{self.boundary}\r\n{_file_part(name)}".encode("utf-8", "replace")

    def _tail(self) -> bytes:
        return f"\r\n--{self.boundary}--\r\n".encode()


def _file_part(claimed: str) -> str:
    """Headers of a part with a file."""
    name = claimed.replace("\\", "").replace('"', "%22")
    name = "".join(character for character in name if character.isprintable())
    disposition = f'Content-Disposition: form-data; name="file"; filename="{name}"'
    return f"{disposition}\r\nContent-Type: application/octet-stream\r\n\r\n"
