"""One child that stays, for answers that are wanted at once: started by the first question, replaced when it fails.

It answers one question at a time, in JSON lines with numbers, so that an answer nobody waits for any more is not taken
for another one's. It ends by itself when it has not been asked for a while.

The parent's end of a stream's process: one question, one answer, and an end that leaves nothing behind.
"""

import asyncio
import contextlib
import itertools
import json
import os
import signal
import sys
from types import TracebackType
from typing import Any, Final

from stridelab.errors import Busy, StridelabError, Unavailable
from stridelab.service.api.stream.messages import HEADER, PROBLEM, Parcel
from stridelab.service.processes.fork_server_client import child_environment
from stridelab.service.processes.pool import IsolatedOutcome

Json = dict[str, Any]

CHILD: Final = "stridelab.service.api.previews.child"
MEMORY_MB: Final = 1024
"""What it may take beyond its libraries."""
START_S: Final = 60.0
ANSWER_S: Final = 10.0
WAITING: Final = 16
"""Questions that may wait for their turn; the next one is told to come back."""
_LINE_BYTES: Final = 16 * 1024 * 1024


class Resident:
    """The planner that answers directly. An asynchronous context manager: the child is killed at the end."""

    def __init__(self, *, answer_s: float = ANSWER_S, module: str = CHILD) -> None:
        self._answer_s, self._module = answer_s, module
        self._turn = asyncio.Lock()
        self._waiting = 0
        self._numbers = itertools.count()
        self._process: asyncio.subprocess.Process | None = None
        self._fresh = True

    async def __aenter__(self) -> "Resident":  # noqa: PYI034
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._end()

    @property
    def pid(self) -> int | None:
        """Of the child, while there is one."""
        return None if self._process is None or self._process.returncode is not None else self._process.pid

    async def ask(self, question: Json) -> Json:
        """The answer to ``question``.

        Raises what the child raised; ``Busy`` (``preview-busy``) where too many wait; ``Unavailable``
        (``preview-failed``, ``preview-stuck``) where it died, or was ended because it gave no answer in time: the next
        question finds a new one.
        """
        if self._waiting >= WAITING:
            raise Busy("preview-busy", "Too many plans are being previewed at this moment.", 1.0)
        self._waiting += 1
        try:
            async with self._turn:
                answer = await self._answer(question)
        finally:
            self._waiting -= 1
        if "problem" in answer:
            raise IsolatedOutcome("error", None, answer["problem"], answer["raised"], "").as_error()
        value: Json = answer["value"]
        return value

    async def _answer(self, question: Json) -> Json:
        process = await self._running()
        limit_s = START_S if self._fresh else self._answer_s
        try:
            async with asyncio.timeout(limit_s):
                answer = await self._exchange(process, question)
        except TimeoutError as error:
            await self._end()
            sentence = f"The planner gave no answer within {limit_s:g} s and was started anew."
            raise Unavailable("preview-stuck", sentence) from error
        except (asyncio.IncompleteReadError, BrokenPipeError, ConnectionResetError, ValueError) as error:
            await self._end()
            raise Unavailable("preview-failed", "The planner has ended unexpectedly and was started anew.") from error
        self._fresh = False  # the first answer waits for the libraries
        return answer

    async def _exchange(self, process: asyncio.subprocess.Process, question: Json) -> Json:
        stdin, stdout = process.stdin, process.stdout
        if stdin is None or stdout is None:
            raise BrokenPipeError
        number = next(self._numbers)
        stdin.write(json.dumps({"number": number, **question}).encode() + b"\n")
        await stdin.drain()
        while True:
            line = await stdout.readline()
            if not line:
                raise asyncio.IncompleteReadError(b"", None)
            answer: Json = json.loads(line)
            if answer["number"] == number:
                return answer

    async def _running(self) -> asyncio.subprocess.Process:
        if self._process is None or self._process.returncode is not None:
            await self._end()
            self._fresh = True
            self._process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                self._module,
                str(os.getpid()),
                str(MEMORY_MB),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                env=child_environment(),
                limit=_LINE_BYTES,
                start_new_session=True,
            )
        return self._process

    async def _end(self) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        await asyncio.shield(process.wait())
        if process.stdin is not None:
            process.stdin.close()


PROCESS_MEMORY_MB: Final = 256
"""What a stream may take beyond its libraries."""


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
            str(PROCESS_MEMORY_MB),
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
