"""Temporary folders of jobs and uploads; folders left by a killed process are removed by the next one."""

import fcntl
import os
import shutil
import time
import uuid
from pathlib import Path
from types import TracebackType

from stridelab.service.data_folder import explain_os_errors

HEARTBEAT_FILE = "worker.beat"
"""File in the data folder that is touched after every heartbeat of the worker; health checks read its age."""
_LOCK = ".lock"
_UNLOCKED_MAX_AGE_S = 3600.0
"""Age after which a folder without a lock file counts as abandoned."""


class WorkFolder:
    """Context manager: a locked folder of this process below ``root``, removed at exit.

    Raises ``Unavailable`` (``data-folder-unusable``, ``disk-full``) if it cannot be created.
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        self._folder = root / uuid.uuid4().hex[:12]
        self._lock = -1

    def __enter__(self) -> Path:
        with explain_os_errors(self._root):
            return self._create_locked()

    def _create_locked(self) -> Path:
        self._root.mkdir(mode=0o700, parents=True, exist_ok=True)
        for left in self._root.iterdir():
            _remove_if_abandoned(left)
        while True:
            self._folder.mkdir(mode=0o700)
            self._lock = os.open(self._folder / _LOCK, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
            fcntl.flock(self._lock, fcntl.LOCK_EX)
            if (self._folder / _LOCK).exists():
                return self._folder
            os.close(self._lock)  # another starting process removed the folder between the two calls

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)
        os.close(self._lock)


def _remove_if_abandoned(folder: Path) -> None:
    try:
        lock = os.open(folder / _LOCK, os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        _remove_if_old(folder)  # a recent one is just being created
        return
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        shutil.rmtree(folder, ignore_errors=True)
    except OSError:
        return  # in use
    finally:
        os.close(lock)


def _remove_if_old(folder: Path) -> None:
    try:
        if time.time() - folder.stat().st_mtime > _UNLOCKED_MAX_AGE_S:
            shutil.rmtree(folder, ignore_errors=True)
    except OSError:
        return  # already removed
