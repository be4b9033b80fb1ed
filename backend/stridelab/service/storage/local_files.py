"""Files in a folder that survive a power cut: they are on the disk, under their name, before anybody names them.

A file that was written, or renamed, is at first only in the memory of the operating system. ``fsync`` of the file
puts its bytes on the disk, ``fsync`` of its folder the entry that holds its name (POSIX; T. S. Pillai et al., "All file
systems are not created equal", OSDI 2014). PostgreSQL does the same for its rows, so files come first.
"""

import os
import secrets
import shutil
from pathlib import Path
from typing import Final, Protocol, runtime_checkable

_TRIES: Final = 5
"""A deletion may remove a folder that has just become empty, while a file is about to be put there."""


@runtime_checkable
class FileSystem(Protocol):
    """What a durable write asks of the operating system. Tests have one that loses what was not synchronised."""

    def make_folder(self, folder: Path) -> None:
        """Make one folder; one that exists is fine."""

    def copy(self, source: Path, target: Path) -> None:
        """Write the bytes of ``source`` into a new file ``target``."""

    def sync(self, path: Path) -> None:
        """Put the content of a file, or the entries of a folder, on the disk."""

    def rename(self, draft: Path, target: Path) -> None:
        """Give ``draft`` the name ``target``, in place of a file that has it."""


class DiskFileSystem:
    """The operating system's."""

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
    """Store a copy of ``source`` as ``root/key``, replaced as a whole and on the disk when this returns.

    Raises ``OSError``; no half-written file has the name ``key`` then.
    """
    target = root / key
    # the name of a draft ends as those of the object store's own drafts do, which its listings leave out
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
    """Put a file that is there already on the disk, and all folders on the way to it. Raises ``OSError``."""
    target = root / key
    system.sync(target)
    for folder in target.parents:
        system.sync(folder)
        if folder == root:
            return


def _make_folders(root: Path, folder: Path, system: FileSystem) -> None:
    """Make what is missing between ``root`` and ``folder``, with the entry of each on the disk.

    A folder that is there may have been made a moment ago by somebody else, who has not synchronised it yet.
    """
    on_the_way = [root, *(root / part for part in reversed(folder.relative_to(root).parents) if str(part) != ".")]
    for parent, made in zip(on_the_way, [*on_the_way[1:], folder], strict=True):
        system.make_folder(made)
        system.sync(parent)
