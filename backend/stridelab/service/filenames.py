"""Names of files as their users gave them, made safe to show and to offer for download."""

import re
import unicodedata
from typing import Final

NAME_LIMIT: Final = 120


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
