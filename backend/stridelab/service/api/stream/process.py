"""The parent's end of a stream's process: one question, one answer, and an end that leaves nothing behind."""

import asyncio
import contextlib
import json
import os
import signal
import sys
from types import TracebackType
from typing import Final

from stridelab.errors import StridelabError
from stridelab.service.api.stream.wire import HEADER, PROBLEM, Parcel
from stridelab.service.jobs.isolated import IsolatedOutcome
from stridelab.service.jobs.nursery import child_environment

MEMORY_MB: Final = 256
"""What a stream may take beyond its libraries."""
START_S: Final = 60.0
ANSWER_S: Final = 10.0


class StreamProcess:
    """A child of its own for one stream. An asynchronous context manager: the child is killed at the end."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process
        self._limit_s = START_S

    @staticmethod
    async def spawn() -> "StreamProcess":
        """Start it; it says nothing before it is asked."""
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            "stridelab.service.api.stream.child",
            str(os.getpid()),
            str(MEMORY_MB),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            env=child_environment(),
            start_new_session=True,
        )
        return StreamProcess(process)

    async def __aenter__(self) -> "StreamProcess":  # noqa: PYI034
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)
        await asyncio.shield(self._process.wait())
        if self._process.stdin is not None:
            self._process.stdin.close()

    async def ask(self, parcel: Parcel) -> Parcel:
        """The answer to ``parcel``.

        Raises what the child raised, or ``StridelabError`` with code ``stream-failed`` (it died) or
        ``stream-stuck`` (no answer in time).
        """
        try:
            async with asyncio.timeout(self._limit_s):
                answer = await self._exchange(parcel)
        except TimeoutError as error:
            raise StridelabError("stream-stuck", "The estimator of this stream does not answer.") from error
        except (asyncio.IncompleteReadError, BrokenPipeError, ConnectionResetError) as error:
            raise StridelabError("stream-failed", "The estimator of this stream has ended unexpectedly.") from error
        self._limit_s = ANSWER_S  # the first answer waits for the libraries
        if answer.kind == PROBLEM:
            said = json.loads(answer.content)
            raise IsolatedOutcome("error", None, said["problem"], said["raised"], "").as_error()
        return answer

    async def _exchange(self, parcel: Parcel) -> Parcel:
        stdin, stdout = self._process.stdin, self._process.stdout
        if stdin is None or stdout is None:
            raise BrokenPipeError
        stdin.write(parcel.to_bytes())
        await stdin.drain()
        kind, samples, size = HEADER.unpack(await stdout.readexactly(HEADER.size))
        return Parcel(kind, await stdout.readexactly(size), samples)
