"""Names of files as users or children gave them, made safe to show, to offer for download and to open."""

import re
import unicodedata
from pathlib import Path
from typing import Final

import structlog

from stridelab.errors import Fault, UnreadableFile

log = structlog.get_logger(__name__)

NAME_LIMIT: Final = 120
PARSER_CRASHED: Final = ("parser-crashed", "The file broke its reader; it is damaged, or not what it claims to be.")
"""Code and message of an upload that ended its reader."""


def safe_filename(claimed: str) -> str:
    """The last part of a claimed file name without control, direction or path characters, at most 120 long.

    It is shown and offered for download, and never used as a path of ours.
    """
    plain = unicodedata.normalize("NFC", re.split(r"[/\\]", claimed)[-1])
    plain = "".join(character for character in plain if character.isprintable() and character not in '"<>:|?*')
    plain = plain.strip(" .")
    stem, dot, suffix = plain.rpartition(".")
    if dot and len(suffix) <= 10:
        plain = f"{stem[: NAME_LIMIT - 1 - len(suffix)]}.{suffix}"
    return plain[:NAME_LIMIT] or "recording"


def left_file(folder: Path, name: str) -> Path:
    """The plain file ``name`` that a child left in ``folder``; no link, and nothing elsewhere.

    A child that was taken over by its input may answer anything, and this process may open what the child may not.
    Raises ``UnreadableFile`` (``parser-crashed``).
    """
    home = folder.resolve()
    path = (home / name).resolve()
    if path != home / name or not path.is_relative_to(home) or not path.is_file():
        log.warning("upload not read", state="left no such file")
        raise UnreadableFile(*PARSER_CRASHED, [Fault(name, "is no file of the reader's folder")])
    return path
