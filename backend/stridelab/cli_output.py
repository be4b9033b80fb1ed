"""A result folder, or a single file, that appears whole or not at all."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from stridelab.errors import Conflict, Fault, InvalidInput

RESULT_FILE = "result.json"
REFERENCES_FILE = "references.bib"


@contextmanager
def result_folder(target: Path, *, force: bool) -> Iterator[Path]:
    """A temporary folder beside ``target`` that takes its name when the block succeeds, and is removed when it fails.

    Raises ``Conflict`` when ``target`` exists and ``force`` is off, or when it is not an earlier result: only a folder
    that holds a ``result.json`` and no subfolders is ever replaced.
    """
    target = target.expanduser().absolute()
    refuse_to_overwrite(target, force=force)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        part = Path(tempfile.mkdtemp(prefix=f".{target.name}.part-", dir=target.parent))
    except OSError as error:
        raise cannot_write(target, error) from error
    try:
        yield part
        part.chmod(0o777 & ~_umask())
        _take_the_name(part, target)
    except OSError as error:
        raise cannot_write(target, error) from error
    finally:
        shutil.rmtree(part, ignore_errors=True)


def refuse_to_overwrite(target: Path, *, force: bool) -> None:
    """Raise ``Conflict`` where ``result_folder`` would; called first, so that nobody waits for a refusal."""
    if not target.exists() and not target.is_symlink():
        return
    if not force:
        raise Conflict("output-exists", f"{target} exists; choose another --out or pass --force to replace it.")
    entries = list(target.iterdir()) if target.is_dir() and not target.is_symlink() else []
    is_result = any(entry.name == RESULT_FILE for entry in entries) and all(entry.is_file() for entry in entries)
    if not is_result and (entries or not target.is_dir() or target.is_symlink()):
        raise Conflict("output-not-a-result", f"{target} is not an earlier result, so --force does not replace it.")


def write_file(target: Path, text: str, *, force: bool, option: str) -> None:
    """Write a text file. Raises ``Conflict`` (``output-exists``), ``InvalidInput`` (``output-not-writable``)."""
    target = target.expanduser().absolute()
    if target.is_symlink() or (target.exists() and not (force and target.is_file())):
        advice = f"choose another {option} or pass --force to replace it" if target.is_file() else "it is no plain file"
        raise Conflict("output-exists", f"{target} exists; {advice}.")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{target.name}.part-", dir=target.parent) as folder:
            part = Path(folder) / target.name
            part.write_text(text, encoding="utf-8")
            part.replace(target)
    except OSError as error:
        raise cannot_write(target, error, option) from error


def _take_the_name(part: Path, target: Path) -> None:
    if not target.exists():
        part.replace(target)
        return
    aside = Path(tempfile.mkdtemp(prefix=f".{target.name}.old-", dir=target.parent))
    target.replace(aside)
    try:
        part.replace(target)
    except OSError:
        aside.replace(target)
        raise
    shutil.rmtree(aside, ignore_errors=True)


def _umask() -> int:
    # The mask can only be read by setting it; the command line is single-threaded here.
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


def cannot_write(target: Path, error: OSError, option: str = "--out") -> InvalidInput:
    """What is told of a place that cannot be written (``output-not-writable``)."""
    reason = error.strerror or type(error).__name__
    return InvalidInput("output-not-writable", f"Cannot write to {target}: {reason}.", [Fault(option, reason)])
