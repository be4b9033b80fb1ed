"""The body of an upload: a multipart form whose length is known and whose file is read piece by piece."""

import secrets
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from stridelab.client.calls import API
from stridelab.schemas.recordings import SubjectFields

PATH = f"{API}/recordings"
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
        name = (self.filename or self.path.name).replace("\\", "").replace('"', "%22")
        name = "".join(character for character in name if character.isprintable())
        parts.append(
            f'--{self.boundary}\r\nContent-Disposition: form-data; name="file"; filename="{name}"\r\n'
            "Content-Type: application/octet-stream\r\n\r\n"
        )
        return "".join(parts).encode("utf-8", "replace")

    def _tail(self) -> bytes:
        return f"\r\n--{self.boundary}--\r\n".encode()

    def _fields(self) -> Mapping[str, str]:
        stated = self.subject.model_dump(exclude_none=True)
        return {("subject_name" if name == "name" else name): str(value) for name, value in stated.items()}
