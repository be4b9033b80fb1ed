"""Processes of ``stridelab.machine.parallel``, and work that misbehaves in them; as a program, work that never ends."""

import os
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from threadpoolctl import threadpool_info

from stridelab.errors import Fault, NotEstimable
from stridelab.machine.parallel import map_in_order
from stridelab.service.kinds.base import Json


def workers() -> list[psutil.Process]:
    """The running processes: those with this command line, as a fork keeps it, and those of ``multiprocessing``.

    Databases and services that other tests leave open for this session have command lines of their own.
    """
    this = psutil.Process()
    processes = []
    for child in this.children():
        with suppress(psutil.NoSuchProcess):  # it has ended: a zombie, or gone
            if child.cmdline() == this.cmdline():
                processes.append(child)
            elif "multiprocessing.forkserver" in " ".join(child.cmdline()):
                processes += child.children()
    return processes


@contextmanager
def another_thread() -> Iterator[None]:
    """A second thread, with which a process must not fork itself."""
    end = threading.Event()
    thread = threading.Thread(target=end.wait, daemon=True)
    thread.start()
    try:
        yield
    finally:
        end.set()
        thread.join()


def square(piece: int) -> tuple[int, int]:
    return piece * piece, os.getpid()


def threads(_piece: int) -> list[int]:
    np.linalg.norm(np.eye(2))
    return [library["num_threads"] for library in threadpool_info()]


def fill_disk(_piece: int) -> None:
    Path("/dev/full").write_bytes(b"part of a result")


def refuse(piece: int) -> int:
    if piece == 2:
        raise NotEstimable("no-posture", "There is no posture.", [Fault("robot", "stiff")])
    return piece


def hog(_piece: int) -> int:
    raise MemoryError


def vanish(piece: int) -> int:
    if piece == 1:
        os._exit(3)
    return piece


def hang(piece: int) -> int:
    if piece > 1:
        time.sleep(600)
    return os.getpid()


def hang_noted(piece: int) -> int:
    Path(os.environ["NOTED"], str(os.getpid())).touch()
    time.sleep(600)
    return piece


def behave(item: Json) -> Json:
    """Do what ``item["how"]`` says."""
    how = item["how"]
    if how == "crash":
        os.abort()
    if how == "exit":
        os._exit(3)
    if how == "hang":
        time.sleep(60)
    if how == "refuse":
        raise NotEstimable("no-step", "There is no step.", [Fault("walk.c3d", "standing")])
    if how == "break":
        raise RuntimeError("unforeseen")
    if how == "interval":
        began_s = time.monotonic()
        time.sleep(0.5)
        return {"interval_s": [began_s, time.monotonic()]}
    if how == "large":
        return {"text": "x" * 3_000_000}
    return {"pid": os.getpid(), "twice": 2 * item["n"]}


def note_run(item: Json) -> Json:
    """Leave a file per run, named by item and process, and take some time."""
    Path(item["noted"], f"{item['n']}-{os.getpid()}").touch()
    time.sleep(item["seconds"])
    return {"n": item["n"]}


def read_beside(item: Json) -> Json:
    """The files in the folder of the item, and whether another file can be read."""
    folder = Path(item["folder"])
    try:
        other = Path(item["other"]).read_text(encoding="utf-8")
    except PermissionError:
        other = "refused"
    contents = {path.relative_to(folder).as_posix(): path.read_text() for path in folder.rglob("*") if path.is_file()}
    return {"files": contents, "other": other}


def connect_to(task: Json, _folder: Path, _progress: object) -> Json:
    """Which of the addresses accept a connection, and why others do not."""
    reachable = {}
    for host, port in task["addresses"]:
        try:
            socket.create_connection((host, port), timeout=5).close()
            reachable[f"{host}:{port}"] = "connected"
        except OSError as error:
            reachable[f"{host}:{port}"] = type(error).__name__
    return reachable


class Endless(dict[str, Any]):
    """A scenario that notes the process that reads it, and never answers."""

    def get(self, *_: object) -> Any:
        Path(os.environ["NOTED"], str(os.getpid())).touch()
        time.sleep(600)


def run_endless_grid() -> None:
    """Run a grid of climbs whose only case never ends."""
    from experiments.climbing_grid import Case, run_grid
    from stridelab.robots.loader import load_robot

    run_grid(load_robot("talos"), {}, [Case("endless", "stairs", Endless())], processes=1)


def main() -> None:
    """Never ends by itself; with the argument ``grid`` in a grid of climbs."""
    if sys.argv[1:] == ["grid"]:
        run_endless_grid()
    if os.environ["THREADS"] == "two threads":
        threading.Thread(target=time.sleep, args=(600,), daemon=True).start()
    list(map_in_order(hang_noted, 2, 2))


if __name__ == "__main__":
    main()
