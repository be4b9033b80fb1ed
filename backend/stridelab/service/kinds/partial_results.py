"""Parts of a result that a computation shows before it has ended.

The child writes each part as one JSON file (a ``PartialChunk``) into a folder that the worker has created, under a
temporary name that it then changes: a reader sees whole files only. The worker stores them (``jobs.partial_results``).
"""

import contextlib
from pathlib import Path
from typing import Final

from pydantic import BaseModel

PARTIAL_FOLDER: Final = "partial"
"""Folder in that of a job; without it, as on the command line, nothing is written."""
MAX_CHUNK_BYTES: Final = 512 << 10
"""Size of one part; a larger one is not stored."""
MAX_ATTEMPT_BYTES: Final = 64 << 20
"""Size of all parts of one attempt; later ones are not stored."""


def chunk_name(number: int) -> str:
    """File name of a part; numbers begin at 1."""
    return f"{number:06d}.json"


class PartialWriter:
    """Writes the parts of one computation below ``folder``; ``next_number`` is that of the next one."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder / PARTIAL_FOLDER
        self.next_number = 1
        self._is_open = self._folder.is_dir()

    @property
    def is_open(self) -> bool:
        """Whether parts are written."""
        return self._is_open

    def write(self, chunk: BaseModel) -> None:
        """Write one part. A full disk ends the parts, and not the computation."""
        if not self._is_open:
            return
        part = self._folder / ".part"
        try:
            part.write_text(chunk.model_dump_json(), encoding="utf-8")
            part.replace(self._folder / chunk_name(self.next_number))
        except OSError:
            self._is_open = False
            with contextlib.suppress(OSError):
                part.unlink(missing_ok=True)
            return
        self.next_number += 1
