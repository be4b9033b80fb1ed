"""Unpacks an uploaded robot into files with generated names; names and sizes in the archive are not trusted."""

import stat
import zipfile
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path, PurePosixPath
from typing import Final

from stridelab.errors import Fault, UnreadableFile
from stridelab.robots.proposal.description import MESHES, read_xml

MAX_ENTRIES: Final = 2_000
MAX_FILE_BYTES: Final = 60_000_000
MAX_TOTAL_BYTES: Final = 300_000_000
PIECE_BYTES: Final = 1 << 20
DESCRIPTIONS: Final = (".urdf", ".xml")
UNREAD: Final = {
    ".xacro": "The zip holds xacro files only; expand them first: xacro robot.urdf.xacro > robot.urdf.",
    ".sdf": "The zip holds an SDF file only; convert it to URDF or MJCF.",
    ".zip": "The zip holds another zip; upload the one with the description and its meshes.",
}
"""Files of an upload without a description, and what to do with them."""
MANIFEST: Final = "package.xml"
MAX_DESCRIPTIONS: Final = 100
_ZIP_ERRORS: Final = (zipfile.BadZipFile, OSError, NotImplementedError, ValueError, EOFError, RuntimeError)


@dataclass(frozen=True)
class UnpackedRobot:
    """The description, its path in the archive, and by their paths in it the meshes, and the files it may include."""

    description: Path
    inside: PurePosixPath
    meshes: Mapping[PurePosixPath, Path]
    parts: Mapping[PurePosixPath, Path] = field(default_factory=dict)
    is_zip: bool = True

    def find_mesh(self, filename: str) -> Path | None:
        """The unpacked mesh whose path ends like ``filename``: the longest match, of several the nearest one.

        Nearest are those in the folders of the description, as many as possible. None without a match, and if several
        meshes of different contents are equally near.
        """
        nearest = [self.meshes[name] for name in self._nearest_names(filename, self.meshes)]
        return nearest[0] if len({path.read_bytes() for path in nearest}) == 1 else None

    def find_part(self, filename: str) -> Path | None:
        """The unpacked XML file whose path ends like ``filename``, as ``find_mesh``."""
        nearest = self._nearest_names(filename, self.parts)
        return self.parts[nearest[0]] if len(nearest) == 1 else None

    def missing_mesh_faults(self, filenames: Collection[str]) -> list[Fault]:
        """Why ``find_mesh`` has none of these meshes: formats, no zip at all, not in it, or in it several times."""
        names = sorted(set(filenames))
        if self.is_zip:
            return [self._missing_mesh_fault(name) for name in names]
        message = f"the description names {len(names)} that are not in the upload; put both into one zip"
        return [Fault(f"meshes such as {names[0][:100]}", message)]

    def _missing_mesh_fault(self, filename: str) -> Fault:
        where = filename[:120]
        if filename and not filename.lower().endswith(MESHES):
            return Fault(where, f"its format is none of {', '.join(MESHES)}")
        if several := self._nearest_names(filename, self.meshes):
            places = ", ".join(str(name.parent)[:60] for name in several[:3])
            return Fault(where, f"the zip has {len(several)} such meshes, in {places}")
        return Fault(where, "the zip has no such mesh")

    def _nearest_names(self, filename: str, files: Mapping[PurePosixPath, Path]) -> list[PurePosixPath]:
        """Names of ``files`` that end like ``filename``; of several those with most folders of the description."""
        text = filename.replace("\\", "/").partition("://")[2] or filename.replace("\\", "/")
        parts = [part for part in PurePosixPath(text).parts if part not in ("..", ".", "/")]
        # without regard to case only if no name is the same: some file systems know no difference
        names = _longest_matches(parts, files) or _longest_matches(parts, files, str.casefold)
        shared = [_shared_folders(name, self.inside) for name in names]
        return [name for name, count in zip(names, shared, strict=True) if count == max(shared)]


def _shared_folders(a: PurePosixPath, b: PurePosixPath) -> int:
    """Number of folders from the root on that two paths have in common."""
    pairs = zip(a.parent.parts, b.parent.parts, strict=False)
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))


def _longest_matches(
    parts: Sequence[str], files: Mapping[PurePosixPath, Path], letters: Callable[[str], str] = str
) -> list[PurePosixPath]:
    """Files whose path has the most of ``parts`` at its end, at least one; compared are the ``letters`` of names."""
    best: list[PurePosixPath] = []
    longest = 0
    for name in files:
        same = 0
        for a, b in zip(reversed(parts), reversed(name.parts), strict=False):
            if letters(a) != letters(b):
                break
            same += 1
        if same > longest:
            best, longest = [name], same
        elif same == longest and same:
            best.append(name)
    return best


def unpack_robot(
    path: Path, filename: str, folder: Path, description: str = "", assets: Sequence[str] = MESHES
) -> UnpackedRobot:
    """Unpack the upload ``path`` into ``folder``; one that is not a zip is the description itself.

    ``description`` is the path in the zip of the one to be read, or its end; it is needed where there are several.
    Unpacked are descriptions and files with the endings ``assets``.

    Raises ``UnreadableFile`` (``zip-damaged``, ``zip-bomb``, ``zip-too-many-files``, ``zip-path``,
    ``zip-name-twice``, ``robot-description-missing``, ``robot-several-descriptions``).
    """
    if not zipfile.is_zipfile(path):
        if path.suffix.lower() == ".zip" or filename.lower().endswith(".zip"):
            raise _refused("zip-damaged", "The zip file is damaged or truncated.", filename, "not readable")
        return UnpackedRobot(path, PurePosixPath("robot.urdf"), {}, is_zip=False)
    try:
        with zipfile.ZipFile(path) as archive:
            return _unpack_archive(archive, filename, folder, description, assets)
    except _ZIP_ERRORS as error:
        raise _refused(
            "zip-damaged", "The zip file is damaged, encrypted or truncated.", filename, str(error)
        ) from error


def _unpack_archive(
    archive: zipfile.ZipFile, filename: str, folder: Path, description: str, assets: Sequence[str]
) -> UnpackedRobot:
    members = [member for member in archive.infolist() if not member.is_dir()]
    if len(members) > MAX_ENTRIES:
        message = f"The zip holds {len(members)} files; at most {MAX_ENTRIES} are accepted."
        raise _refused("zip-too-many-files", message, filename, "too many files")
    names: dict[PurePosixPath, zipfile.ZipInfo] = {}
    for member in members:
        name = _inside_path(member)
        if name in names:
            raise _refused("zip-name-twice", "The zip holds two files of the same name.", str(name), "twice in the zip")
        names[name] = member
    shown = {name: m for name, m in names.items() if not any(p.startswith(".") or p == "__MACOSX" for p in name.parts)}
    described = [name for name in sorted(shown) if name.suffix.lower() in DESCRIPTIONS and name.name != MANIFEST]
    wanted = [*described[:MAX_DESCRIPTIONS], *(name for name in sorted(shown) if name.suffix.lower() in assets)]
    left, unpacked = MAX_TOTAL_BYTES, {}
    for index, name in enumerate(wanted):
        target = folder / f"member-{index:04d}{name.suffix.lower()}"
        left -= _unpack_member(archive, names[name], target, min(left, MAX_FILE_BYTES))
        unpacked[name] = target
    parts = {name: unpacked.pop(name) for name in described[:MAX_DESCRIPTIONS]}
    if not parts and (unread := sorted(name for name in shown if name.suffix.lower() in UNREAD)):
        raise _refused("robot-description-missing", UNREAD[unread[0].suffix.lower()], str(unread[0]), "not read")
    inside = _description_of(parts, filename, description)
    return UnpackedRobot(parts[inside], inside, unpacked, parts)


def _inside_path(member: zipfile.ZipInfo) -> PurePosixPath:
    """Path of a member; raises for links and for paths that leave the archive."""
    text = member.filename.replace("\\", "/")
    name = PurePosixPath(text)
    if stat.S_ISLNK(member.external_attr >> 16):
        raise _refused("zip-path", "The zip holds a symbolic link; put the file itself into it.", text, "a link")
    if name.is_absolute() or ".." in name.parts or ":" in text or not text.isprintable():
        raise _refused("zip-path", "The zip holds a file with a path outside of it.", text, "not a path below the zip")
    return name


def _description_of(files: Mapping[PurePosixPath, Path], filename: str, wanted: str) -> PurePosixPath:
    """The file ``wanted``; without, the only URDF, or else the only XML file that is no scene and not included."""
    if wanted:
        ends = PurePosixPath(wanted.replace("\\", "/")).parts
        choice = [name for name in files if name.parts[-len(ends) :] == ends]
        choice = choice or [name for name in files if str(name).endswith(str(PurePosixPath(*ends)))]
        if len(choice) != 1:
            message = f"The zip holds {len(choice)} descriptions of robots whose path ends with {wanted[:120]!r}."
            listed = [Fault(str(name)[:120], "in the zip") for name in choice or files]
            raise UnreadableFile("robot-description-missing", message, listed[:10])
        return choice[0]
    urdfs = [name for name in files if name.suffix.lower() == ".urdf"]
    choice = urdfs or [name for name in files if not name.name.startswith("scene")]
    if len(choice) > 1 and not urdfs:
        included = {PurePosixPath(one).name for name in choice for one in _included_by(files[name], str(name))}
        choice = [name for name in choice if name.name not in included] or choice
    if not choice:
        message = "The zip holds no description of a robot: neither a .urdf nor an .xml file."
        raise _refused("robot-description-missing", message, filename, "no description")
    if len(choice) > 1:
        message = "The zip holds several descriptions of robots; choose one (description)."
        raise UnreadableFile(
            "robot-several-descriptions", message, [Fault(str(name)[:120], "one of several") for name in choice[:10]]
        )
    return choice[0]


def _included_by(path: Path, inside: str) -> list[str]:
    """Files that an MJCF file includes, as it states them."""
    root = read_xml(path, inside)
    return [include.get("file", "").replace("\\", "/") for include in root.iter("include")]


def _unpack_member(archive: zipfile.ZipFile, member: zipfile.ZipInfo, target: Path, limit: int) -> int:
    written = 0
    with archive.open(member) as source, target.open("wb") as file:
        while piece := source.read(PIECE_BYTES):
            written += len(piece)
            if written > limit:
                message = f"The zip unpacks to more than {MAX_FILE_BYTES / 1e6:g} MB a file or "
                message += f"{MAX_TOTAL_BYTES / 1e6:g} MB in all."
                raise _refused("zip-bomb", message, member.filename, "too large when unpacked")
            file.write(piece)
    return written


def _refused(code: str, message: str, where: str, fault: str) -> UnreadableFile:
    return UnreadableFile(code, message, [Fault(where[:120], fault[:120])])
