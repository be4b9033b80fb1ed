"""Parts of the results of running jobs: from the files of the child to the database, and back.

The child runs foreign data and may be taken over: its files are opened without following links, below a folder that was
opened before the child began, with a limit on size, and are stored only if they are a ``PartialChunk``. A part is
inserted in the transaction that reports progress, behind the same fence, and is never part of a result. All parts are
removed in the transaction in which their attempt ends.
"""

import os
import stat
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import structlog
from pydantic import TypeAdapter, ValidationError
from sqlalchemy import delete, exists, select
from sqlalchemy.dialects.postgresql import insert
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.errors import Fault, InvalidInput
from stridelab.schemas.previews import PartialChunk
from stridelab.service.kinds.partial_results import MAX_ATTEMPT_BYTES, MAX_CHUNK_BYTES, PARTIAL_FOLDER, chunk_name
from stridelab.service.storage.tables import job, job_partial

MAX_READ_BYTES: Final = 1 << 20
"""About the size of the parts that are read, inserted or sent at once."""
CHUNK: Final[TypeAdapter[PartialChunk]] = TypeAdapter(PartialChunk)
_MAX_NUMBER: Final = 2**31 - 1
_log = structlog.get_logger(__name__)

NumberedChunk = tuple[int, str]
"""Number and JSON of one part."""


class PartialReader:
    """Reads the parts that a child writes into the new folder ``partial`` below ``folder``; close it."""

    def __init__(self, folder: Path) -> None:
        (folder / PARTIAL_FOLDER).mkdir(mode=0o700)
        self._folder = os.open(folder / PARTIAL_FOLDER, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
        self._number, self._read_bytes = 0, 0
        self._is_open = True

    def read_new(self) -> list[NumberedChunk]:
        """Read and remove the next parts; a wrong one, or too much of them, ends the parts of this attempt."""
        chunks: list[NumberedChunk] = []
        size = 0
        while self._is_open and size < MAX_READ_BYTES:
            name = chunk_name(self._number + 1)
            try:
                content = self._read_file(name)
            except FileNotFoundError:
                break
            except (OSError, ValueError) as error:
                self._stop_reading(str(error))
                break
            self._number += 1
            size += len(content)
            self._read_bytes += len(content)
            if self._read_bytes > MAX_ATTEMPT_BYTES:
                self._stop_reading("too many parts")
                break
            chunks.append((self._number, content.decode()))
            os.unlink(name, dir_fd=self._folder)
        return chunks

    def close(self) -> None:
        """Release the folder."""
        self._is_open = False
        os.close(self._folder)

    def _stop_reading(self, reason: str) -> None:
        self._is_open = False
        _log.warning("partial-results-ended", reason=reason)

    def _read_file(self, name: str) -> bytes:
        """Content of a file as JSON of a ``PartialChunk``; ``ValueError`` unless it is one."""
        descriptor = os.open(name, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, dir_fd=self._folder)
        with os.fdopen(descriptor, "rb") as file:
            if not stat.S_ISREG(os.fstat(descriptor).st_mode):
                raise ValueError("a part is no regular file")
            content = file.read(MAX_CHUNK_BYTES + 1)
        if len(content) > MAX_CHUNK_BYTES:
            raise ValueError("a part is too large")
        try:
            return CHUNK.dump_json(CHUNK.validate_json(content))
        except ValidationError:
            raise ValueError("a part does not have the form of one") from None


async def insert_chunks(
    connection: AsyncConnection, job_id: str, attempt: int, chunks: Sequence[NumberedChunk]
) -> None:
    """Insert parts; those that a repeated call has inserted stay."""
    if chunks:
        rows = [{"job_id": job_id, "attempt": attempt, "number": n, "body": body} for n, body in chunks]
        await connection.execute(insert(job_partial).on_conflict_do_nothing(), rows)


async def delete_stale_chunks(connection: AsyncConnection) -> None:
    """Delete the parts of attempts that do not run."""
    running = exists().where(
        job.c.id == job_partial.c.job_id, job.c.attempt == job_partial.c.attempt, job.c.state == "running"
    )
    await connection.execute(delete(job_partial).where(~running))
    await connection.commit()


async def read_chunks(
    connection: AsyncConnection, job_id: str, attempt: int, after: int
) -> tuple[list[PartialChunk], int]:
    """Parts of an attempt with numbers above ``after``, about ``MAX_READ_BYTES`` of them; and the last number."""
    wanted = (
        select(job_partial.c.number, job_partial.c.body)
        .where(job_partial.c.job_id == job_id, job_partial.c.attempt == attempt, job_partial.c.number > after)
        .order_by(job_partial.c.number)
        .limit(200)
    )
    chunks: list[PartialChunk] = []
    size = 0
    for number, body in await connection.execute(wanted):
        chunks.append(CHUNK.validate_json(body))
        after, size = number, size + len(body)
        if size >= MAX_READ_BYTES:
            break
    return chunks, after


def decode_partial_cursor(cursor: str | None) -> tuple[int, int]:
    """Attempt and number of a cursor; zeros without one. Raises ``InvalidInput`` (``invalid-cursor``)."""
    if not cursor:
        return 0, 0
    attempt, _, number = cursor.partition(".")
    parts = attempt, number
    if not all(part.isascii() and part.isdecimal() and int(part) <= _MAX_NUMBER for part in parts):
        raise InvalidInput(
            "invalid-cursor", "The cursor is not one of this job's parts.", [Fault("after", "use the value of `next`")]
        )
    return int(attempt), int(number)
