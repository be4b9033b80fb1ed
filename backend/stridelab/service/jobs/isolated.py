"""Computations in killable single-use processes: a crash, a hang or a memory hog costs only its own task.

A few children wait ready-imported (``child``), so that handing over a task takes milliseconds. A child does one task
and ends, so nothing leaks from one to the next. Children are spawned from the event loop's thread, which must live as
long as they do: the kernel kills them when that thread ends.
"""

import asyncio
import contextlib
import itertools
import json
import os
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import psutil

from stridelab import errors
from stridelab.errors import Fault, StridelabError

PRELOAD: Final = ("numpy", "scipy.signal", "scipy.optimize", "scipy.spatial.transform", "ezc3d", "pyarrow.parquet")
"""What children import while they wait."""
LOG_BYTES: Final = 64 * 1024
"""How much of the end of a child's log is kept."""
_MEMORY_WATCH_S: Final = 0.1
_TICKS_PER_FAMILY: Final = 10
_LINE_BYTES: Final = 64 * 1024 * 1024
_START_S: Final = 60.0
_AFTER_DEATH_S: Final = 0.5
_THREADS: Final = ("OMP", "OPENBLAS", "MKL", "NUMEXPR", "VECLIB", "BLIS")
_SECRETS: Final = ("STRIDELAB_", "AWS_", "PG", "AZURE_", "GOOGLE_")
_NEEDED: Final = frozenset({"STRIDELAB_NATIVE_PATH"})
"""The folder of the C++ solver: no secret, and computations look there for it."""

State = Literal["ok", "error", "crashed", "killed", "timeout", "cancelled", "memory"]
"""``killed`` is a SIGKILL that did not come from here: the kernel's for want of memory, or somebody's."""
OnProgress = Callable[[float, str], None]


@dataclass(frozen=True)
class IsolatedOutcome:
    """How a task ended.

    ``value`` is what it returned (state ``ok``); otherwise ``problem`` is ``{"code", "detail", "errors"}`` and
    ``raised`` names the class where it was an error of this project. ``log_tail`` is the end of what was printed.
    """

    state: State
    value: Any
    problem: dict[str, Any] | None
    raised: str | None
    log_tail: str

    def as_error(self) -> StridelabError:
        """The error that the task raised, or one that says how it ended."""
        problem = self.problem or _problem("computation-failed", "The computation did not succeed.")
        faults = [Fault(item["where"], item["message"]) for item in problem["errors"]]
        kind = getattr(errors, self.raised or "StridelabError", StridelabError)
        is_plain = isinstance(kind, type) and issubclass(kind, StridelabError) and kind is not errors.Busy
        return (kind if is_plain else StridelabError)(problem["code"], problem["detail"], faults)


class IsolatedPool:
    """Children for one event loop, ``spares`` of them ready in advance. An asynchronous context manager."""

    def __init__(self, spares: int = 1, preload: Sequence[str] = PRELOAD) -> None:
        self._wanted, self._preload = spares, tuple(preload)
        self._spares: list[_Child] = []
        self._refilling: asyncio.Task[None] | None = None
        self._closed = False

    async def __aenter__(self) -> "IsolatedPool":  # noqa: PYI034
        self._refill()
        return self

    async def __aexit__(self, *_: object) -> None:
        self._closed = True
        if self._refilling is not None:
            await asyncio.wait([self._refilling])
        for child in self._spares:
            await child.end()
        self._spares.clear()

    async def run(
        self,
        target: str,
        task: Mapping[str, Any],
        folder: Path,
        *,
        timeout_s: float,
        memory_mb: int,
        cancel: asyncio.Event | None = None,
        on_progress: OnProgress | None = None,
    ) -> IsolatedOutcome:
        """Run ``target`` (``"module:function"``) as ``f(task, folder, progress)`` in a child of its own.

        ``timeout_s`` counts from the moment at which the child is ready. Setting ``cancel``, or cancelling the
        calling task, kills the child and all that it started.
        """
        child = await self._take()
        try:
            return await child.work(
                {"target": target, "task": dict(task), "folder": str(folder.resolve()), "memory_mb": memory_mb},
                timeout_s=timeout_s,
                memory_mb=memory_mb,
                cancel=cancel or asyncio.Event(),
                on_progress=on_progress or _ignore,
            )
        finally:
            await asyncio.shield(child.end())

    async def _take(self) -> "_Child":
        while self._spares:
            child = self._spares.pop(0)
            if child.is_alive:
                self._refill()
                return child
            await child.end()
        child = await _Child.spawn(self._preload)
        self._refill()
        return child

    def _refill(self) -> None:
        if self._refilling is None or self._refilling.done():
            self._refilling = asyncio.get_running_loop().create_task(self._fill())

    async def _fill(self) -> None:
        while len(self._spares) < self._wanted and not self._closed:
            self._spares.append(await _Child.spawn(self._preload))


class _Child:
    """One child process and the two streams that come from it."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process
        self._tail = bytearray()
        self._logging = asyncio.get_running_loop().create_task(self._keep_log())

    @staticmethod
    async def spawn(preload: Sequence[str]) -> "_Child":
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            "stridelab.service.jobs.child",
            str(os.getpid()),
            ",".join(preload),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            env=child_environment(),
            limit=_LINE_BYTES,
            start_new_session=True,
        )
        return _Child(process)

    @property
    def is_alive(self) -> bool:
        return self._process.returncode is None

    async def work(
        self,
        task: Mapping[str, Any],
        *,
        timeout_s: float,
        memory_mb: int,
        cancel: asyncio.Event,
        on_progress: OnProgress,
    ) -> IsolatedOutcome:
        stop = asyncio.create_task(cancel.wait())
        ready = asyncio.create_task(self._next_message())
        reading = asyncio.create_task(self._converse(ready, task, on_progress))
        watching = asyncio.create_task(self._watch_memory(memory_mb << 20))
        try:
            await asyncio.wait({ready, stop}, timeout=_START_S, return_when=asyncio.FIRST_COMPLETED)
            if ready.done() and not stop.done():
                await asyncio.wait({reading, stop, watching}, timeout=timeout_s, return_when=asyncio.FIRST_COMPLETED)
            if reading.done():
                return await self._outcome(reading.result())
            if stop.done():
                return await self._killed("cancelled", "computation-cancelled", "The computation was cancelled.")
            if watching.done():
                return await self._out_of_memory(memory_mb)
            limit_s = f"{timeout_s:g} s"
            return await self._killed(
                "timeout", "computation-timed-out", f"The computation took longer than its limit of {limit_s}."
            )
        finally:
            for waiting in (stop, ready, reading, watching):
                waiting.cancel()
            await asyncio.gather(stop, ready, reading, watching, return_exceptions=True)

    async def end(self) -> None:
        """Kill the child and everything in its session, and collect what is left of it."""
        self._kill()
        await self._process.wait()
        with contextlib.suppress(asyncio.TimeoutError):
            await asyncio.wait_for(asyncio.shield(self._logging), _AFTER_DEATH_S)
        self._logging.cancel()
        if self._process.stdin is not None:
            self._process.stdin.close()

    def _kill(self) -> None:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)

    async def _converse(
        self, ready: "asyncio.Task[dict[str, Any] | None]", task: Mapping[str, Any], on_progress: OnProgress
    ) -> dict[str, Any] | None:
        """Hand over the task and listen until the answer; None where the child ended without one."""
        if await asyncio.shield(ready) is None or self._process.stdin is None:
            return None
        try:
            self._process.stdin.write(json.dumps(task).encode() + b"\n")
            await self._process.stdin.drain()
        except (BrokenPipeError, ConnectionResetError):
            return None
        while (message := await self._next_message()) is not None:
            if "progress" not in message:
                return message
            on_progress(float(message["progress"][0]), str(message["progress"][1]))
        return None

    async def _next_message(self) -> dict[str, Any] | None:
        if self._process.stdout is None:
            return None
        try:
            line = await self._process.stdout.readline()
            message = json.loads(line) if line else None
        except ValueError:  # longer than the limit, or not ours
            return None
        return message if isinstance(message, dict) else None

    async def _outcome(self, message: dict[str, Any] | None) -> IsolatedOutcome:
        if message is None:
            return await self._crashed()
        log = await self._log()
        if "value" in message:
            return IsolatedOutcome("ok", message["value"], None, None, log)
        if "problem" in message:
            return IsolatedOutcome("error", None, message["problem"], message.get("raised"), log)
        return IsolatedOutcome("memory", None, _memory_problem(), None, log)

    async def _crashed(self) -> IsolatedOutcome:
        stopped_here = self._kill_unless_ended()
        code = await self._process.wait()
        log = await self._log()
        if "bad_alloc" in log or "MemoryError" in log:
            return IsolatedOutcome("memory", None, _memory_problem(), None, log)
        if code < 0:
            how = f"was ended by the signal {signal.Signals(-code).name}"
        else:
            how = f"ended with exit code {code} and no answer"
        state: State = "killed" if code == -signal.SIGKILL and not stopped_here else "crashed"
        return IsolatedOutcome(
            state, None, _problem("computation-crashed", f"The computation {how}; see its log."), None, log
        )

    def _kill_unless_ended(self) -> bool:
        """Stop a child whose answer could not be read (True); one that has just ended keeps its exit code."""
        with contextlib.suppress(psutil.NoSuchProcess):
            if psutil.Process(self._process.pid).status() != psutil.STATUS_ZOMBIE and not self._at_end():
                self._kill()
                return True
        return False

    def _at_end(self) -> bool:
        return self._process.stdout is not None and self._process.stdout.at_eof()

    async def _killed(self, state: State, code: str, detail: str) -> IsolatedOutcome:
        self._kill()
        await self._process.wait()
        return IsolatedOutcome(state, None, _problem(code, detail), None, await self._log())

    async def _out_of_memory(self, memory_mb: int) -> IsolatedOutcome:
        self._kill()
        await self._process.wait()
        return IsolatedOutcome("memory", None, _memory_problem(memory_mb), None, await self._log())

    async def _watch_memory(self, limit_bytes: int) -> None:
        """Return when the child and its own children hold more than the limit."""
        for tick in itertools.count():
            await asyncio.sleep(_MEMORY_WATCH_S)
            with contextlib.suppress(psutil.Error):
                process = psutil.Process(self._process.pid)
                held = [process]
                if tick % _TICKS_PER_FAMILY == 0:
                    held += process.children(recursive=True)  # looks at every process of the machine
                if sum(each.memory_info().rss for each in held) > limit_bytes:
                    return

    async def _keep_log(self) -> None:
        while self._process.stderr is not None:
            chunk = await self._process.stderr.read(LOG_BYTES)
            if not chunk:
                return
            self._tail += chunk
            del self._tail[:-LOG_BYTES]

    async def _log(self) -> str:
        # the answer may overtake the last lines of the log; a grandchild may hold the log open for ever
        await asyncio.wait([self._logging], timeout=_AFTER_DEATH_S)
        return bytes(self._tail).decode("utf-8", errors="replace").replace("\0", "")


def child_environment() -> dict[str, str]:
    """The environment of a process that computes: no secrets, one thread per library."""
    environment = {key: value for key, value in os.environ.items() if key in _NEEDED or not key.startswith(_SECRETS)}
    return environment | {f"{library}_NUM_THREADS": "1" for library in _THREADS}


def _problem(code: str, detail: str) -> dict[str, Any]:
    return {"code": code, "detail": detail, "errors": []}


def _memory_problem(memory_mb: int | None = None) -> dict[str, Any]:
    limit = "" if memory_mb is None else f" of {memory_mb} MB"
    return _problem("computation-out-of-memory", f"The computation needed more memory than its limit{limit}.")


def _ignore(_fraction: float, _message: str) -> None:
    return None
