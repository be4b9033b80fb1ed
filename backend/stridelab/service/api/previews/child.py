"""The process that answers directly: ``python -m stridelab.service.api.previews.child PARENT MEMORY_MB``.

It reads one question per line of its standard input and answers each with one line on its standard output: a number and
a value, or a problem. It ends with its parent, can write no file (``sandbox``), and ends when it has not been asked for
``IDLE_S``.
"""

import faulthandler
import json
import os
import signal
import sys
import traceback
from collections.abc import Callable
from typing import IO, Any, Final

from stridelab.errors import StridelabError
from stridelab.service.processes.child import forbid_core_files, limit_memory
from stridelab.service.processes.parent_death import die_with_parent
from stridelab.service.processes.sandbox import STRICT, confine

Json = dict[str, Any]
IDLE_S: Final = 600


def main(parent_pid: int, memory_mb: int) -> None:
    """Answer until there is nothing more to answer."""
    die_with_parent(parent_pid)
    forbid_core_files()
    wire = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what libraries print belongs into the log, not between the answers
    faulthandler.enable()
    from stridelab.service.api.previews import preview  # before the limit: it counts from what the libraries take

    limit_memory(memory_mb)
    confine(STRICT, None)
    converse(sys.stdin, wire, preview.answer)
    sys.stderr.flush()
    os._exit(0)


def converse(source: IO[str], wire: IO[str], answer: Callable[[Json], Json]) -> None:
    """Answer the lines of ``source`` on ``wire``; silence ends the process."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    while True:
        signal.alarm(IDLE_S)
        line = source.readline()
        signal.alarm(0)
        if not line:
            return
        question: Json = json.loads(line)
        said = {"number": question.pop("number"), **told(question, answer)}
        wire.write(json.dumps(said, allow_nan=False) + "\n")
        wire.flush()


def told(question: Json, answer: Callable[[Json], Json]) -> Json:
    """The answer's value, or the problem in its place."""
    try:
        return {"value": answer(question)}
    except StridelabError as error:
        faults = [{"where": fault.where, "message": fault.message} for fault in error.faults]
        return {
            "problem": {"code": error.code, "detail": error.message, "errors": faults},
            "raised": type(error).__name__,
        }
    except Exception as error:  # noqa: BLE001 (whatever goes wrong here, the other end hears of it)
        traceback.print_exc()
        detail = f"The planner stopped with an unexpected error ({type(error).__name__})."
        return {"problem": {"code": "preview-failed", "detail": detail, "errors": []}, "raised": None}


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
