"""A child process for computations, forked from a server that has imported its libraries (``fork_server``).

It receives one task or many on its socket and answers on it (``running_child`` describes the messages); files lie in
the folder of its setup. The child ends with its parent, leads a session (so that its own children can be killed with
it), has low priority unless a client waits for it, one thread per library, and no secrets in its environment. Before it
opens a file it enters its sandbox (``sandbox``). This module imports the standard library only.
"""

import contextlib
import faulthandler
import importlib
import io
import json
import os
import resource
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any, Final, NoReturn

from stridelab.errors import StorageFull, StridelabError, is_disk_full, problem_of, scratch_full_error
from stridelab.machine.cluster import leave_cluster, resolve_scheduler
from stridelab.machine.cores import limit_cores
from stridelab.service.processes.priority import lower_priority, raise_priority
from stridelab.service.processes.sandbox import Sandbox, confine_process

PROCESS_NAME: Final = "stridelab-job"
"""Process name of a child, to distinguish it from the fork server."""
PREPARATIONS: Final = {"robot.json": "stridelab.service.kinds.robots.staged:use_staged_robot"}
"""Functions to call with the folder of a task that holds the named file, before the task."""
_MIN_PROGRESS_S = 0.02
_statm_fd = -1
"""A descriptor of /proc/self/statm, for forks of a confined process, which may not open their own."""


def run_child(wire: int, niceness: int) -> NoReturn:
    """Receive the setup and the tasks on the socket ``wire`` and answer them."""
    if niceness > 0:
        lower_priority(niceness)
    elif niceness < 0:
        raise_priority(niceness)
    _set_name_and_oom_score()
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(line_buffering=True)  # so that the output of a killed child is not lost
    faulthandler.enable()
    reader, writer = os.fdopen(wire, encoding="utf-8"), os.fdopen(os.dup(wire), "w", encoding="utf-8")
    _send_message(writer, {"ready": os.getpid(), "held_bytes": _memory_bytes(1)})
    setup = reader.readline()
    if setup:
        serve_tasks(json.loads(setup), reader, writer)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)  # the answers are sent: skip finalisers of native libraries


def serve_tasks(setup: dict[str, Any], reader: IO[str], wire: IO[str]) -> None:
    """Answer the tasks of ``reader`` on ``wire``: one, or all until the input ends or memory runs out.

    Without a task for ``idle_s`` of the setup, if not 0, SIGALRM ends the process.
    """
    folder = None if setup["folder"] is None else Path(setup["folder"])
    work: Callable[..., Any] | None = None
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    while True:
        signal.alarm(setup["idle_s"])
        line = reader.readline()
        signal.alarm(0)
        if not line:
            return
        request = json.loads(line)

        def answer(request: dict[str, Any] = request) -> Any:
            nonlocal work
            work = work or _prepare_work(setup, folder)
            return work(request["task"], folder, _progress_reporter(wire, request["number"]))

        message = answer_or_problem(answer)
        _send_message(wire, {"number": request["number"], **message})
        if setup["once"] or "memory" in message:
            return


def _prepare_work(setup: dict[str, Any], folder: Path | None) -> Callable[..., Any]:
    """Import the target, limit this process and confine it; an object is created of a target that is a class."""
    if folder is not None:
        os.chdir(folder)
    target = _import_object(setup["target"])
    limit_memory(int(setup["memory_mb"]))
    limit_cores(setup["cores"])
    if setup["sandbox"] is not None:
        _open_statm()
        if setup["sandbox"]["connects"] is None:
            leave_cluster()
        else:
            resolve_scheduler()
        confine_process(Sandbox(**setup["sandbox"]), folder)
    return target() if isinstance(target, type) else with_json(target)


def _import_object(path: str) -> Any:
    module, _, name = path.partition(":")
    return getattr(importlib.import_module(module), name)


def with_json(run: Callable[..., Any]) -> Callable[..., Any]:
    """``run(task, folder, progress)`` with JSON on both sides, if its task is annotated with a model of pydantic."""
    model: Any = run.__annotations__.get("task")
    if not hasattr(model, "model_validate"):
        return run

    def run_with_json(task: Any, folder: Path, progress: Callable[[float, str], None]) -> Any:
        for name, prepare in PREPARATIONS.items():
            if (folder / name).is_file():
                _import_object(prepare)(folder)
        return run(model.model_validate(task), folder, progress).to_json()

    return run_with_json


def answer_or_problem(compute: Callable[[], Any]) -> dict[str, Any]:
    """Call ``compute``; returns a message with its value or its problem."""
    try:
        value = compute()
        json.dumps(value, allow_nan=False)  # raises here what is no JSON
        return {"value": value}
    except MemoryError:
        with _without_memory_limit():
            traceback.print_exc()
        return {"memory": True}
    except StridelabError as error:
        return {"problem": problem_of(error), "raised": type(error).__name__}
    except BaseException as error:  # noqa: BLE001 (any error of the computation is reported to the parent)
        with _without_memory_limit():
            traceback.print_exc()
        if is_disk_full(error):
            return {"problem": problem_of(scratch_full_error()), "raised": StorageFull.__name__}
        summary = str(error).splitlines()[0][:300] if str(error) else "no message"
        detail = f"The computation stopped with an unexpected error ({type(error).__name__}: {summary})."
        return {"problem": {"code": "computation-failed", "detail": detail, "errors": []}, "raised": None}


def _progress_reporter(wire: IO[str], number: int) -> Callable[[float, str], None]:
    last, stage = 0.0, ""

    def send_progress(fraction: float, message: str = "") -> None:
        nonlocal last, stage
        now = time.monotonic()
        # The first message of a new stage ("whole body: ...") is never dropped: it may be the last one.
        new_stage, colon, _ = str(message).partition(":")
        if now - last >= _MIN_PROGRESS_S or fraction >= 1.0 or (colon and new_stage != stage):
            last, stage = now, new_stage
            progress = [min(max(float(fraction), 0.0), 1.0), str(message)[:500]]
            _send_message(wire, {"number": number, "progress": progress})

    return send_progress


def _send_message(wire: IO[str], message: dict[str, Any]) -> None:
    wire.write(json.dumps(message) + "\n")
    wire.flush()


def forbid_core_files() -> None:
    """Disable core dumps, which would write user data to the disk."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _set_name_and_oom_score() -> None:
    """Set the process name, and make this process the first victim of the out-of-memory killer."""
    for file, text in (("oom_score_adj", "1000"), ("comm", PROCESS_NAME)):
        with contextlib.suppress(OSError):  # not Linux, or not allowed: the memory limit still holds
            Path("/proc/self", file).write_text(text, encoding="ascii")


def limit_memory(memory_mb: int) -> None:
    """Limit the address space to ``memory_mb`` beyond the present size, which includes the imported libraries."""
    limit = _memory_bytes(0) + (memory_mb << 20)
    with contextlib.suppress(ValueError, OSError):  # a lower hard limit is set already
        resource.setrlimit(resource.RLIMIT_AS, (limit, resource.getrlimit(resource.RLIMIT_AS)[1]))


def _memory_bytes(column: int) -> int:
    """Virtual (column 0) or resident (1) memory of this process in bytes; 0 where the system does not provide it.

    A fork of a confined child uses the values of that child, from which it started.
    """
    with contextlib.suppress(OSError):
        return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[column]) * resource.getpagesize()
    with contextlib.suppress(OSError):
        return int(os.pread(_statm_fd, 256, 0).split()[column]) * resource.getpagesize()
    return 0


def _open_statm() -> None:
    global _statm_fd
    with contextlib.suppress(OSError):  # not Linux
        _statm_fd = os.open("/proc/self/statm", os.O_RDONLY | os.O_CLOEXEC)


@contextlib.contextmanager
def _without_memory_limit() -> Iterator[None]:
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (hard, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
