"""Folders in which jobs and uploads work on files; what a killed process left behind is removed by the next one."""

import fcntl
import os
import shutil
import time
import uuid
from pathlib import Path
from types import TracebackType

from stridelab.service.data_folder import explained

BEAT_FILE = "worker.beat"
"""Touched in the data folder whenever the worker has told the database that it lives; health checks look at its age."""
_LOCK = ".lock"
_UNLOCKED_S = 3600.0
"""A folder without a lock that is older than this was not locked in time, or is of a version that had no locks."""


class WorkFolder:
    """A folder of this process's own below ``root``, held by a lock and removed at the end. A context manager.

    Raises ``Unavailable`` (``data-folder-unusable``, ``disk-full``) where it cannot be made.
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        self._folder = root / uuid.uuid4().hex[:12]
        self._lock = -1

    def __enter__(self) -> Path:
        with explained(self._root):
            return self._enter()

    def _enter(self) -> Path:
        self._root.mkdir(mode=0o700, parents=True, exist_ok=True)
        for left in self._root.iterdir():
            _remove_if_abandoned(left)
        while True:
            self._folder.mkdir(mode=0o700)
            self._lock = os.open(self._folder / _LOCK, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
            fcntl.flock(self._lock, fcntl.LOCK_EX)
            if (self._folder / _LOCK).exists():
                return self._folder
            os.close(self._lock)  # another process that starts has removed it between the two calls

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)
        os.close(self._lock)


def _remove_if_abandoned(folder: Path) -> None:
    try:
        lock = os.open(folder / _LOCK, os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        _remove_if_old(folder)  # else it is just being made
        return
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        shutil.rmtree(folder, ignore_errors=True)
    except OSError:
        return  # somebody works there
    finally:
        os.close(lock)


def _remove_if_old(folder: Path) -> None:
    try:
        if time.time() - folder.stat().st_mtime > _UNLOCKED_S:
            shutil.rmtree(folder, ignore_errors=True)
    except OSError:
        return  # gone meanwhile
