"""The processes of ``stridelab.parallel``: forked from this one, or by the server of a process with threads."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import psutil


def workers() -> list[psutil.Process]:
    """The running processes: those with this command line, as a fork keeps it, and those of ``multiprocessing``.

    Databases and services that other tests leave open for this session have command lines of their own.
    """
    this = psutil.Process()
    found = []
    for child in this.children():
        if child.cmdline() == this.cmdline():
            found.append(child)
        elif "multiprocessing.forkserver" in " ".join(child.cmdline()):
            found += child.children()
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
