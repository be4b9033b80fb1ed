"""The process in which one computation runs, forked from one that has imported what it needs (``forking``).

It waits for one task on its wire, answers on it, and ends. JSON lines only, both ways; files lie in the task's folder.
It ends with its parent, has a session of its own (so that what it starts can be killed with it), little priority
unless it reads what somebody has just sent, one thread per library, and no secrets in its environment. Before it looks
at a file it gives up everything else that it could reach (``sandbox``). This module imports no library but the standard
one.
"""

import contextlib
import errno
import faulthandler
import importlib
import io
import json
import os
import resource
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any, Final, NoReturn

from stridelab.cores import limit_cores
from stridelab.service.processes.priority import yield_processor
from stridelab.service.processes.sandbox import Sandbox, confine

NAME: Final = "stridelab-job"
"""What the system calls a child that computes, to tell it from the process that it was forked from."""
_MIN_PROGRESS_S = 0.02
_own_pages = -1
"""A descriptor of /proc/self/statm, for forks of this process that may no longer open theirs."""


def live(wire: int, niceness: int) -> NoReturn:
    """Wait for one task on the socket ``wire``, do it, answer."""
    if niceness > 0:
        yield_processor(niceness)
    _be_known()
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(line_buffering=True)  # line by line, so that a killed child's last words are kept
    faulthandler.enable()
    heard, told = os.fdopen(wire, encoding="utf-8"), os.fdopen(os.dup(wire), "w", encoding="utf-8")
    _send(told, {"ready": os.getpid(), "held_bytes": _pages(1)})
    line = heard.readline()
    if line:
        _send(told, answer(json.loads(line), told))
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)  # no finalisers of native libraries: the answer is out


def answer(task: dict[str, Any], wire: IO[str]) -> dict[str, Any]:
    """What the computation returned, or what went wrong in it."""
    from stridelab.errors import StridelabError

    folder = Path(task["folder"])
    os.chdir(folder)
    limit_memory(int(task["memory_mb"]))
    limit_cores(task["cores"])
    try:
        module, _, function = task["target"].partition(":")
        run = getattr(importlib.import_module(module), function)
        if task["sandbox"] is not None:
            _keep_own_pages()
            confine(Sandbox(**task["sandbox"]), folder)
        value = run(task["task"], folder, _reporter(wire))
        return {"value": json.loads(json.dumps(value, allow_nan=False))}
    except MemoryError:
        _without_limit()
        traceback.print_exc()
        return {"memory": True}
    except StridelabError as error:
        faults = [{"where": fault.where, "message": fault.message} for fault in error.faults]
        problem = {"code": error.code, "detail": error.message, "errors": faults}
        return {"problem": problem, "raised": type(error).__name__}
    except BaseException as error:  # noqa: BLE001 (whatever a computation does, its parent hears of it)
        _without_limit()
        traceback.print_exc()
        said = str(error).splitlines()[0][:300] if str(error) else "no message"
        detail = f"The computation stopped with an unexpected error ({type(error).__name__}: {said})."
        full = isinstance(error, OSError) and error.errno == errno.ENOSPC
        code = "scratch-full" if full else "computation-failed"
        return {"problem": {"code": code, "detail": detail, "errors": []}, "raised": None}


def _reporter(wire: IO[str]) -> Callable[[float, str], None]:
    last, stage = 0.0, ""

    def report(fraction: float, message: str = "") -> None:
        nonlocal last, stage
        now = time.monotonic()
        # The first word from a new stage ("whole body: ...") is never dropped: it may be the last that is heard.
        new_stage, colon, _ = str(message).partition(":")
        if now - last >= _MIN_PROGRESS_S or fraction >= 1.0 or (colon and new_stage != stage):
            last, stage = now, new_stage
            _send(wire, {"progress": [min(max(float(fraction), 0.0), 1.0), str(message)[:500]]})

    return report


def _send(wire: IO[str], message: dict[str, Any]) -> None:
    wire.write(json.dumps(message) + "\n")
    wire.flush()


def forbid_core_files() -> None:
    """A crash leaves no memory image of somebody's data on the disk."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _be_known() -> None:
    """Have a name, and be the first to go where memory is short."""
    for file, text in (("oom_score_adj", "1000"), ("comm", NAME)):
        with contextlib.suppress(OSError):  # not Linux, or not allowed: the memory limit still holds
            Path("/proc/self", file).write_text(text, encoding="ascii")


def limit_memory(memory_mb: int) -> None:
    """Let ``memory_mb`` be reserved beyond what the imported libraries have reserved already."""
    limit = _pages(0) + (memory_mb << 20)
    with contextlib.suppress(ValueError, OSError):  # a lower hard limit is set already
        resource.setrlimit(resource.RLIMIT_AS, (limit, resource.getrlimit(resource.RLIMIT_AS)[1]))


def _pages(column: int) -> int:
    """Bytes that this process has reserved (column 0) or holds (1); 0 where the system does not tell.

    A fork of a confined child has to take what that has: it began with the same.
    """
    with contextlib.suppress(OSError):
        return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[column]) * resource.getpagesize()
    with contextlib.suppress(OSError):
        return int(os.pread(_own_pages, 256, 0).split()[column]) * resource.getpagesize()
    return 0


def _keep_own_pages() -> None:
    global _own_pages
    with contextlib.suppress(OSError):  # not Linux
        _own_pages = os.open("/proc/self/statm", os.O_RDONLY | os.O_CLOEXEC)


def _without_limit() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (resource.getrlimit(resource.RLIMIT_AS)[1],) * 2)
