"""Process of one stream: ``python -m stridelab.service.api.stream.child PARENT MEMORY_MB``.

It reads messages (``messages.Parcel``) from standard input, the configuration first, and answers each with one message
on standard output, until the input ends or an error occurs. It ends with its parent and cannot write files
(``sandbox``).
"""

import faulthandler
import json
import os
import sys
import traceback
from typing import BinaryIO

from stridelab.errors import StridelabError
from stridelab.schemas.streams import StreamAnswer, StreamConfiguration
from stridelab.service.api.stream.messages import HEADER, PROBLEM, TEXT, Parcel
from stridelab.service.processes.child import forbid_core_files, limit_memory
from stridelab.service.processes.parent_death import die_with_parent
from stridelab.service.processes.sandbox import STRICT, confine_process


def main(parent_pid: int, memory_mb: int) -> None:
    """Answer messages until the input ends."""
    die_with_parent(parent_pid)
    forbid_core_files()
    wire = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # library output goes to the log, not between the answers
    faulthandler.enable()
    try:
        serve_messages(sys.stdin.buffer, wire, memory_mb)
    except StridelabError as error:
        faults = [{"where": fault.where, "message": fault.message} for fault in error.faults]
        _write_problem(wire, type(error).__name__, {"code": error.code, "detail": error.message, "errors": faults})
    except BaseException as error:  # noqa: BLE001 (every error is reported to the parent)
        traceback.print_exc()
        detail = f"The estimator stopped with an unexpected error ({type(error).__name__})."
        _write_problem(wire, None, {"code": "stream-failed", "detail": detail, "errors": []})
    sys.stderr.flush()
    os._exit(0)


def serve_messages(source: BinaryIO, wire: BinaryIO, memory_mb: int) -> None:
    """Answer the messages of ``source`` on ``wire``."""
    from stridelab.service.api.stream.session import StreamSession

    confine_process(STRICT, None)
    first = _read_message(source)
    if first is None:
        return
    session = StreamSession(StreamConfiguration.model_validate_json(first.content))
    limit_memory(memory_mb)  # after the imports, which depend on the method
    ready = StreamAnswer(ready=session.ready).model_dump_json(exclude_none=True)
    wire.write(Parcel(TEXT, ready.encode()).to_bytes())
    while (parcel := _read_message(source)) is not None:
        wire.write(session.answer_message(parcel).to_bytes())


def _read_message(source: BinaryIO) -> Parcel | None:
    header = source.read(HEADER.size)
    if len(header) < HEADER.size:
        return None
    kind, samples, size = HEADER.unpack(header)
    return Parcel(kind, source.read(size), samples)


def _write_problem(wire: BinaryIO, raised: str | None, problem: dict[str, object]) -> None:
    wire.write(Parcel(PROBLEM, json.dumps({"raised": raised, "problem": problem}).encode()).to_bytes())


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
