"""Sanitises file names from users and child processes before they are shown, offered for download or opened."""

import re
import unicodedata
from pathlib import Path
from typing import Final

import structlog

from stridelab.errors import Fault, UnreadableFile

log = structlog.get_logger(__name__)

NAME_LIMIT: Final = 120
STAGED_ROBOT: Final = "robot.json"
"""File in the folder of a job on a robot of a user: its name and card; its description lies beside it."""
BUNDLE_FILE: Final = "robot-bundle.zip"
LEARNED_FILE: Final = "robot-learned.zip"
LINKS_FILE: Final = "robot-links.glb"
INSTALLED_FILE: Final = "installed-robot.zip"
ROBOT_STATE_FILE: Final = "robot-state.json"
"""File in the folder of a commissioned robot: its new row."""
SIMULATED_RECORDING_FILE, SIMULATED_TRACKS_FILE, SIMULATED_FACTS_FILE = "recording.c3d", "tracks.parquet", "facts.json"
PARSER_CRASHED: Final = ("parser-crashed", "The file broke its reader; it is damaged, or not what it claims to be.")
"""Code and message of an upload whose parser process crashed."""


def safe_filename(claimed: str) -> str:
    """The last part of a claimed file name without control, direction or path characters, at most 120 long.

    The result is shown and offered for download; it is never used as a server path.
    """
    plain = unicodedata.normalize("NFC", re.split(r"[/\\]", claimed)[-1])
    plain = "".join(character for character in plain if character.isprintable() and character not in '"<>:|?*')
    plain = plain.strip(" .")
    stem, dot, suffix = plain.rpartition(".")
    if dot and len(suffix) <= 10:
        plain = f"{stem[: NAME_LIMIT - 1 - len(suffix)]}.{suffix}"
    return plain[:NAME_LIMIT] or "recording"


def child_output_file(folder: Path, name: str) -> Path:
    """Path of the regular file ``name`` that a child process wrote to ``folder``.

    Rejects links and paths outside the folder: a child that was compromised by its input may return any name, and this
    process has more rights than the child. Raises ``UnreadableFile`` (``parser-crashed``).
    """
    home = folder.resolve()
    path = (home / name).resolve()
    if path != home / name or not path.is_relative_to(home) or not path.is_file():
        log.warning("upload not read", state="left no such file")
        raise UnreadableFile(*PARSER_CRASHED, [Fault(name, "is not a file in the reader's folder")])
    return path
