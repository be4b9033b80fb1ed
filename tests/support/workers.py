"""The processes of ``stridelab.parallel``: forked from this one, or by the server of a process with threads."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import psutil


def workers() -> list[psutil.Process]:
    """The running processes, without the server and helper of ``multiprocessing`` and the database of other tests."""
    found = []
    for child in psutil.Process().children():
        line = " ".join(child.cmdline())
        if "multiprocessing.forkserver" in line:
            found += child.children()
        elif "multiprocessing.resource_tracker" not in line and child.name() != "postgres":
            found.append(child)
    return found


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
