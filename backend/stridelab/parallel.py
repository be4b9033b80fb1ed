"""Independent pieces of work on several processes, answered in order.

What comes out is what one process would compute, piece after piece: nothing here knows of random numbers, and every
process keeps its libraries to one thread. The processes are spawned, so that they hold only what the work needs. They
stay in the session of their parent, under its limits; they end with it however it ends, and where nobody wants the
rest of the answers.
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
"""One holds about 220 MB with a robot and scikit-learn: so many stay below 2 GB with their parent."""

Answer = TypeVar("Answer")


def worthwhile(seconds: int) -> int:
    """How many processes pay for so many seconds of work: starting one takes a second."""
    return max(1, min(usable_cores(), PROCESSES_MAX, seconds))


def in_order(work: Callable[[int], Answer], pieces: int, processes: int) -> Generator[Answer, None, None]:
    """``work(0)`` to ``work(pieces - 1)``, in this order, computed by ``processes`` processes (1: by this one).

    ``work`` must be picklable. Close the generator where its answers are not read to the end. Raises what ``work``
    raises of this project's errors, ``MemoryError`` where a process ran out of memory, and ``NotEstimable``
    (``process-ended``) where one ended without an answer.
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
            process = context.Process(target=_serve, args=(theirs, work, range(first, pieces, processes)), daemon=True)
            pipes.append(mine)
            process.start()
            started.append(process)
            theirs.close()  # so that the end of the process is the end of the pipe
        for piece in range(pieces):
            yield _received(pipes[piece % processes])
    finally:
        for process in started:
            process.kill()
        for process in started:
            process.join()
            process.close()
        for pipe in pipes:
            pipe.close()


def _received(pipe: Any) -> Any:
    try:
        answer, failure = pipe.recv()
    except EOFError as error:
        message = "A process that computed a part of this ended without an answer."
        raise NotEstimable("process-ended", message) from error
    if failure is None:
        return answer
    kind, arguments = failure
    raise kind(*arguments)


def _serve(pipe: Any, work: Callable[[int], Any], pieces: Iterable[int]) -> None:
    """Life of one process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the parent decides
    threading.Thread(target=end_with_parent, daemon=True).start()
    try:
        with threadpool_limits(1):
            for piece in pieces:
                pipe.send((work(piece), None))
    except StridelabError as error:
        pipe.send((None, (type(error), (error.code, error.message, error.faults))))
    except MemoryError:
        pipe.send((None, (MemoryError, ())))
    except BrokenPipeError:
        return  # nobody listens any more


def end_with_parent() -> None:
    """Wait for the end of the parent, which the kernel tells even where it was killed, and end too."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
    os._exit(1)
