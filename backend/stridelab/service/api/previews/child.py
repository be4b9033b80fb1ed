"""Resident process for plan previews: ``python -m stridelab.service.api.previews.child PARENT MEMORY_MB``.

It reads one JSON request per line from standard input and writes one JSON response per line to standard output: a
number, and a value or a problem. It ends with its parent or after ``IDLE_S`` without a request, and cannot write files
(``sandbox``).
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
from stridelab.service.processes.sandbox import STRICT, confine_process

Json = dict[str, Any]
IDLE_S: Final = 600


def main(parent_pid: int, memory_mb: int) -> None:
    """Answer requests until the input ends."""
    die_with_parent(parent_pid)
    forbid_core_files()
    wire = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # library output goes to the log, not between the responses
    faulthandler.enable()
    from stridelab.service.api.previews import preview  # imported before the limit, which counts from the current use

    limit_memory(memory_mb)
    confine_process(STRICT, None)
    serve_requests(sys.stdin, wire, preview.answer_request)
    sys.stderr.flush()
    os._exit(0)


def serve_requests(source: IO[str], wire: IO[str], answer: Callable[[Json], Json]) -> None:
    """Answer the lines of ``source`` on ``wire``; SIGALRM ends the process after ``IDLE_S`` without a line."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    while True:
        signal.alarm(IDLE_S)
        line = source.readline()
        signal.alarm(0)
        if not line:
            return
        question: Json = json.loads(line)
        response = {"number": question.pop("number"), **answer_or_problem(question, answer)}
        wire.write(json.dumps(response, allow_nan=False) + "\n")
        wire.flush()


def answer_or_problem(question: Json, answer: Callable[[Json], Json]) -> Json:
    """Call ``answer`` and return its value, or the problem if it fails."""
    try:
        return {"value": answer(question)}
    except StridelabError as error:
        faults = [{"where": fault.where, "message": fault.message} for fault in error.faults]
        return {
            "problem": {"code": error.code, "detail": error.message, "errors": faults},
            "raised": type(error).__name__,
        }
    except Exception as error:  # noqa: BLE001 (every error is reported to the parent)
        traceback.print_exc()
        detail = f"The planner stopped with an unexpected error ({type(error).__name__})."
        return {"problem": {"code": "preview-failed", "detail": detail, "errors": []}, "raised": None}


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
