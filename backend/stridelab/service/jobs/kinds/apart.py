"""One process per item, a few at a time: an item that crashes or hangs its process costs itself and nothing else.

The processes are forked from a server process that has imported what they need, so that each starts in milliseconds.
They belong to the caller's session, so that whoever kills that session kills them. Answers are JSON.
"""

import json
import multiprocessing
import os
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, Final

from stridelab import errors
from stridelab.errors import Fault, StridelabError
from stridelab.service.jobs.kinds.kind import Json

PROCESSES: Final = 2
_NEVER_S: Final = 3600.0


@dataclass(frozen=True)
class _Running:
    index: int
    process: BaseProcess
    until_s: float


def each_apart(
    work: Callable[[Json], Json],
    items: Sequence[Json],
    *,
    preload: Sequence[str],
    timeout_s: float = _NEVER_S,
    processes: int = PROCESSES,
) -> Iterator[tuple[int, "Json | StridelabError"]]:
    """``work`` of every item, as it gets done: its index with the answer, or the error of this project that it raised.

    ``work`` is a function of a module; ``preload`` are modules that it needs. A process that ends without an answer is
    the error ``computation-crashed``, one that takes too long ``computation-timed-out``. Closing the iterator ends all.
    """
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["__main__", *preload])
    waiting = deque(enumerate(items))
    running: dict[Connection, _Running] = {}
    try:
        while waiting or running:
            while waiting and len(running) < min(processes, os.cpu_count() or 1):
                index, item = waiting.popleft()
                ours, theirs = context.Pipe(duplex=False)
                process = context.Process(target=_answer, args=(theirs, work, item), daemon=True)
                process.start()
                theirs.close()
                running[ours] = _Running(index, process, time.monotonic() + timeout_s)
            left_s = min(one.until_s for one in running.values()) - time.monotonic()
            ready = wait(list(running), timeout=max(left_s, 0.0))
            late = [pipe for pipe, one in running.items() if one.until_s <= time.monotonic() and pipe not in ready]
            for pipe in (*(p for p in running if p in ready), *late):
                yield _finished(pipe, running.pop(pipe), timed_out=pipe in late)
    finally:
        for pipe, one in running.items():
            _end(pipe, one.process)


def _answer(pipe: Connection, work: Callable[[Json], Json], item: Json) -> None:
    try:
        message: Json = {"value": work(item)}
    except StridelabError as error:
        faults = [[fault.where, fault.message] for fault in error.faults]
        message = {"raised": type(error).__name__, "about": [error.code, error.message], "faults": faults}
    pipe.send_bytes(json.dumps(message).encode())
    pipe.close()


def _finished(pipe: Connection, one: _Running, *, timed_out: bool) -> tuple[int, "Json | StridelabError"]:
    try:
        if timed_out:
            return one.index, StridelabError("computation-timed-out", "Its computation took too long and was ended.")
        message: dict[str, Any] = json.loads(pipe.recv_bytes())
    except EOFError:
        one.process.join()
        how = f"Its computation ended with exit code {one.process.exitcode} and no answer."
        return one.index, StridelabError("computation-crashed", how)
    finally:
        _end(pipe, one.process)
    if "value" in message:
        return one.index, message["value"]
    kind: type[StridelabError] = getattr(errors, message["raised"], StridelabError)
    code, sentence = message["about"]
    return one.index, kind(code, sentence, [Fault(*fault) for fault in message["faults"]])


def _end(pipe: Connection, process: BaseProcess) -> None:
    process.kill()
    process.join()
    pipe.close()
