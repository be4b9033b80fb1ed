"""Durable writes to a folder: a file and its name are on the disk before a row refers to it.

A written or renamed file is at first only in the page cache. ``fsync`` of the file writes its content to the disk,
``fsync`` of its folder the directory entry (POSIX; T. S. Pillai et al., "All file systems are not created equal", OSDI
2014). PostgreSQL does the same for its rows, so files are written first.
"""

import os
import secrets
import shutil
from pathlib import Path
from typing import Final, Protocol, runtime_checkable

_TRIES: Final = 5
"""Maximum attempts of a write: a concurrent deletion may remove the target folder when it becomes empty."""


@runtime_checkable
class FileSystem(Protocol):
    """File operations of a durable write. Tests replace it by one that loses unsynchronised data."""

    def make_folder(self, folder: Path) -> None:
        """Create one folder unless it exists."""

    def copy(self, source: Path, target: Path) -> None:
        """Write the bytes of ``source`` into a new file ``target``."""

    def sync(self, path: Path) -> None:
        """Synchronise the content of a file, or the entries of a folder, to the disk."""

    def rename(self, draft: Path, target: Path) -> None:
        """Rename ``draft`` to ``target``, replacing an existing file."""


class DiskFileSystem:
    """File operations of the operating system."""

    def make_folder(self, folder: Path) -> None:
        """``mkdir``."""
        folder.mkdir(exist_ok=True)

    def copy(self, source: Path, target: Path) -> None:
        """Write and close."""
        shutil.copyfile(source, target)

    def sync(self, path: Path) -> None:
        """``fsync``."""
        handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)

    def rename(self, draft: Path, target: Path) -> None:
        """``rename``."""
        draft.replace(target)


DISK: Final = DiskFileSystem()


def write_durably(root: Path, key: str, source: Path, system: FileSystem = DISK) -> None:
    """Store a copy of ``source`` as ``root/key``, atomically and synchronised to the disk.

    Raises ``OSError``, in which case no partial file has the name ``key``.
    """
    target = root / key
    # drafts are named like those of obstore's LocalStore, which omits them from listings
    draft = target.with_name(f"{target.name}#{secrets.randbelow(10**12)}")
    for attempt in range(_TRIES):
        try:
            _make_folders(root, target.parent, system)
            try:
                system.copy(source, draft)
                system.sync(draft)
                system.rename(draft, target)
            except BaseException:
                draft.unlink(missing_ok=True)
                raise
            system.sync(target.parent)
        except FileNotFoundError:
            if attempt + 1 == _TRIES or not source.exists():
                raise
        else:
            return


def sync_durably(root: Path, key: str, system: FileSystem = DISK) -> None:
    """Synchronise an existing file and all its parent folders up to ``root`` to the disk. Raises ``OSError``."""
    target = root / key
    system.sync(target)
    for folder in target.parents:
        system.sync(folder)
        if folder == root:
            return


def _make_folders(root: Path, folder: Path, system: FileSystem) -> None:
    """Create missing folders between ``root`` and ``folder`` and synchronise the entry of each to the disk.

    Existing folders are synchronised too: another process may have created one without having synchronised it yet.
    """
    parents = [root, *(root / part for part in reversed(folder.relative_to(root).parents) if str(part) != ".")]
    for parent, child in zip(parents, [*parents[1:], folder], strict=True):
        system.make_folder(child)
        system.sync(parent)
