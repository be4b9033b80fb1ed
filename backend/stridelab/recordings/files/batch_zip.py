"""Unpacks a zip of many recordings into files with generated names; names and sizes in the zip are not trusted.

Members are ``.c3d`` files, ``.trc`` files with their force files (``walk.trc`` and ``walk_grf.mot``, in the same folder
or in one for forces), ``.zip`` files of one TRC and one force file each (opened later by the reader, without further
nesting), and at most one ``.csv``: the subject table.
"""

import zipfile
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Final

from stridelab.errors import Fault, UnreadableFile
from stridelab.recordings.files.opensim_zip import ZIP_ERRORS, damaged_zip_error, has_ground_forces
from stridelab.recordings.files.recording_files import recordings_among
from stridelab.recordings.files.trial_pairs import FORCES, HEAD_BYTES, TRC, pair_trials

TABLE: Final = ".csv"
TABLE_BYTES: Final = 1_000_000
PIECE_BYTES: Final = 1 << 20


@dataclass(frozen=True)
class BatchLimits:
    """Limits on the number of recordings, the size of one and their total size, both unpacked."""

    files: int
    file_bytes: int
    total_bytes: int


@dataclass(frozen=True)
class UnpackedBatch:
    """Unpacked members as (path inside the zip, unpacked file), and the content of the subject table or None."""

    files: tuple[tuple[str, Path], ...]
    table: bytes | None


def is_batch(path: Path) -> bool:
    """Whether a file is a zip of recordings, and not one recording as a zip of TRC and MOT.

    Several TRC files are several recordings; one TRC file is one recording, with or without a force file.
    """
    if not zipfile.is_zipfile(path):
        return False
    try:
        with zipfile.ZipFile(path) as archive:
            suffixes = [_member_suffix(member) for member in _recording_members(_file_members(archive))]
            return any(suffix != TRC for suffix in suffixes) or len(suffixes) > 1
    except (zipfile.BadZipFile, OSError, NotImplementedError, ValueError):
        return False


def unpack_batch(path: Path, folder: Path, limits: BatchLimits) -> UnpackedBatch:
    """Unpack the recordings of a zip into ``folder`` as ``member-0000`` ...

    Reading stops at the limits regardless of the sizes in the zip's directory. Raises ``UnreadableFile``
    (``zip-damaged``, ``zip-bomb``, ``zip-too-many-files``, ``zip-name-twice``, ``zip-several-tables``, and
    ``zip-several-trials`` if force files cannot be assigned to TRC files by their names).
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = _file_members(archive)
            recordings = _recording_members(members)
            tables = [member for member in members if _member_suffix(member) == TABLE]
            _check_contents(path.name, recordings, tables, limits)
            forces = _forces_of_trials(archive, members, recordings)
            left, files = limits.total_bytes, []
            for index, member in enumerate(recordings):
                target = folder / f"member-{index:04d}"
                left -= _unpack_member(archive, member, target, min(left, limits.file_bytes), limits)
                if member.filename in forces:
                    left -= _add_forces(
                        archive, member, forces[member.filename], target, min(left, limits.file_bytes), limits
                    )
                files.append((_member_name(member), target))
            return UnpackedBatch(tuple(files), _read_table(archive, tables, limits))
    except ZIP_ERRORS as error:
        raise damaged_zip_error(path, error) from error


def _check_contents(
    name: str, recordings: list[zipfile.ZipInfo], tables: list[zipfile.ZipInfo], limits: BatchLimits
) -> None:
    if len(recordings) > limits.files:
        message = f"The zip holds {len(recordings)} recordings; at most {limits.files} are taken at a time."
        raise UnreadableFile("zip-too-many-files", message, [Fault(name, "too many files")])
    if len(tables) > 1:
        faults = [Fault(_member_name(table)[:120], "one of several") for table in tables[:10]]
        raise UnreadableFile(
            "zip-several-tables", "The zip holds more than one .csv; one subject table is read.", faults
        )
    names = [_member_name(member) for member in recordings]
    twice = sorted({each for each in names if names.count(each) > 1})
    if twice:
        faults = [Fault(each[:120], "twice in the zip") for each in twice[:10]]
        raise UnreadableFile("zip-name-twice", "The zip holds two files of the same name.", faults)


def _forces_of_trials(
    archive: zipfile.ZipFile, members: list[zipfile.ZipInfo], recordings: list[zipfile.ZipInfo]
) -> dict[str, zipfile.ZipInfo]:
    """Force files by the names of their TRC files; raises if one of them belongs to no TRC file.

    A zip whose TRC files are all exports of other recordings may hold any force files.
    """
    if all(_member_suffix(one) != TRC for one in recordings):
        return {}
    trials = {PurePosixPath(_member_name(one)): one for one in members if _member_suffix(one) == TRC}
    forces = {}
    for member in members:
        if _member_suffix(member) in FORCES:
            with archive.open(member) as file:
                if has_ground_forces(file.read(HEAD_BYTES).decode("utf-8-sig", errors="replace")):
                    forces[PurePosixPath(_member_name(member))] = member
    pairs = pair_trials(trials, forces)
    unassigned = sorted(str(path) for path in forces.keys() - pairs.values())
    if unassigned:
        message = (
            "The zip holds several recordings, and force files whose names do not say to which TRC file they belong. "
            "Name each pair alike (walk.trc and walk_grf.mot), or put it into a zip of its own inside this one."
        )
        raise UnreadableFile(
            "zip-several-trials", message, [Fault(name[:120], "of no TRC file") for name in unassigned[:20]]
        )
    return {trials[trial].filename: forces[force] for trial, force in pairs.items()}


def _add_forces(
    archive: zipfile.ZipFile,
    trial: zipfile.ZipInfo,
    force: zipfile.ZipInfo,
    target: Path,
    limit: int,
    limits: BatchLimits,
) -> int:
    """Make an unpacked TRC file a zip with its forces; returns their size."""
    markers, forces = target.with_suffix(".markers"), target.with_suffix(".forces")
    target.rename(markers)
    try:
        size = _unpack_member(archive, force, forces, limit, limits)
        with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as packed:
            packed.write(markers, _member_name(trial).rpartition("/")[2])
            packed.write(forces, _member_name(force).rpartition("/")[2])
    finally:
        markers.unlink(missing_ok=True)
        forces.unlink(missing_ok=True)
    return size


def _unpack_member(
    archive: zipfile.ZipFile, member: zipfile.ZipInfo, target: Path, limit: int, limits: BatchLimits
) -> int:
    written = 0
    with archive.open(member) as source, target.open("wb") as file:
        while piece := source.read(PIECE_BYTES):
            written += len(piece)
            if written > limit:
                raise _zip_bomb_error(member, limits)
            file.write(piece)
    return written


def _read_table(archive: zipfile.ZipFile, tables: list[zipfile.ZipInfo], limits: BatchLimits) -> bytes | None:
    if not tables:
        return None
    with archive.open(tables[0]) as source:
        content = source.read(TABLE_BYTES + 1)
    if len(content) > TABLE_BYTES:
        raise _zip_bomb_error(tables[0], limits)
    return content


def _zip_bomb_error(member: zipfile.ZipInfo, limits: BatchLimits) -> UnreadableFile:
    return UnreadableFile(
        "zip-bomb",
        f"The zip unpacks to more than {limits.file_bytes / 1e6:g} MB a file "
        f"or {limits.total_bytes / 1e6:g} MB in all.",
        [Fault(_member_name(member)[:120], "too large when unpacked")],
    )


def _file_members(archive: zipfile.ZipFile) -> list[zipfile.ZipInfo]:
    return [m for m in archive.infolist() if not m.is_dir() and not _is_system_file(_member_name(m))]


def _recording_members(members: list[zipfile.ZipInfo]) -> list[zipfile.ZipInfo]:
    names = {str(name) for name in recordings_among(PurePosixPath(_member_name(member)) for member in members)}
    return [member for member in members if str(PurePosixPath(_member_name(member))) in names]


def _member_name(member: zipfile.ZipInfo) -> str:
    """Name of a member inside the zip, with forward slashes."""
    return member.filename.replace("\\", "/").removeprefix("./")


def _member_suffix(member: zipfile.ZipInfo) -> str:
    return Path(_member_name(member).rpartition("/")[2]).suffix.lower()


def _is_system_file(name: str) -> bool:
    return name.startswith("__MACOSX/") or name.rpartition("/")[2].startswith(".")
