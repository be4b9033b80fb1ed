"""Computations for tests: functions for a job's child process, some of which misbehave."""

import ctypes
import os
import sys
import time
from pathlib import Path
from typing import Any

from stridelab.errors import Fault, NotEstimable
from stridelab.machine.cores import usable_cores


def add(task: dict[str, Any], _folder: Path, progress: Any) -> dict[str, Any]:
    print("adding")
    progress(0.5, "half")
    return {"sum": task["a"] + task["b"]}


def write_outcome(task: dict[str, Any], folder: Path, progress: Any) -> dict[str, Any]:
    """A whole job: works for ``work_s``, leaves a file, notes every start and end in ``diary``."""
    _note(task, "start")
    steps = max(1, round(task.get("work_s", 0.0) / 0.05))
    for step in range(steps):
        time.sleep(task.get("work_s", 0.0) / steps)
        progress((step + 1) / steps, f"step {step + 1}")
    (folder / "numbers.csv").write_text("time_s\n0.0\n", encoding="utf-8")
    _note(task, "end")
    artifacts = [{"name": "numbers.csv", "media_type": "text/csv"}]
    return {"summary": {"answer": 42}, "references": [], "artifacts": artifacts}


def show_parts(task: dict[str, Any], folder: Path, progress: Any) -> dict[str, Any]:
    """Writes parts, with ``task["file"]`` another file in place of the third one, and waits to be released."""
    # imported here: models take longer to import than most of these functions take
    from stridelab.schemas.previews import PartialMotion
    from stridelab.service.kinds.partial_results import MAX_CHUNK_BYTES, PARTIAL_FOLDER, PartialWriter, chunk_name

    writer = PartialWriter(folder)
    for k in range(task.get("n", 2)):
        writer.write(PartialMotion(run=k + 1, time_s=[0.0], poses=[[(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)]]))
    third = folder / PARTIAL_FOLDER / chunk_name(3)
    match task.get("file"):
        case "link":
            third.symlink_to("/etc/hostname")
        case "pipe":
            os.mkfifo(third)
        case "folder":
            third.mkdir()
        case "large":
            third.write_bytes(b" " * (MAX_CHUNK_BYTES + 1))
        case "other":
            third.write_text('{"kind": "motion"}')
        case "text":
            third.write_bytes(b"\xff")
        case "replaced":
            (folder / PARTIAL_FOLDER).rename(folder / "old")
            (folder / PARTIAL_FOLDER).symlink_to(task["elsewhere"])
    if task.get("file"):
        (folder / PARTIAL_FOLDER / chunk_name(4)).write_text('{"kind": "certificate", "checks": [], "passed": true}')
    while not Path(task["release"]).exists():
        progress(0.5, "waiting")
        time.sleep(0.05)
    return {"summary": {"answer": 42}, "references": [], "artifacts": []}


def _note(task: dict[str, Any], word: str) -> None:
    if task.get("diary"):
        with Path(task["diary"]).open("a", encoding="utf-8") as diary:
            diary.write(f"{task['name']} {word}\n")


def stop_half_way(_task: dict[str, Any], folder: Path, _progress: Any) -> dict[str, Any]:
    """Fail, and leave what there is until then."""
    (folder / "half.csv").write_text("time_s\n0.0\n")
    problem = {
        "code": "stopped",
        "detail": "It cannot go on.",
        "errors": [{"where": "phases[1]", "message": "at 0.0 s"}],
    }
    artifacts = [{"name": "half.csv", "media_type": "text/csv"}]
    return {"summary": {"until_s": 0.5}, "references": [], "artifacts": artifacts, "problem": problem}


def refuse(_task: dict[str, Any], _folder: Path, _progress: Any) -> None:
    raise NotEstimable("no-plates", "The recording has no plates.", [Fault("plates", "none")])


def stumble(_task: dict[str, Any], _folder: Path, _progress: Any) -> None:
    raise ValueError("something unforeseen")


def not_a_number(_task: dict[str, Any], _folder: Path, _progress: Any) -> dict[str, float]:
    return {"x": float("nan")}


def segfault(_task: dict[str, Any], _folder: Path, _progress: Any) -> None:
    ctypes.string_at(0)


def abort(_task: dict[str, Any], _folder: Path, _progress: Any) -> None:
    os.abort()


def leave(_task: dict[str, Any], _folder: Path, _progress: Any) -> None:
    os._exit(3)


def reserve(task: dict[str, Any], _folder: Path, _progress: Any) -> int:
    return len(bytearray(int(task["bytes"])))


def hoard(_task: dict[str, Any], _folder: Path, _progress: Any) -> None:
    """Hold more memory than allowed without reserving more address space than allowed: in its own children."""
    for _ in range(4):
        if os.fork() == 0:
            held = bytearray(100 << 20)
            time.sleep(60)
            os._exit(len(held) % 2)
    time.sleep(60)


def share(_task: dict[str, Any], _folder: Path, _progress: Any) -> int:
    """Hold a block that children see too, long enough for the memory of all of them to be looked at."""
    block = bytearray(os.urandom(1 << 20)) * 150
    for _ in range(4):
        if os.fork() == 0:
            time.sleep(60)
            os._exit(block[0] % 2)
    time.sleep(3.0)
    return len(block)


def cores(_task: dict[str, Any], _folder: Path, _progress: Any) -> int:
    return usable_cores()


def hang(_task: dict[str, Any], _folder: Path, _progress: Any) -> None:
    """A native call that holds the interpreter and never returns."""
    ctypes.PyDLL(None).sleep(600)


def compute_for_ever(_task: dict[str, Any], _folder: Path, _progress: Any) -> None:
    """Uses a core as long as it has one."""
    while True:
        pass


def wait_a_second(_task: dict[str, Any], _folder: Path, _progress: Any) -> None:
    """Uses no processor time for a second, as a process that gets no core."""
    time.sleep(1.0)


def hang_in_a_stage(_task: dict[str, Any], _folder: Path, progress: Any) -> None:
    """Two stages; the second says one thing, right after the first, and hangs."""
    progress(0.1, "check: looking at it")
    progress(0.2, "check: still looking")
    progress(0.3, "centroidal: solving")
    ctypes.PyDLL(None).sleep(600)


def stumble_in_a_stage(_task: dict[str, Any], _folder: Path, progress: Any) -> None:
    progress(0.3, "centroidal: solving")
    raise ValueError("something unforeseen")


def spin(_task: dict[str, Any], _folder: Path, progress: Any) -> None:
    progress(0.1, f"pid {os.getpid()}")
    while True:
        pass


def crunch(task: dict[str, Any], _folder: Path, _progress: Any) -> dict[str, Any]:
    """Compute, and nothing else."""
    for _ in range(int(task["turns"])):
        pass
    return {"summary": {}, "references": [], "artifacts": []}


def with_a_grandchild(_task: dict[str, Any], _folder: Path, progress: Any) -> None:
    pid = os.fork()
    if pid == 0:
        time.sleep(600)
    progress(0.1, f"pid {pid}")
    time.sleep(600)


def die_before_a_grandchild(_task: dict[str, Any], _folder: Path, _progress: Any) -> None:
    if os.fork() == 0:
        time.sleep(600)  # with the wire and the log open
    ctypes.string_at(0)


def chatter(task: dict[str, Any], _folder: Path, _progress: Any) -> dict[str, int]:
    os.write(2, b"x" * int(task["bytes"]))
    os.write(1, b"last words\n")
    return {"written": int(task["bytes"])}


def environment(_task: dict[str, Any], folder: Path, _progress: Any) -> dict[str, Any]:
    return {
        "names": sorted(os.environ),
        "nice": os.nice(0),
        "session": os.getsid(0) == os.getpid(),
        "cwd": str(Path.cwd()) == str(folder),
        "threads": os.environ.get("OPENBLAS_NUM_THREADS"),
    }


def inheritance(task: dict[str, Any], _folder: Path, _progress: Any) -> dict[str, Any]:
    """Modules that are not imported or needlessly are, and the threads of the process that this one was forked from."""
    threads = Path(f"/proc/{os.getppid()}/task")
    return {
        "missing": [name for name in task["modules"] if name not in sys.modules],
        "needless": [name for name in task["needless"] if name in sys.modules],
        "threads_of_the_nursery": len(list(threads.iterdir())) if threads.exists() else 1,
    }


def mark(task: dict[str, Any], _folder: Path, _progress: Any) -> dict[str, Any]:
    """Say that the computation has begun."""
    Path(task["mark"]).touch()
    return {"summary": {}, "references": [], "artifacts": []}


def echo(task: dict[str, Any], _folder: Path, progress: Any) -> dict[str, Any]:
    """Report progress each time the file ``mark`` appears, until it appears with something in it."""
    signal, heard = Path(task["mark"]), 0
    while True:
        if signal.exists():
            stop = signal.stat().st_size > 0
            signal.unlink()
            if stop:
                return {"summary": {}, "references": [], "artifacts": []}
            heard += 1
            progress(0.5, f"heard {heard}")
        time.sleep(0.0005)


class Counter:
    """Counts the tasks of its child."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self, task: dict[str, Any], _folder: Path | None, _progress: Any) -> dict[str, Any]:
        self.count += 1
        how = task.get("how")
        if how == "refuse":
            raise NotEstimable("no-plates", "The recording has no plates.", [Fault("plates", "none")])
        if how == "stumble":
            raise ValueError("something unforeseen")
        if how == "hoard":
            return {"bytes": len(bytearray(task["bytes"]))}
        if how == "abort":
            os.abort()
        if how == "disconnect":
            os.closerange(3, 64)
            time.sleep(600)
        time.sleep(task.get("wait_s", 0.0))
        return {"count": self.count, "pid": os.getpid()}
