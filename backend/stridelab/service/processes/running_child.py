"""The parent's end of one child process (``child``): sends tasks, receives progress and answers, watches and kills it.

Messages are JSON lines. The child first sends its process id, then receives its setup and numbered tasks, and sends for
each task messages of progress and one answer with the number of the task: ``value``, ``problem`` or ``memory``. Numbers
keep the answer to a task that was given up from being taken for that of the next one.
"""

import asyncio
import contextlib
import itertools
import json
import math
import os
import signal
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import psutil

from stridelab.errors import StridelabError, error_of
from stridelab.machine.time_limit import TimeLimit
from stridelab.service.processes.fork_server_client import ForkedChild, ForkServerClient

LOG_TAIL_BYTES: Final = 64 * 1024
"""Size of the stored end of a child's log."""
_MEMORY_WATCH_S: Final = 0.1
_TICKS_PER_TREE_SCAN: Final = 10
_START_TIMEOUT_S: Final = 600.0
"""Time limit for the fork server's imports, which take seconds of processor time on a possibly busy machine."""
_QUIET_START_S: Final = 1.0
_DRAIN_TIMEOUT_S: Final = 0.5
_END_TIMEOUT_S: Final = 10.0
"""Time for the report of the end of a child whose connection is lost."""

State = Literal["ok", "error", "crashed", "killed", "timeout", "cancelled", "memory"]
"""``killed`` is a SIGKILL from outside, such as that of the out-of-memory killer."""
OnProgress = Callable[[float, str], None]


@dataclass(frozen=True)
class IsolatedOutcome:
    """Outcome of a task.

    ``value`` is its return value (state ``ok``); otherwise ``problem`` is ``{"code", "detail", "errors"}`` and
    ``error_class`` is the class name of a ``StridelabError``. ``log_tail`` is the end of the printed output.
    """

    state: State
    value: Any
    problem: dict[str, Any] | None
    error_class: str | None
    log_tail: str

    def as_error(self) -> StridelabError:
        """The error that the task raised, or one that describes how it ended."""
        failed = _make_problem("computation-failed", "The computation did not succeed.")
        return error_of(self.problem or failed, self.error_class)


class RunningChild:
    """A forked child with its connection and its log. Close it with ``kill_and_release``."""

    def __init__(self, fork_server: ForkServerClient, forked: ForkedChild, setup: Mapping[str, Any]) -> None:
        self._fork_server, self._forked, self._setup = fork_server, forked, setup
        self._pid: int | None = None
        self._preloaded_bytes = 0
        self._numbers = itertools.count()
        self._tail = bytearray()
        loop = asyncio.get_running_loop()
        self._log_task = loop.create_task(self._collect_log())
        self._ready = loop.create_task(self._wait_ready())

    @property
    def pid(self) -> int | None:
        """Process id of the child; None before it is ready and after its end."""
        return None if self.has_ended else self._pid

    @property
    def has_ended(self) -> bool:
        """Whether the child has ended."""
        return self._forked.exit_code.done()

    async def run_task(
        self,
        task: Mapping[str, Any],
        *,
        timeout_s: float,
        processor_s: float = math.inf,
        memory_mb: int | None = None,
        cancel: asyncio.Event | None = None,
        on_progress: OnProgress | None = None,
    ) -> IsolatedOutcome:
        """Run ``task`` in the child; ``timeout_s`` starts when the child is ready.

        ``processor_s`` is the limit of the child's processor time.
        Setting ``cancel`` kills the child, as do the time limit and ``memory_mb`` of resident memory beyond that of the
        preloaded libraries, which includes the child's own children (None: only its address space is limited).
        """
        on_progress = on_progress or _ignore_progress
        ready, ended = self._ready, self._forked.exit_code
        stop = asyncio.create_task((cancel or asyncio.Event()).wait())
        reading = asyncio.create_task(self._send_task(task, on_progress))
        watching = asyncio.create_task(self._watch_memory(memory_mb))
        try:
            await asyncio.wait({ready, stop}, timeout=_QUIET_START_S, return_when=asyncio.FIRST_COMPLETED)
            if not ready.done():
                on_progress(0.0, "start: waiting for the libraries")
                await asyncio.wait({ready, stop}, timeout=_START_TIMEOUT_S, return_when=asyncio.FIRST_COMPLETED)
            if not ready.done() and not stop.done():
                # it hangs: its children count as killed, the next fork starts a new server
                await self._fork_server.close()
                return await self._crash_outcome()
            if ready.done() and not stop.done():
                any_of: set[asyncio.Future[Any]] = {reading, stop, watching, ended}
                limit = TimeLimit(self._pid or 0, timeout_s, processor_s)
                while wait_s := limit.wait_s():
                    if (await asyncio.wait(any_of, timeout=wait_s, return_when=asyncio.FIRST_COMPLETED))[0]:
                        break
                if ended.done():  # its last message may still be in transit; a grandchild may hold the socket open
                    await asyncio.wait({reading}, timeout=_DRAIN_TIMEOUT_S)
                    if not reading.done():
                        return await self._crash_outcome()
            if reading.done():
                return await self._outcome_of_message(reading.result())
            if stop.done():
                return await self._kill_outcome("cancelled", "computation-cancelled", "The computation was cancelled.")
            if watching.done():
                return await self._memory_outcome(memory_mb or 0)
            limit_s = f"{min(timeout_s, processor_s):g} s"
            return await self._kill_outcome(
                "timeout", "computation-timed-out", f"The computation took longer than its limit of {limit_s}."
            )
        finally:
            for waiting in (stop, reading, watching):
                waiting.cancel()
            await asyncio.gather(stop, reading, watching, return_exceptions=True)

    @property
    def was_ready(self) -> bool:
        """Whether the child was ready, so that it may have started its task before it ended."""
        return self._pid is not None

    async def kill_and_release(self) -> None:
        """Kill the child and everything in its session, and release it."""
        await self._kill_and_wait()
        await self._read_log()
        self._log_task.cancel()
        self._ready.cancel()
        self._fork_server.release_child(self._forked)

    async def _kill_and_wait(self) -> None:
        self._kill_session()
        if self._pid is not None:  # a child that was never ready ends when its socket is closed
            await asyncio.wait([self._forked.exit_code])

    def _kill_session(self) -> None:
        if self._pid is not None:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self._pid, signal.SIGKILL)

    async def _wait_ready(self) -> bool:
        """Wait until the child is ready, store its process id and send the setup; False if it ended before."""
        message = await self._next_message()
        if message is None:
            return False
        self._pid, self._preloaded_bytes = int(message["ready"]), int(message["held_bytes"])
        return await self._send_message(self._setup)

    async def _send_task(self, task: Mapping[str, Any], on_progress: OnProgress) -> dict[str, Any] | None:
        """Send the task and read messages until its answer; None if the child ended without one."""
        number = next(self._numbers)
        if not await asyncio.shield(self._ready) or not await self._send_message({"number": number, "task": task}):
            return None
        while (message := await self._next_message()) is not None:
            if message["number"] != number:
                continue
            if "progress" not in message:
                return message
            on_progress(float(message["progress"][0]), str(message["progress"][1]))
        return None

    async def _send_message(self, message: Mapping[str, Any]) -> bool:
        try:
            self._forked.writer.write(json.dumps(message).encode() + b"\n")
            await self._forked.writer.drain()
        except (BrokenPipeError, ConnectionResetError):
            return False
        return True

    async def _next_message(self) -> dict[str, Any] | None:
        try:
            line = await self._forked.reader.readline()
            message = json.loads(line) if line else None
        except (ValueError, ConnectionResetError):  # too long, not JSON, or truncated
            return None
        return message if isinstance(message, dict) else None

    async def _outcome_of_message(self, message: dict[str, Any] | None) -> IsolatedOutcome:
        if message is None:
            return await self._crash_outcome()
        log = await self._read_log()
        if "value" in message:
            return IsolatedOutcome("ok", message["value"], None, None, log)
        if "problem" in message:
            return IsolatedOutcome("error", None, message["problem"], message.get("raised"), log)
        return IsolatedOutcome("memory", None, _memory_problem(), None, log)

    async def _crash_outcome(self) -> IsolatedOutcome:
        stopped_here = await self._kill_unless_ending()
        code = await self._forked.exit_code
        log = await self._read_log()
        if "bad_alloc" in log or "MemoryError" in log:
            return IsolatedOutcome("memory", None, _memory_problem(), None, log)
        if code < 0:
            how = f"was ended by the signal {signal.Signals(-code).name}"
        else:
            how = f"ended with exit code {code} and no answer"
        state: State = "killed" if code == -signal.SIGKILL and not stopped_here else "crashed"
        return IsolatedOutcome(
            state, None, _make_problem("computation-crashed", f"The computation {how}; see its log."), None, log
        )

    async def _kill_unless_ending(self) -> bool:
        """Kill a child that runs on without a readable answer (True); one whose connection is lost may be ending.

        A child that is killed from outside with unread input resets the connection, usually before the fork server
        reports its end.
        """
        ended, reader = self._forked.exit_code, self._forked.reader
        if reader.at_eof() or reader.exception() is not None or self._forked.writer.is_closing():
            await asyncio.wait({ended}, timeout=_END_TIMEOUT_S)
        if ended.done():
            return False
        self._kill_session()
        return True

    async def _kill_outcome(self, state: State, code: str, detail: str) -> IsolatedOutcome:
        await self._kill_and_wait()
        return IsolatedOutcome(state, None, _make_problem(code, detail), None, await self._read_log())

    async def _memory_outcome(self, memory_mb: int) -> IsolatedOutcome:
        await self._kill_and_wait()
        return IsolatedOutcome("memory", None, _memory_problem(memory_mb), None, await self._read_log())

    async def _watch_memory(self, memory_mb: int | None) -> None:
        """Return when the child and its own children use more memory than the limit plus the preloaded libraries."""
        await asyncio.shield(self._ready)
        if memory_mb is None:
            await asyncio.Event().wait()
            return
        for tick in itertools.count():
            await asyncio.sleep(_MEMORY_WATCH_S)
            with contextlib.suppress(psutil.Error):
                process = psutil.Process(self._pid)
                held = [process]
                if tick % _TICKS_PER_TREE_SCAN == 0:
                    held += process.children(recursive=True)  # expensive: scans all processes of the machine
                allowed_bytes = (memory_mb << 20) + self._preloaded_bytes
                # the sum of resident sizes is cheap and an upper bound, as shared pages count once per process
                if sum(each.memory_info().rss for each in held) <= allowed_bytes:
                    continue
                if len(held) == 1 or await asyncio.to_thread(_total_bytes, held) > allowed_bytes:
                    return

    async def _collect_log(self) -> None:
        while chunk := await self._forked.log.read(LOG_TAIL_BYTES):
            self._tail += chunk
            del self._tail[:-LOG_TAIL_BYTES]

    async def _read_log(self) -> str:
        # the answer may overtake the last lines of the log; a grandchild may hold the log open for ever
        if self._pid is not None and (self._setup["once"] or self._forked.exit_code.done()):
            await asyncio.wait([self._log_task], timeout=_DRAIN_TIMEOUT_S)
        return bytes(self._tail).decode("utf-8", errors="replace").replace("\0", "")


def _total_bytes(processes: Sequence[psutil.Process]) -> int:
    """Memory of the processes in bytes; shared pages count once."""
    return sum(_proportional_bytes(process) for process in processes)


def _proportional_bytes(process: psutil.Process) -> int:
    """Proportional set size of a process in bytes (a page shared by n counts 1/n), else its resident size."""
    try:
        rollup = Path(f"/proc/{process.pid}/smaps_rollup").read_text(encoding="ascii")
        return next(int(line.split()[1]) for line in rollup.splitlines() if line.startswith("Pss:")) * 1024
    except (OSError, StopIteration):  # an older kernel, another system, or no permission
        return int(process.memory_info().rss)


def _make_problem(code: str, detail: str) -> dict[str, Any]:
    return {"code": code, "detail": detail, "errors": []}


def _memory_problem(memory_mb: int | None = None) -> dict[str, Any]:
    limit = "" if memory_mb is None else f" of {memory_mb} MB"
    return _make_problem("computation-out-of-memory", f"The computation needed more memory than its limit{limit}.")


def _ignore_progress(_fraction: float, _message: str) -> None:
    return None
