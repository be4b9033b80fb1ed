"""Creates the data folder where it is missing and checks that it can be used."""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from stridelab.errors import StridelabError, Unavailable, is_disk_full

FIRST_START_BYTES: Final = 100_000_000
"""A new database takes about 70 MB with its log."""
LATER_START_BYTES: Final = 2_000_000


def open_data_folder(folder: Path, free_bytes: int = LATER_START_BYTES) -> None:
    """Create ``folder`` and check that it is writable.

    Raises ``Unavailable``: ``data-folder-unusable`` (not a folder, read-only, not permitted), ``disk-full`` if less
    than ``free_bytes`` are free.
    """
    with explain_os_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder, prefix=".probe-") as probe:
            probe.write(b"\0" * 4096)
            probe.flush()
        if shutil.disk_usage(folder).free < free_bytes:
            raise _disk_full_error(folder, free_bytes)


@contextmanager
def explain_os_errors(folder: Path) -> Iterator[None]:
    """Convert an ``OSError`` inside the block to ``Unavailable``, with the codes of ``open_data_folder``."""
    try:
        yield
    except OSError as error:
        if is_disk_full(error):
            raise _disk_full_error(folder, LATER_START_BYTES) from error
        where = f" ({error.filename})" if error.filename and str(error.filename) != str(folder) else ""
        reason = error.strerror or str(error)
        raise Unavailable(
            "data-folder-unusable",
            f"The data folder {folder} cannot be used: {reason}{where}. Make it a folder that this account may write "
            "to, or set STRIDELAB_DATA_DIR to another one.",
        ) from error


def _disk_full_error(folder: Path, free_bytes: int) -> StridelabError:
    return Unavailable(
        "disk-full",
        f"The disk of the data folder {folder} is full: a start needs {free_bytes / 1e6:.0f} MB there. Free some "
        "space, or set STRIDELAB_DATA_DIR to a folder on another disk.",
    )
