"""Request bodies of uploads: multipart forms of known length, whose files are read in pieces."""

import secrets
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from stridelab.client.endpoints import API
from stridelab.client.errors import ProblemError
from stridelab.schemas.base import Problem
from stridelab.schemas.jobs import Job
from stridelab.schemas.population import ReadBatchSummary, RecordingBatch
from stridelab.schemas.recordings import Recording, SubjectFields

PATH = f"{API}/recordings"
BATCH_PATH = f"{PATH}/batch"
BATCH_TIMEOUT_S = 900.0
"""Timeout of a bulk upload: older services read all files before they answer, newer ones answer with a job."""
PIECE_BYTES = 256 * 1024
ProgressCallback = Callable[[int, int], None]
"""Called with the number of bytes sent so far and in total."""


@dataclass(frozen=True)
class Upload:
    """Form of a single upload: one file and the text fields."""

    path: Path
    subject: SubjectFields = field(default_factory=SubjectFields)
    filename: str | None = None
    session_id: str | None = None
    boundary: str = field(default_factory=lambda: secrets.token_hex(16))

    def headers(self) -> dict[str, str]:
        """Headers that describe the body."""
        return _form_headers(self.boundary, len(self._part_head()) + self.path.stat().st_size)

    def pieces(self, progress: ProgressCallback | None = None) -> Iterator[bytes]:
        """The body, in pieces."""
        return _form_pieces(b"", [(self._part_head(), self.path)], self.boundary, progress)

    def _part_head(self) -> bytes:
        parts = [
            f'--{self.boundary}\r\nContent-Disposition: form-data; name="{name}"\r\n\r\n{value}\r\n'
            for name, value in self._text_fields().items()
        ]
        parts.append(f"--{self.boundary}\r\n{_file_part(self.filename or self.path.name)}")
        return "".join(parts).encode("utf-8", "replace")

    def _text_fields(self) -> Mapping[str, str]:
        stated = self.subject.model_dump(exclude_none=True)
        fields = {("subject_name" if name == "name" else name): str(value) for name, value in stated.items()}
        return fields if self.session_id is None else {**fields, "session_id": self.session_id}


@dataclass(frozen=True)
class BatchUpload:
    """Form of a bulk upload: ``files`` are pairs of name and path, ``table`` is the subject table (CSV)."""

    files: Sequence[tuple[str, Path]]
    table: str | None = None
    boundary: str = field(default_factory=lambda: secrets.token_hex(16))

    def headers(self) -> dict[str, str]:
        """Headers that describe the body."""
        parts = sum(len(self._part_head(name)) + path.stat().st_size for name, path in self.files)
        return _form_headers(self.boundary, len(self._table_part()) + parts)

    def pieces(self, progress: ProgressCallback | None = None) -> Iterator[bytes]:
        """The body, in pieces."""
        return _form_pieces(
            self._table_part(), [(self._part_head(name), path) for name, path in self.files], self.boundary, progress
        )

    def _table_part(self) -> bytes:
        if self.table is None:
            return b""
        head = f'--{self.boundary}\r\nContent-Disposition: form-data; name="subjects"'
        return f"{head}\r\n\r\n{self.table}".encode()

    def _part_head(self, name: str) -> bytes:
        # text before the first boundary is ignored, so every part may begin with a line break
        return f"\r\n--{self.boundary}\r\n{_file_part(name)}".encode("utf-8", "replace")


def batch_of(summary: Mapping[str, Any], recordings: Sequence[Recording]) -> RecordingBatch:
    """Result of a bulk upload that was read by a job with ``summary``, which refers to ``recordings``."""
    batch = ReadBatchSummary.model_validate(summary, extra="ignore")
    return RecordingBatch(
        recordings=list(recordings), studied=batch.studied, subjects=batch.subjects, refused=batch.refused
    )


def refusal_of(job: Job) -> ProblemError:
    """Error of a job that failed to read a bulk upload."""
    detail = f"The job {job.id} that reads the files ended as {job.state.replace('_', ' ')}."
    return ProblemError(job.error or Problem(title="Conflict", status=409, code="job-without-result", detail=detail))


async def iterate_async(pieces: Iterator[bytes]) -> AsyncIterator[bytes]:
    """Convert an iterator to an asynchronous one."""
    for piece in pieces:
        yield piece


def _form_headers(boundary: str, length: int) -> dict[str, str]:
    """Headers of a form whose parts have ``length`` bytes."""
    return {
        "Content-Type": f"multipart/form-data; boundary={boundary}",
        "Content-Length": str(length + len(_closing_boundary(boundary))),
    }


def _form_pieces(
    first: bytes, files: Sequence[tuple[bytes, Path]], boundary: str, progress: ProgressCallback | None
) -> Iterator[bytes]:
    """Yield ``first``, each file after its part header, and the end; ``progress`` counts the files only."""
    if first:
        yield first
    total, sent = sum(path.stat().st_size for _, path in files), 0
    for head, path in files:
        yield head
        with path.open("rb") as source:
            while piece := source.read(PIECE_BYTES):
                yield piece
                sent += len(piece)
                if progress is not None:
                    progress(sent, total)
    yield _closing_boundary(boundary)


def _closing_boundary(boundary: str) -> bytes:
    return f"\r\n--{boundary}--\r\n".encode()


def _file_part(claimed: str) -> str:
    """Header of a part with a file."""
    name = claimed.replace("\\", "").replace('"', "%22")
    name = "".join(character for character in name if character.isprintable())
    disposition = f'Content-Disposition: form-data; name="file"; filename="{name}"'
    return f"{disposition}\r\nContent-Type: application/octet-stream\r\n\r\n"
