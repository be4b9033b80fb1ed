"""Runs independent pieces of one computation in several processes, of this machine or of a Dask cluster.

``map_isolated`` runs every item in its own process, so that a crash or hang of one does not affect the others;
``map_in_order`` shares many pieces among a few processes; ``compute_beside`` runs one piece beside the caller. Where
``STRIDELAB_DASK_URL`` names a scheduler, its nodes run the same processes (``machine.cluster``). On this machine they
are forked from the caller if it has one thread, and otherwise from a server process with preloaded modules. They stay
in the session, the sandbox and under the limits of the caller, limit their libraries to one thread, and end when the
caller ends or closes the generator. The results equal those of a single process, wherever the pieces ran: no random
state is shared.
"""

import contextlib
import json
import math
import multiprocessing
import os
import pickle
import signal
import tempfile
import threading
from collections import deque
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import ModuleType
from typing import Any, Final, Generic, TypeVar

from threadpoolctl import threadpool_limits

from stridelab.errors import (
    NotEstimable,
    StorageFull,
    StridelabError,
    error_of,
    is_disk_full,
    problem_of,
    scratch_full_error,
)
from stridelab.machine.cluster import (
    call_on_cluster,
    count_cluster_slots,
    find_cancellation,
    has_cluster,
    leave_cluster,
)
from stridelab.machine.cores import SINGLE_THREADED, limit_cores, usable_cores
from stridelab.machine.time_limit import TimeLimit

PROCESSES_MAX: Final = 6
"""Each process uses about 220 MB with a robot and scikit-learn; this number stays below 2 GB with the parent."""
PROCESSES: Final = 2
_DEFAULT_TIMEOUT_S: Final = 3600.0
_START_TIMEOUT_S: Final = 60.0
"""Time for the server process to import the preloaded modules; the limit of an item starts with its own process."""
_LOOK_S: Final = 1.0
"""Interval at which a node asks whether its result is still wanted."""
_CHUNKS_PER_SLOT: Final = 4

_CODECS: Final = {codec.__name__: codec for codec in (json, pickle)}

Item = TypeVar("Item")
Result = TypeVar("Result")
_Message = dict[str, Any]
"""``value``; or why there is none: ``problem`` and ``raised``, ``memory``, ``ended`` (exit code), ``late``."""


def available_processes() -> int:
    """Number of processes that can run at a time: on the nodes of the cluster, or on the usable cores."""
    return count_cluster_slots() if has_cluster() else usable_cores()


def worthwhile_processes(seconds: int) -> int:
    """Number of processes to start for ``seconds`` of work: starting one takes up to a second."""
    if seconds <= 1:
        return 1
    return min(available_processes() if has_cluster() else min(usable_cores(), PROCESSES_MAX), seconds)


def map_isolated(
    work: Callable[[Item], Result],
    items: Sequence[Item],
    *,
    preload: Sequence[str],
    timeout_s: float = _DEFAULT_TIMEOUT_S,
    processor_s: float = math.inf,
    processes: int = PROCESSES,
    codec: ModuleType = json,
    confine: Callable[[Path], None] | None = None,
    spans_nodes: bool = True,
) -> Generator[tuple[int, "Result | StridelabError"], None, None]:
    """Yield the index and the result of ``work(item)``, or the ``StridelabError`` that it raised, as items finish.

    ``work`` is a module-level function; ``preload`` are the modules that it needs. Results are sent with ``codec``:
    ``json``, or ``pickle`` for work that reads no files of strangers. A process that ends without a result yields the
    error ``computation-crashed``, one that exceeds ``timeout_s``, or ``processor_s`` of processor time,
    ``computation-timed-out``.

    With ``confine``, the item is a mapping whose ``folder`` contains files of strangers: a node gets a copy of the
    folder, and its process calls ``confine`` with it first. ``spans_nodes=False`` uses this machine only.

    Raises ``Unavailable`` (``cluster-unavailable``).
    """
    settings = _Settings(work, codec.__name__, tuple(preload), (timeout_s, processor_s), confine)
    groups = [[item] for item in items]
    for index, message in _run_groups(settings, groups, processes, spans_nodes=spans_nodes):
        yield index, message["value"] if "value" in message else _item_error(message)


def map_in_order(work: Callable[[int], Result], pieces: int, processes: int) -> Generator[Result, None, None]:
    """Yield ``work(0)`` to ``work(pieces - 1)`` in this order, computed by ``processes`` processes (1: in this one).

    ``work`` must be picklable. Close the generator unless it is exhausted. Raises the project's errors that ``work``
    raises, ``MemoryError`` if a process runs out of memory, ``NotEstimable`` (``process-ended``) if a process
    ends without a result, and ``Unavailable`` (``cluster-unavailable``).
    """
    processes = min(processes, pieces)
    if processes <= 1:
        with threadpool_limits(1):
            yield from map(work, range(pieces))
        return
    n_groups = min(pieces, _CHUNKS_PER_SLOT * processes) if has_cluster() else processes
    groups = [range(k, pieces, n_groups) for k in range(n_groups)]
    received: list[deque[_Message]] = [deque() for _ in groups]
    with contextlib.closing(_run_groups(_Settings(work, pickle.__name__), groups, processes)) as messages:
        for piece in range(pieces):
            own = received[piece % n_groups]
            while not own:
                group, message = next(messages)
                received[group].append(message)
            yield _value_of(own.popleft())


class WorkBeside(Generic[Result]):
    """One piece of work in a process forked from this one, which sees the caller's objects as they are now.

    Its priority is lower by ``niceness``.
    """

    def __init__(self, work: Callable[[], Result], niceness: int = 0) -> None:
        def run_gently(_item: None) -> Result:
            os.nice(niceness)
            return work()

        self._worker = _Worker.start(_Settings(run_gently, pickle.__name__), [None], None)
        self._message: _Message = {}

    @staticmethod
    def is_possible() -> bool:
        """Whether this process can fork safely."""
        return _has_one_thread()

    @property
    def has_ended(self) -> bool:
        """Whether ``wait_for_result`` returns or raises at once."""
        return self.ends_within(0.0)

    def ends_within(self, timeout_s: float) -> bool:
        """Wait at most about ``timeout_s`` for the end; whether it has come."""
        while self._message == {} and self._worker.pipe.poll(timeout_s):  # the first message is empty
            self._message = self._worker.receive_message()
        return self._message != {}

    def wait_for_result(self) -> Result:
        """The result, which must be picklable. Raises as ``map_in_order``, also the project's errors of the work."""
        while self._message == {}:
            self._message = self._worker.receive_message()
        result: Result = _value_of(self._message)
        return result

    def end_process(self) -> None:
        """End the process, whatever it does."""
        self._worker.end()


@contextlib.contextmanager
def compute_beside(work: Callable[[], Result]) -> Generator[Callable[[], Result], None, None]:
    """Run ``work`` beside the caller (``WorkBeside``) within the context; the yielded function waits for its result.

    Where this process may use one core only, or has threads, the yielded function runs ``work`` itself.
    """
    if usable_cores() < 2 or not WorkBeside.is_possible():
        yield work
        return
    beside = WorkBeside(work)
    try:
        yield beside.wait_for_result
    finally:
        beside.end_process()


@dataclass(frozen=True)
class _Settings:
    """What all groups of a computation share."""

    work: Callable[[Any], Any]
    codec: str
    preload: Sequence[str] = ()
    limits_s: tuple[float, float] = (math.inf, math.inf)  # elapsed and processor time of an item
    confine: Callable[[Path], None] | None = None


def _run_groups(
    settings: _Settings, groups: Sequence[Sequence[Any]], at_once: int, *, spans_nodes: bool = True
) -> Generator[tuple[int, _Message], None, None]:
    """Yield the number of a group and the message of its next item, until all groups have ended.

    Each group has its own process, and ends at its first item without a value.
    """
    if not (spans_nodes and has_cluster()):
        yield from _run_in_processes(settings, groups, min(at_once, usable_cores()))
        return
    copied = [None if settings.confine is None else _read_folder(group[0]["folder"]) for group in groups]
    arguments = [(settings, list(group), files) for group, files in zip(groups, copied, strict=True)]
    with contextlib.closing(call_on_cluster(_run_on_node, arguments)) as results:
        for group, messages in results:
            yield from ((group, message) for message in messages or [{"ended": None}])


def _run_on_node(settings: _Settings, items: list[Any], files: Mapping[str, bytes] | None) -> list[_Message]:
    """Entry point on a node of the cluster: run one group in a process of this machine."""
    multiprocessing.current_process().daemon = False  # set by Dask, and forbids children
    os.environ.update(SINGLE_THREADED)  # for the server process, whose children are confined
    with tempfile.TemporaryDirectory(prefix="stridelab-") as folder:
        for name, content in (files or {}).items():
            (Path(folder) / name).parent.mkdir(parents=True, exist_ok=True)
            (Path(folder) / name).write_bytes(content)
        here = items if files is None else [{**items[0], "folder": folder}]
        return [message for _, message in _run_in_processes(settings, [here], 1, find_cancellation(), folder)]


def _run_in_processes(
    settings: _Settings,
    groups: Sequence[Sequence[Any]],
    at_once: int,
    is_wanted: Callable[[], bool] = lambda: True,
    folder: str | None = None,
) -> Generator[tuple[int, _Message], None, None]:
    """``_run_groups`` on this machine. A process that was killed is started again once, at its unfinished item."""
    waiting = deque(_Group(number, list(items)) for number, items in enumerate(groups) if len(items))
    running: dict[Connection, _Group] = {}
    try:
        while waiting or running:
            while waiting and len(running) < at_once:
                group = waiting.popleft()
                group.start_process(settings, folder)
                running[group.worker.pipe] = group
            next_s = min(group.limit.wait_s() for group in running.values())
            ready = wait(list(running), timeout=min(next_s, _LOOK_S))
            if not is_wanted():
                return
            late = [p for p, group in running.items() if p not in ready and not group.limit.wait_s()]
            for pipe in [*(pipe for pipe in running if pipe in ready), *late]:
                group = running[pipe]
                message = {"late": True} if pipe in late else group.worker.receive_message()
                if message == {}:
                    group.limit = TimeLimit(group.worker.process.pid or 0, *settings.limits_s)
                    continue
                if message == {"ended": -signal.SIGKILL} and not group.was_killed:
                    group.was_killed = True
                    waiting.appendleft(group)
                else:
                    del group.items[0]
                    yield group.number, message
                    if "value" in message and group.items:
                        continue
                del running[pipe]
                group.worker.end()
    finally:
        for group in running.values():
            group.worker.end()


@dataclass(eq=False)
class _Group:
    """A group of items, of which the first is being computed."""

    number: int
    items: list[Any]
    was_killed: bool = False
    limit: TimeLimit = field(init=False)
    worker: "_Worker" = field(init=False)

    def start_process(self, settings: _Settings, folder: str | None) -> None:
        self.worker = _Worker.start(settings, self.items, folder)
        self.limit = TimeLimit(self.worker.process.pid or 0, _START_TIMEOUT_S)


@dataclass(frozen=True)
class _Worker:
    """A process that sends an empty message when it starts, and then one message per item."""

    process: BaseProcess
    pipe: Connection
    codec: str

    @staticmethod
    def start(settings: _Settings, items: Sequence[Any], folder: str | None) -> "_Worker":
        context: Any = multiprocessing.get_context("fork" if _has_one_thread() else "forkserver")
        context.set_forkserver_preload(["__main__", *settings.preload])
        ours, theirs = context.Pipe(duplex=False)
        process = context.Process(target=_serve_items, args=(theirs, settings, items, folder), daemon=True)
        process.start()
        theirs.close()  # so that the pipe ends when the process ends
        return _Worker(process, ours, settings.codec)

    def receive_message(self) -> _Message:
        """The next message, also when the process has ended."""
        try:
            content = self.pipe.recv_bytes()
        except (EOFError, ConnectionResetError):
            self.process.join()
            return {"ended": self.process.exitcode}
        message: _Message = _CODECS[self.codec].loads(content)
        return message

    def end(self) -> None:
        """Kill the process and close the pipe."""
        self.process.kill()
        self.process.join()
        self.pipe.close()


def _item_error(message: _Message) -> StridelabError:
    if "problem" in message:
        return error_of(message["problem"], message["raised"])
    if "late" in message:
        return StridelabError("computation-timed-out", "The computation exceeded its time limit and was stopped.")
    how = "ran out of memory" if "memory" in message else f"ended with exit code {message['ended']} and no answer"
    return StridelabError("computation-crashed", f"The computation {how}.")


def _value_of(message: _Message) -> Any:
    if "value" in message:
        return message["value"]
    if "memory" in message:
        raise MemoryError
    if "problem" in message:
        raise _item_error(message)
    raise NotEstimable("process-ended", "A process that computed a part of the result ended unexpectedly.")


def _read_folder(folder: str) -> dict[str, bytes]:
    files = (path for path in Path(folder).rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def _has_one_thread() -> bool:
    """Whether this process can fork safely: with one thread, no fork copies a held lock."""
    tasks = Path("/proc/self/task")
    return tasks.exists() and len(list(tasks.iterdir())) == 1


def _serve_items(pipe: Connection, settings: _Settings, items: Sequence[Any], folder: str | None) -> None:
    """Entry point of a process: send the result of each item, or the first error."""
    limit_cores(1)  # the other cores compute other items
    leave_cluster()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the parent decides
    codec = _CODECS[settings.codec]

    def send_message(message: _Message) -> None:
        content = codec.dumps(message)
        pipe.send_bytes(content if isinstance(content, bytes) else content.encode())

    try:
        with _limit_threads():
            if settings.confine is not None and folder is not None:
                settings.confine(Path(folder))
            threading.Thread(target=_exit_with_parent, daemon=True).start()
            send_message({})
            for item in items:
                send_message({"value": settings.work(item)})
    except StridelabError as error:
        send_message({"problem": problem_of(error), "raised": type(error).__name__})
    except MemoryError:
        send_message({"memory": True})
    except BrokenPipeError:
        return  # the parent has closed the pipe
    except OSError as error:
        if not is_disk_full(error):
            raise
        send_message({"problem": problem_of(scratch_full_error()), "raised": StorageFull.__name__})


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
