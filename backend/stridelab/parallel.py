"""Runs independent pieces of one computation in several processes.

``map_isolated`` runs every item in its own process, so that a crash or hang of one does not affect the others;
``map_in_order`` shares many pieces among a few processes. The processes are forked from the caller if it has one
thread, and otherwise from a server process with preloaded modules. They stay in the session, the sandbox and under the
limits of the caller, limit their libraries to one thread, and end when the caller ends or closes the generator. The
results equal those of a single process: no random state is shared.
"""

import contextlib
import json
import multiprocessing
import os
import pickle
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import ModuleType
from typing import Any, Final, TypeVar

from threadpoolctl import threadpool_limits

from stridelab.errors import NotEstimable, StridelabError, error_of, problem_of
from stridelab.machine.cores import usable_cores

PROCESSES_MAX: Final = 6
"""Each process uses about 220 MB with a robot and scikit-learn; this number stays below 2 GB with the parent."""
PROCESSES: Final = 2
_DEFAULT_TIMEOUT_S: Final = 3600.0
_START_TIMEOUT_S: Final = 60.0
"""Time for the server process to import the preloaded modules; the limit of an item starts with its own process."""

Item = TypeVar("Item")
Result = TypeVar("Result")


def worthwhile_processes(seconds: int) -> int:
    """Number of processes to start for ``seconds`` of work: starting one takes up to a second."""
    return max(1, min(usable_cores(), PROCESSES_MAX, seconds))


def map_isolated(
    work: Callable[[Item], Result],
    items: Sequence[Item],
    *,
    preload: Sequence[str],
    timeout_s: float = _DEFAULT_TIMEOUT_S,
    processes: int = PROCESSES,
    codec: ModuleType = json,
) -> Generator[tuple[int, "Result | StridelabError"], None, None]:
    """Yield the index and the result of ``work(item)``, or the ``StridelabError`` that it raised, as items finish.

    ``work`` is a module-level function; ``preload`` are the modules that it needs. Results are sent with ``codec``:
    ``json``, or ``pickle`` for work that reads no files of strangers. A process that ends without a result yields the
    error ``computation-crashed``, one that exceeds ``timeout_s`` ``computation-timed-out``.
    """
    at_once = min(processes, usable_cores())
    waiting = deque(enumerate(items))
    running: dict[Connection, tuple[int, _Worker]] = {}
    deadlines_s: dict[Connection, float] = {}
    try:
        while waiting or running:
            while waiting and len(running) < at_once:
                index, item = waiting.popleft()
                worker = _Worker.start(work, [item], codec, preload)
                running[worker.pipe] = index, worker
                deadlines_s[worker.pipe] = time.monotonic() + _START_TIMEOUT_S
            next_s = min(deadlines_s[pipe] for pipe in running) - time.monotonic()
            ready = wait(list(running), timeout=max(next_s, 0.0))
            late = [pipe for pipe in running if pipe not in ready and deadlines_s[pipe] <= time.monotonic()]
            for pipe in [pipe for pipe in running if pipe in ready]:
                index, worker = running[pipe]
                message = worker.receive_message()
                if message == {}:
                    deadlines_s[pipe] = time.monotonic() + timeout_s
                    continue
                del running[pipe]
                worker.end()
                yield index, _item_result(worker, message)
            for pipe in late:
                index, worker = running.pop(pipe)
                worker.end()
                sentence = "The computation exceeded its time limit and was stopped."
                yield index, StridelabError("computation-timed-out", sentence)
    finally:
        for _, worker in running.values():
            worker.end()


def map_in_order(work: Callable[[int], Result], pieces: int, processes: int) -> Generator[Result, None, None]:
    """Yield ``work(0)`` to ``work(pieces - 1)`` in this order, computed by ``processes`` processes (1: in this one).

    ``work`` must be picklable. Close the generator unless it is exhausted. Raises the project's errors that ``work``
    raises, ``MemoryError`` if a process runs out of memory, and ``NotEstimable`` (``process-ended``) if a process
    ends without a result.
    """
    processes = min(processes, pieces)
    if processes <= 1:
        with threadpool_limits(1):
            yield from map(work, range(pieces))
        return
    workers: list[_Worker] = []
    try:
        workers += [_Worker.start(work, range(k, pieces, processes), pickle, ()) for k in range(processes)]
        for worker in workers:
            worker.receive_message()  # it has started
        for piece in range(pieces):
            message = workers[piece % processes].receive_message()
            if message is None:
                sentence = "A process that computed a part of the result ended unexpectedly."
                raise NotEstimable("process-ended", sentence)
            if "memory" in message:
                raise MemoryError
            if "problem" in message:
                raise error_of(message["problem"], message["raised"])
            yield message["value"]
    finally:
        for worker in workers:
            worker.end()


@dataclass(frozen=True)
class _Worker:
    """A process that sends an empty message when it starts, and then one message per item."""

    process: BaseProcess
    pipe: Connection
    codec: ModuleType

    @staticmethod
    def start(work: Callable[[Any], Any], items: Iterable[Any], codec: ModuleType, preload: Sequence[str]) -> "_Worker":
        context: Any = multiprocessing.get_context("fork" if _has_one_thread() else "forkserver")
        context.set_forkserver_preload(["__main__", *preload])
        ours, theirs = context.Pipe(duplex=False)
        process = context.Process(target=_serve_items, args=(theirs, codec.__name__, work, items), daemon=True)
        process.start()
        theirs.close()  # so that the pipe ends when the process ends
        return _Worker(process, ours, codec)

    def receive_message(self) -> dict[str, Any] | None:
        """The next message; None if the process has ended."""
        try:
            content = self.pipe.recv_bytes()
        except (EOFError, ConnectionResetError):
            self.process.join()
            return None
        message: dict[str, Any] = self.codec.loads(content)
        return message

    def end(self) -> None:
        """Kill the process and close the pipe."""
        self.process.kill()
        self.process.join()
        self.pipe.close()


def _item_result(worker: _Worker, message: dict[str, Any] | None) -> Any:
    if message is None:
        how = f"The computation ended with exit code {worker.process.exitcode} and no answer."
        return StridelabError("computation-crashed", how)
    if "memory" in message:
        return StridelabError("computation-crashed", "The computation ran out of memory.")
    return message["value"] if "value" in message else error_of(message["problem"], message["raised"])


def _has_one_thread() -> bool:
    """Whether this process can fork safely: with one thread, no fork copies a held lock."""
    tasks = Path("/proc/self/task")
    return tasks.exists() and len(list(tasks.iterdir())) == 1


def _serve_items(pipe: Connection, codec_name: str, work: Callable[[Any], Any], items: Iterable[Any]) -> None:
    """Entry point of a process: send the result of each item, or the first error."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the parent decides
    threading.Thread(target=_exit_with_parent, daemon=True).start()
    codec = {"json": json, "pickle": pickle}[codec_name]

    def send_message(message: dict[str, Any]) -> None:
        content = codec.dumps(message)
        pipe.send_bytes(content if isinstance(content, bytes) else content.encode())

    try:
        send_message({})
        with _limit_threads():
            for item in items:
                send_message({"value": work(item)})
    except StridelabError as error:
        send_message({"problem": problem_of(error), "raised": type(error).__name__})
    except MemoryError:
        send_message({"memory": True})
    except BrokenPipeError:
        return  # the parent has closed the pipe


def _limit_threads() -> contextlib.AbstractContextManager[Any]:
    try:
        limited: contextlib.AbstractContextManager[Any] = threadpool_limits(1)
    except PermissionError:  # in a sandbox, where the environment limits the libraries
        limited = contextlib.nullcontext()
    return limited


def _exit_with_parent() -> None:
    """Wait until the parent process ends, for whatever reason, and exit."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
    os._exit(1)
