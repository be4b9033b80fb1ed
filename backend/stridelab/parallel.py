"""Runs independent pieces of work in several processes and yields their results in order.

The results equal those of a single process: no random state is shared, and each process limits its libraries to one
thread. The processes are spawned, so they load only what the work needs. They stay in the session and under the limits
of their parent, and end when the parent ends or when the generator is closed.
"""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterable
from multiprocessing.connection import wait
from multiprocessing.context import SpawnProcess
from typing import Any, Final, TypeVar

from threadpoolctl import threadpool_limits

from stridelab.cores import usable_cores
from stridelab.errors import NotEstimable, StridelabError

PROCESSES_MAX: Final = 6
"""Each process uses about 220 MB with a robot and scikit-learn; this number stays below 2 GB with the parent."""

Result = TypeVar("Result")


def worthwhile_processes(seconds: int) -> int:
    """Number of processes to start for ``seconds`` of work: starting one takes about a second."""
    return max(1, min(usable_cores(), PROCESSES_MAX, seconds))


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
    context = multiprocessing.get_context("spawn")
    pipes: list[Any] = []
    started: list[SpawnProcess] = []
    try:
        for first in range(processes):
            mine, theirs = context.Pipe(duplex=False)
            process = context.Process(
                target=_serve_pieces, args=(theirs, work, range(first, pieces, processes)), daemon=True
            )
            pipes.append(mine)
            process.start()
            started.append(process)
            theirs.close()  # so that the pipe ends when the process ends
        for piece in range(pieces):
            yield _receive_result(pipes[piece % processes])
    finally:
        for process in started:
            process.kill()
        for process in started:
            process.join()
            process.close()
        for pipe in pipes:
            pipe.close()


def _receive_result(pipe: Any) -> Any:
    try:
        answer, failure = pipe.recv()
    except EOFError as error:
        message = "A process that computed a part of the result ended unexpectedly."
        raise NotEstimable("process-ended", message) from error
    if failure is None:
        return answer
    kind, arguments = failure
    raise kind(*arguments)


def _serve_pieces(pipe: Any, work: Callable[[int], Any], pieces: Iterable[int]) -> None:
    """Entry point of a worker process: compute ``pieces`` and send each result or the first error."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the parent decides
    threading.Thread(target=exit_with_parent, daemon=True).start()
    try:
        with threadpool_limits(1):
            for piece in pieces:
                pipe.send((work(piece), None))
    except StridelabError as error:
        pipe.send((None, (type(error), (error.code, error.message, error.faults))))
    except MemoryError:
        pipe.send((None, (MemoryError, ())))
    except BrokenPipeError:
        return  # the parent has closed the pipe


def exit_with_parent() -> None:
    """Wait until the parent process ends, for whatever reason, and exit."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
    os._exit(1)
