"""Long-lived child processes that answer requests one at a time.

``PreviewProcess`` serves previews: its child is started by the first request, replaced when it fails, and ends after an
idle time. Requests are numbered JSON lines, so that the answer to a cancelled request is not taken for that of the next
one. ``StreamProcess`` serves one online stream.
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

PREVIEW_MODULE: Final = "stridelab.service.api.previews.child"
PREVIEW_MEMORY_MB: Final = 1024
"""Memory limit of the preview child beyond its libraries."""
START_TIMEOUT_S: Final = 60.0
ANSWER_TIMEOUT_S: Final = 10.0
MAX_WAITING: Final = 16
"""Maximum number of waiting requests; further ones raise ``Busy``."""
_MAX_LINE_BYTES: Final = 16 * 1024 * 1024


class PreviewProcess:
    """Asynchronous context manager: the preview planner in a child process, which is killed at exit."""

    def __init__(self, *, answer_s: float = ANSWER_TIMEOUT_S, module: str = PREVIEW_MODULE) -> None:
        self._answer_s, self._module = answer_s, module
        self._request_lock = asyncio.Lock()
        self._waiting = 0
        self._numbers = itertools.count()
        self._process: asyncio.subprocess.Process | None = None
        self._is_first_request = True

    async def __aenter__(self) -> "PreviewProcess":  # noqa: PYI034
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._kill_process()

    @property
    def pid(self) -> int | None:
        """Process id of the child; None while there is none."""
        return None if self._process is None or self._process.returncode is not None else self._process.pid

    async def ask(self, request: Json) -> Json:
        """The child's answer to ``request``.

        Raises the child's error; ``Busy`` (``preview-busy``) if too many requests wait; ``Unavailable`` if the child
        died (``preview-failed``) or did not answer in time (``preview-stuck``). The next request starts a new child.
        """
        if self._waiting >= MAX_WAITING:
            raise Busy("preview-busy", "Too many plans are being previewed at this moment.", 1.0)
        self._waiting += 1
        try:
            async with self._request_lock:
                answer = await self._answer_in_time(request)
        finally:
            self._waiting -= 1
        if "problem" in answer:
            raise IsolatedOutcome("error", None, answer["problem"], answer["raised"], "").as_error()
        value: Json = answer["value"]
        return value

    async def _answer_in_time(self, request: Json) -> Json:
        process = await self._running_process()
        limit_s = START_TIMEOUT_S if self._is_first_request else self._answer_s
        try:
            async with asyncio.timeout(limit_s):
                answer = await self._exchange_lines(process, request)
        except TimeoutError as error:
            await self._kill_process()
            sentence = f"The planner did not respond within {limit_s:g} s and was restarted."
            raise Unavailable("preview-stuck", sentence) from error
        except (asyncio.IncompleteReadError, BrokenPipeError, ConnectionResetError, ValueError) as error:
            await self._kill_process()
            raise Unavailable("preview-failed", "The planner ended unexpectedly and was restarted.") from error
        self._is_first_request = False  # the first answer includes the import of the libraries
        return answer

    async def _exchange_lines(self, process: asyncio.subprocess.Process, request: Json) -> Json:
        stdin, stdout = process.stdin, process.stdout
        if stdin is None or stdout is None:
            raise BrokenPipeError
        number = next(self._numbers)
        stdin.write(json.dumps({"number": number, **request}).encode() + b"\n")
        await stdin.drain()
        while True:
            line = await stdout.readline()
            if not line:
                raise asyncio.IncompleteReadError(b"", None)
            answer: Json = json.loads(line)
            if answer["number"] == number:
                return answer

    async def _running_process(self) -> asyncio.subprocess.Process:
        if self._process is None or self._process.returncode is not None:
            await self._kill_process()
            self._is_first_request = True
            self._process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                self._module,
                str(os.getpid()),
                str(PREVIEW_MEMORY_MB),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                env=child_environment(),
                limit=_MAX_LINE_BYTES,
                start_new_session=True,
            )
        return self._process

    async def _kill_process(self) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        await asyncio.shield(process.wait())
        if process.stdin is not None:
            process.stdin.close()


STREAM_MEMORY_MB: Final = 256
"""Memory limit of a stream's child beyond its libraries."""


class StreamProcess:
    """Asynchronous context manager: the child process of one stream, which is killed at exit."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process
        self._limit_s = START_TIMEOUT_S

    @staticmethod
    async def start_process() -> "StreamProcess":
        """Start the child; it only answers requests."""
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            "stridelab.service.api.stream.child",
            str(os.getpid()),
            str(STREAM_MEMORY_MB),
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
        """The child's answer to ``parcel``.

        Raises the child's error, or ``StridelabError`` with code ``stream-failed`` (the child died) or
        ``stream-stuck`` (no answer in time).
        """
        try:
            async with asyncio.timeout(self._limit_s):
                answer = await self._exchange_parcels(parcel)
        except TimeoutError as error:
            raise StridelabError("stream-stuck", "The estimator of this stream does not respond.") from error
        except (asyncio.IncompleteReadError, BrokenPipeError, ConnectionResetError) as error:
            raise StridelabError("stream-failed", "The estimator of this stream ended unexpectedly.") from error
        self._limit_s = ANSWER_TIMEOUT_S  # the first answer includes the import of the libraries
        if answer.kind == PROBLEM:
            failure = json.loads(answer.content)
            raise IsolatedOutcome("error", None, failure["problem"], failure["raised"], "").as_error()
        return answer

    async def _exchange_parcels(self, parcel: Parcel) -> Parcel:
        stdin, stdout = self._process.stdin, self._process.stdout
        if stdin is None or stdout is None:
            raise BrokenPipeError
        stdin.write(parcel.to_bytes())
        await stdin.drain()
        kind, samples, size = HEADER.unpack(await stdout.readexactly(HEADER.size))
        return Parcel(kind, await stdout.readexactly(size), samples)
