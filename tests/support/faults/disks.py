"""A file system that loses at a power cut what was not synchronised, as POSIX allows it to.

Every operation is done for real, and noted. What is on the "disk" is kept apart: the content that a file had at its
last ``sync``, and the entries that a folder had at its last ``sync``. A name that was not synchronised is gone after
the cut; a name that was, of a file whose content was not, names an empty file.

File systems that are soon full.
"""

import shutil
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest


class VolatileFileSystem:
    """``stridelab.service.storage.local_files.FileSystem`` with a memory of what is on the disk below ``root``."""

    def __init__(self, root: Path, *, syncs: bool = True) -> None:
        self._root, self._syncs = root, syncs
        self._lock = threading.Lock()
        self._content: dict[int, bytes] = {}
        """By inode number."""
        self._entries: dict[Path, dict[str, int]] = {root: {}}
        """By folder: names, and the inodes behind them."""

    def make_folder(self, folder: Path) -> None:
        folder.mkdir(exist_ok=True)

    def copy(self, source: Path, target: Path) -> None:
        shutil.copyfile(source, target)

    def rename(self, draft: Path, target: Path) -> None:
        draft.replace(target)

    def sync(self, path: Path) -> None:
        if not self._syncs:
            return
        with self._lock:
            if path.is_dir():
                self._entries[path] = {child.name: child.stat().st_ino for child in path.iterdir()}
            else:
                self._content[path.stat().st_ino] = path.read_bytes()

    def after_power_cut(self) -> dict[str, bytes]:
        """Keys and content of the files that are there when the machine is on again."""
        with self._lock:
            return {str(path.relative_to(self._root)): content for path, content in self._below(self._root)}

    def _below(self, folder: Path) -> list[tuple[Path, bytes]]:
        contents: list[tuple[Path, bytes]] = []
        for name, inode in self._entries.get(folder, {}).items():
            path = folder / name
            if path in self._entries or path.is_dir():
                contents += self._below(path)
            else:
                contents.append((path, self._content.get(inode, b"")))
        return contents


@contextmanager
def mounted_folder(folder: Path, options: str) -> Iterator[Path]:
    """A file system in memory at ``folder``, which is made; the test is skipped where this machine mounts none."""
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", options, "stridelab-test", str(folder)]
    if subprocess.run(mount, capture_output=True, check=False).returncode != 0:
        pytest.skip("mounting a small file system needs root")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)
