"""Forms of uploads for httpx, whose files are read in pieces while they are sent."""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
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
TERRAIN_PATH = f"{API}/terrains"
TERRAIN_TIMEOUT_S = 180.0
"""Timeout of reading a terrain, which may take a minute and wait for others."""
PIECE_BYTES = 256 * 1024
OCTETS = "application/octet-stream"
ProgressCallback = Callable[[int, int], None]
"""Called with the number of bytes sent so far and in total."""


class _SentFile:
    """A file of a form as httpx reads it: open only while it is sent; ``report`` is called with the bytes just sent."""

    def __init__(self, path: Path, report: Callable[[int], None]) -> None:
        self._path, self._report = path, report
        self._pieces: Iterator[bytes] = iter(())

    def tell(self) -> int:
        return 0

    def seek(self, _offset: int, whence: int = os.SEEK_SET) -> int:
        if whence == os.SEEK_END:  # httpx computes the length of the form
            return self._path.stat().st_size
        self._pieces = self._read_pieces()
        return 0

    def read(self, _size: int) -> bytes:
        return next(self._pieces, b"")

    def _read_pieces(self) -> Iterator[bytes]:
        with self._path.open("rb") as source:
            while piece := source.read(PIECE_BYTES):
                yield piece
                self._report(len(piece))


def form(
    files: Sequence[tuple[str, Path]], fields: Mapping[str, str], progress: ProgressCallback | None = None
) -> dict[str, Any]:
    """Arguments of httpx for a form with ``fields`` and ``files`` (name, path), whose bytes ``progress`` counts."""
    total, sent = sum(path.stat().st_size for _, path in files), 0

    def report(count: int) -> None:
        nonlocal sent
        sent += count
        if progress is not None:
            progress(sent, total)

    parts = [("file", (_printable_name(name), _SentFile(path, report), OCTETS)) for name, path in files]
    return {"data": dict(fields), "files": parts}


def text_fields(subject: SubjectFields | None, session_id: str | None) -> dict[str, str]:
    """Text fields of a single upload."""
    stated = {} if subject is None else subject.model_dump(exclude_none=True)
    fields = {("subject_name" if name == "name" else name): str(value) for name, value in stated.items()}
    return fields if session_id is None else {**fields, "session_id": session_id}


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


def _printable_name(claimed: str) -> str:
    return "".join(character for character in claimed.replace("\\", "") if character.isprintable())
