"""Opens the zip of an OpenSim trial and identifies its marker and force files; sizes in the zip are not trusted."""

import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from stridelab.errors import Fault, UnreadableFile

MAX_MEMBERS = 64
MAX_MEMBER_BYTES = 64 * 1024 * 1024
"""Maximum unpacked size of a member; ten minutes of full-body markers are about 40 MB."""
MAX_TOTAL_BYTES = 2 * MAX_MEMBER_BYTES
ZIP_ERRORS: Final = (
    zipfile.BadZipFile,
    zipfile.LargeZipFile,
    zlib.error,
    EOFError,
    NotImplementedError,
    RuntimeError,
    ValueError,
)
"""Exceptions from reading a damaged, encrypted or unsupported zip."""


@dataclass(frozen=True)
class TrialTexts:
    """Contents and names of one TRC file and of the force file, if there is one."""

    trc: str
    trc_name: str
    mot: str | None
    mot_name: str


def damaged_zip_error(path: Path, error: Exception) -> UnreadableFile:
    """Error for an unreadable zip (``zip-damaged``)."""
    return UnreadableFile(
        "zip-damaged",
        "The zip file is damaged, encrypted or of an unknown kind.",
        [Fault(path.name, _cause_of_damage(error))],
    )


def _cause_of_damage(error: Exception) -> str:
    """Explanation of an exception of the zip library for users; subclasses come first."""
    causes: tuple[tuple[type[Exception], str], ...] = (
        (zipfile.BadZipFile, "it is not a complete zip file: its directory or a checksum does not match its contents"),
        (zipfile.LargeZipFile, "it needs the extension for large zip files and does not use it"),
        (zlib.error, "compressed data in it are damaged"),
        (EOFError, "it ends early"),
        (NotImplementedError, "it is compressed by a method that is not supported"),
        (RuntimeError, "it is encrypted"),
        (OSError, "it cannot be read"),
    )
    return next((cause for kind, cause in causes if isinstance(error, kind)), "its directory holds impossible values")


def unpack_texts(path: Path) -> dict[str, str]:
    """Texts of all files of a zip by name.

    Raises ``UnreadableFile`` (``zip-damaged``, ``zip-bomb``, ``zip-too-many-files``).
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = [m for m in archive.infolist() if not m.is_dir() and not _is_system_file(m.filename)]
            if len(members) > MAX_MEMBERS:
                raise UnreadableFile(
                    "zip-too-many-files",
                    f"The zip holds {len(members)} files; the files of one recording are expected.",
                    [Fault(path.name, "too many files")],
                )
            return _unpack_all(archive, members)
    except (*ZIP_ERRORS, OSError) as error:
        raise damaged_zip_error(path, error) from error


def find_trial(path: Path, texts: Mapping[str, str]) -> TrialTexts:
    """Exactly one TRC file, and at most one MOT or STO file with ground forces, among unpacked texts, by their content.

    A STO file of markers takes the place of a TRC file.

    Raises ``UnreadableFile`` (``zip-without-trc``, ``zip-several-trials``).
    """
    from stridelab.recordings.files.trc import is_marker_storage  # numpy: the command line names zips without it

    trc = [name for name, text in texts.items() if is_trc(text)]
    trc = trc or [name for name, text in texts.items() if is_marker_storage(text)]
    mot = [name for name, text in texts.items() if name not in trc and has_ground_forces(text)]
    if not trc:
        held = ", ".join(sorted(texts)) or "nothing"
        raise UnreadableFile(
            "zip-without-trc",
            f"The zip holds no TRC file and no TSV file of markers (it holds {held[:300]}).",
            [Fault(path.name, "no TRC")],
        )
    if len(trc) > 1 or len(mot) > 1:
        faults = [Fault(name, "one of several") for name in sorted(trc + mot)]
        raise UnreadableFile(
            "zip-several-trials",
            "The zip holds more than one trial; upload one pair of TRC and MOT files at a time.",
            faults,
        )
    return TrialTexts(texts[trc[0]], trc[0], texts[mot[0]] if mot else None, mot[0] if mot else "")


def is_trc(text: str) -> bool:
    """Whether a text begins like a TRC file; leading blank lines and spaces are ignored."""
    return text[:2000].lstrip("\ufeff \t\r\n").startswith("PathFileType")


def has_ground_forces(text: str) -> bool:
    """Whether a text is a MOT or STO file with ground reaction forces (other such files contain joint angles)."""
    head = text[:20000]
    return "endheader" in head and "ground_force" in head.lower()


def _is_system_file(name: str) -> bool:
    return name.startswith("__MACOSX/") or name.rsplit("/", 1)[-1].startswith(".")


def _unpack_all(archive: zipfile.ZipFile, members: list[zipfile.ZipInfo]) -> dict[str, str]:
    """Texts of all members; raises ``zip-bomb`` if they exceed ``MAX_TOTAL_BYTES`` together."""
    texts: dict[str, str] = {}
    left = MAX_TOTAL_BYTES
    for member in members:
        texts[member.filename] = _unpack_text(archive, member, min(left, MAX_MEMBER_BYTES))
        left -= len(texts[member.filename])
    return texts


def _unpack_text(archive: zipfile.ZipFile, member: zipfile.ZipInfo, limit: int) -> str:
    """Text of a member; reading stops at the limit regardless of the size in the zip's directory."""
    with archive.open(member) as file:
        content = file.read(limit + 1)
    if len(content) > limit:
        raise UnreadableFile(
            "zip-bomb",
            f"The zip unpacks to more than {MAX_MEMBER_BYTES // 2**20} MB a file "
            f"or {MAX_TOTAL_BYTES // 2**20} MB in all.",
            [Fault(member.filename, "too large when unpacked")],
        )
    return content.decode("utf-8-sig", errors="replace")
