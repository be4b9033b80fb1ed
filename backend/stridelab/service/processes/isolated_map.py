"""Parallel map with one process per item: a crash or hang of one item does not affect the others.

The processes are forked from the caller if that is safe, and otherwise from a server process with preloaded modules, so
that each starts in milliseconds. They belong to the caller's session and are killed with it. Answers are JSON.
"""

import json
import multiprocessing
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Final

from stridelab import errors
from stridelab.cores import usable_cores
from stridelab.errors import Fault, StridelabError
from stridelab.service.kinds.base import Json

PROCESSES: Final = 2
_DEFAULT_TIMEOUT_S: Final = 3600.0
_START_TIMEOUT_S: Final = 60.0
"""Time for the server process to import the preloaded modules; the limit of an item starts with its own process."""
_STARTED: Final = b"started"


@dataclass(frozen=True)
class _Running:
    index: int
    process: BaseProcess
    deadline_s: float


def map_isolated(
    work: Callable[[Json], Json],
    items: Sequence[Json],
    *,
    preload: Sequence[str],
    timeout_s: float = _DEFAULT_TIMEOUT_S,
    processes: int = PROCESSES,
) -> Iterator[tuple[int, "Json | StridelabError"]]:
    """Yield the index and the result of ``work(item)``, or the ``StridelabError`` that it raised, as items finish.

    ``work`` is a module-level function; ``preload`` are the modules that it needs. A process that ends without an
    answer yields the error ``computation-crashed``, one that exceeds ``timeout_s`` ``computation-timed-out``. Closing
    the iterator kills all processes.
    """
    at_once = min(processes, usable_cores())
    forks_itself = _has_one_thread()
    context = multiprocessing.get_context("fork") if forks_itself else multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["__main__", *preload])
    waiting = deque(enumerate(items))
    running: dict[Connection, _Running] = {}
    try:
        while waiting or running:
            while waiting and len(running) < at_once:
                index, item = waiting.popleft()
                ours, theirs = context.Pipe(duplex=False)
                process = context.Process(target=_run_item, args=(theirs, work, item), daemon=True)
                process.start()
                theirs.close()
                running[ours] = _Running(index, process, time.monotonic() + _START_TIMEOUT_S)
            left_s = min(one.deadline_s for one in running.values()) - time.monotonic()
            ready = wait(list(running), timeout=max(left_s, 0.0))
            late = [pipe for pipe, one in running.items() if one.deadline_s <= time.monotonic() and pipe not in ready]
            for pipe in [pipe for pipe in running if pipe in ready]:
                one = running.pop(pipe)
                message = _receive_message(pipe)
                if message == _STARTED:
                    running[pipe] = replace(one, deadline_s=time.monotonic() + timeout_s)
                else:
                    yield one.index, _item_result(pipe, one.process, message)
            for pipe in late:
                one = running.pop(pipe)
                _end_process(pipe, one.process)
                sentence = "The computation exceeded its time limit and was stopped."
                yield one.index, StridelabError("computation-timed-out", sentence)
    finally:
        for pipe, one in running.items():
            _end_process(pipe, one.process)


def _has_one_thread() -> bool:
    """Whether this process can fork safely: with one thread, no fork copies a held lock."""
    tasks = Path("/proc/self/task")
    return tasks.exists() and len(list(tasks.iterdir())) == 1


def _run_item(pipe: Connection, work: Callable[[Json], Json], item: Json) -> None:
    pipe.send_bytes(_STARTED)
    try:
        message: Json = {"value": work(item)}
    except StridelabError as error:
        faults = [[fault.where, fault.message] for fault in error.faults]
        message = {"raised": type(error).__name__, "about": [error.code, error.message], "faults": faults}
    pipe.send_bytes(json.dumps(message).encode())
    pipe.close()


def _receive_message(pipe: Connection) -> bytes | None:
    try:
        return pipe.recv_bytes()
    except EOFError:
        return None


def _item_result(pipe: Connection, process: BaseProcess, content: bytes | None) -> "Json | StridelabError":
    if content is None:
        process.join()
    exit_code = process.exitcode
    _end_process(pipe, process)
    if content is None:
        how = f"The computation ended with exit code {exit_code} and no answer."
        return StridelabError("computation-crashed", how)
    message: dict[str, Any] = json.loads(content)
    if "value" in message:
        value: Json = message["value"]
        return value
    kind: type[StridelabError] = getattr(errors, message["raised"], StridelabError)
    code, sentence = message["about"]
    return kind(code, sentence, [Fault(*fault) for fault in message["faults"]])


def _end_process(pipe: Connection, process: BaseProcess) -> None:
    process.kill()
    process.join()
    pipe.close()
