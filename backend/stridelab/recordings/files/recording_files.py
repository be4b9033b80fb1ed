"""Selects the recordings among the files of a folder or a zip by their names."""

from collections.abc import Iterable
from pathlib import Path, PurePath
from typing import Final, TypeVar

RECORDING_SUFFIXES: Final = (".c3d", ".zip", ".trc", ".mvnx")
"""C3D files, zips of one trial, and the files that are read alone and hold no forces."""
_WITH_FORCES: Final = (".c3d", ".zip")
_P = TypeVar("_P", bound=PurePath)


def recordings_among(paths: Iterable[_P]) -> list[_P]:
    """The recordings among files, in order.

    A TRC or MVNX file beside a C3D file or a zip of the same name is an export of that trial and is omitted.
    """
    recordings = [path for path in paths if path.suffix.lower() in RECORDING_SUFFIXES]
    complete = {path.with_suffix("") for path in recordings if path.suffix.lower() in _WITH_FORCES}
    return [path for path in recordings if path.suffix.lower() in _WITH_FORCES or path.with_suffix("") not in complete]


def recordings_in(folder: Path) -> list[Path]:
    """The recordings of a folder and its subfolders, sorted, as in ``recordings_among``."""
    return recordings_among(sorted(path for path in folder.rglob("*") if path.is_file()))
