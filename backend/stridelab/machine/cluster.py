"""Function calls on the nodes of a Dask cluster, through its ``concurrent.futures`` executor.

``STRIDELAB_DASK_URL`` names the scheduler (``tcp://head:8786``); this program starts no nodes, and none is its own. A
call whose node ends is made again on another one by the scheduler. When the scheduler ends, the calls without a result
are made again as soon as it is back.
"""

import contextlib
import importlib
import logging
import os
import socket
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import CancelledError, as_completed
from typing import Any, Final
from urllib.parse import urlsplit

from stridelab.errors import Fault, InvalidInput, Unavailable

VARIABLE: Final = "STRIDELAB_DASK_URL"
PATIENCE_S: Final = 60.0
"""Time without a scheduler, in s, after which the computation fails."""
_CONNECT_S: Final = 10.0
_PAUSE_S: Final = 1.0
_LOST: Final = (CancelledError, OSError, TimeoutError)
"""Errors of a connection to a scheduler that has ended."""
_log = logging.getLogger(__name__)


def has_cluster() -> bool:
    """Whether ``STRIDELAB_DASK_URL`` names a scheduler."""
    return bool(os.environ.get(VARIABLE))


def leave_cluster() -> None:
    """Compute on this machine only, from now on."""
    os.environ.pop(VARIABLE, None)


def scheduler_address(url: str) -> tuple[str, int]:
    """Host and port of a scheduler. Raises ``InvalidInput`` (``dask-url-invalid``)."""
    try:
        parts = urlsplit(url)
        if parts.scheme == "tcp" and parts.hostname and parts.port:
            return parts.hostname, parts.port
    except ValueError:
        pass
    fault = Fault(VARIABLE, "not of the form tcp://host:port")
    raise InvalidInput("dask-url-invalid", "The address of the Dask scheduler is invalid.", [fault])


def resolve_scheduler() -> None:
    """Replace the host in ``STRIDELAB_DASK_URL`` by its address, for a process that will not resolve names."""
    host, port = scheduler_address(os.environ[VARIABLE])
    with contextlib.suppress(OSError):  # reported when the process connects
        os.environ[VARIABLE] = f"tcp://{socket.gethostbyname(host)}:{port}"


def count_cluster_slots() -> int:
    """Number of calls that the nodes compute at a time; at least 2, since nodes may start when there is work."""
    try:
        with _connect() as client:
            slots: int = sum(client.nthreads().values())
            return max(2, slots)
    except _LOST:
        return 2


def call_on_cluster(
    function: Callable[..., Any], arguments: Sequence[tuple[Any, ...]]
) -> Generator[tuple[int, Any], None, None]:
    """Yield the index and the result of every ``function(*arguments)``, as they finish.

    The result is None if the nodes that computed it ended, one after the other. ``function`` and results must be
    picklable. Closing the generator cancels the calls without a result.

    Raises ``Unavailable`` (``cluster-unavailable``) without a scheduler for ``PATIENCE_S``, or if a node cannot make
    the calls.
    """
    waiting = dict(enumerate(arguments))
    lost_s: float | None = None
    while waiting:
        try:
            with _connect() as client:
                lost_s = None
                executor = client.get_executor(pure=False)
                futures = {executor.submit(function, *of_one): index for index, of_one in waiting.items()}
                for future in as_completed(futures):
                    index, result = futures.pop(future), _result_of(future)
                    del future  # a result that is still referenced is computed again when its node ends
                    del waiting[index]
                    yield index, result
        except _LOST as error:
            lost_s = lost_s or time.monotonic()
            if time.monotonic() - lost_s > PATIENCE_S:
                raise _unavailable("The Dask scheduler cannot be reached.", error) from error
            _log.warning("The Dask scheduler is lost (%s); %d parts wait.", type(error).__name__, len(waiting))
            time.sleep(_PAUSE_S)


def find_cancellation() -> Callable[[], bool]:
    """In a call on a node: a function that says whether the result is still wanted. Elsewhere it is always wanted."""
    try:
        from distributed import get_worker

        worker = get_worker()
    except (ImportError, ValueError):
        return lambda: True
    key = worker.get_current_task()
    tasks = worker.state.tasks
    return lambda: key in tasks and tasks[key].state in {"executing", "long-running"}


@contextlib.contextmanager
def _connect() -> Iterator[Any]:
    """A client of the scheduler, which passes on all results, so that nothing connects to the nodes."""
    url = os.environ[VARIABLE]
    scheduler_address(url)
    try:
        distributed: Any = importlib.import_module("distributed")
    except ImportError as error:
        raise _unavailable("The package distributed is not installed (the extra: cluster).", error) from error
    client = distributed.Client(url, timeout=_CONNECT_S, set_as_default=False, direct_to_workers=False)
    try:
        yield client
    finally:
        client.close(timeout=_PAUSE_S)


def _result_of(future: Any) -> Any:
    try:
        return future.result()
    except _LOST:
        raise
    except Exception as error:
        if type(error).__name__ == "KilledWorker":
            return None
        raise _unavailable("A node of the Dask cluster cannot compute a part of the result.", error) from error


def _unavailable(message: str, error: BaseException) -> Unavailable:
    return Unavailable("cluster-unavailable", message, [Fault(VARIABLE, f"{type(error).__name__}: {error}"[:300])])
