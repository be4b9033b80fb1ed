"""Robots in installed packages: lists their descriptions, and packs one with its meshes as an archive to be uploaded.

Packages are Python distributions, and ROS packages in the folders ``share`` of the Python prefix and of
``AMENT_PREFIX_PATH``. Names of users are compared with the listed ones only; no path is made of them.
"""

import difflib
import functools
import os
import posixpath
import re
import sys
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path, PurePosixPath
from typing import Final

from stridelab.errors import Fault, InvalidInput, StridelabError
from stridelab.robots.data_files import shared_folders
from stridelab.robots.proposal.archive import DESCRIPTIONS, MANIFEST, MAX_TOTAL_BYTES, UnpackedRobot
from stridelab.robots.proposal.description import MAX_BYTES, MESHES, is_unexpanded, read_xml

MIN_JOINTS: Final = 12
"""Moving joints of two legs; descriptions with fewer are not listed."""
MAX_FILES: Final = 50_000
"""Files of one shared folder that are looked at."""
_OWN: Final = "stridelab"
_NEAREST: Final = 5
_URDF_JOINT: Final = re.compile(rb"<joint\b[^>]*\stype\s*=\s*[\"'](?:revolute|continuous)[\"']")
_MJCF: Final = re.compile(rb"<mujoco[\s>]")
_MJCF_JOINT: Final = re.compile(rb"<joint[\s/>]")


@dataclass(frozen=True)
class InstalledPackage:
    """Descriptions and meshes of an installed package, by their paths in it; ``descriptions`` may be robots."""

    name: str
    version: str
    files: Mapping[PurePosixPath, Path]
    descriptions: tuple[PurePosixPath, ...]

    @property
    def shortest_paths(self) -> tuple[PurePosixPath, ...]:
        """The paths of ``descriptions`` below the folder that all of them share."""
        shared = posixpath.commonpath([str(path.parent) for path in self.descriptions])
        return tuple(path.relative_to(shared) for path in self.descriptions)


@functools.cache
def installed_packages() -> Mapping[str, InstalledPackage]:
    """Installed packages with descriptions of at least ``MIN_JOINTS`` moving joints, by normalised name."""
    packages: dict[str, InstalledPackage] = {}
    for name, version, files in (*_python_packages(), *_shared_packages()):
        normalised = _normalise_name(name)
        described = tuple(sorted(path for path, file in files.items() if _may_walk(file)))
        if described and normalised not in packages and normalised != _OWN:
            packages[normalised] = InstalledPackage(normalised, version, files, described)
    return dict(sorted(packages.items()))


def find_package(name: str) -> InstalledPackage:
    """The installed package ``name``. Raises ``InvalidInput`` (``robot-package-unknown``) naming the nearest."""
    packages = installed_packages()
    package = packages.get(_normalise_name(name))
    if package is None:
        nearest = difflib.get_close_matches(_normalise_name(name), packages, 1, cutoff=0.0)
        message = "No package of this name with robots is installed"
        message += f"; the nearest is {nearest[0]}." if nearest else ", and no other with robots either."
        raise InvalidInput("robot-package-unknown", message, [Fault("package", name[:120])])
    return package


def find_description(package: InstalledPackage, wanted: str) -> PurePosixPath:
    """The only description of ``package`` whose path ends with ``wanted``, with or without the suffix.

    Raises ``InvalidInput``: ``robot-description-missing`` naming the nearest, ``robot-several-descriptions``.
    """
    ends = PurePosixPath(wanted.replace("\\", "/")).parts

    def ends_as_wanted(path: PurePosixPath) -> bool:
        return not ends or path.parts[-len(ends) :] == ends or path.with_suffix("").parts[-len(ends) :] == ends

    listed = dict(zip(package.shortest_paths, package.descriptions, strict=True))
    choice = [short for short, path in listed.items() if ends_as_wanted(path)]
    exact = [short for short in choice if str(short) == wanted]
    if len(choice) == 1 or exact:
        return listed[(exact or choice)[0]]
    if choice:
        message = f"{package.name} has several descriptions of robots with this name; choose one (description)."
        faults = [Fault(str(path)[-120:], "one of several") for path in choice]
        raise InvalidInput("robot-several-descriptions", message, faults)
    stems = {path.stem: path for path in listed}
    nearest = difflib.get_close_matches(PurePosixPath(wanted).stem, stems, _NEAREST, cutoff=0.0)
    message = f"{package.name} has no description of a robot whose path ends with {wanted[:120]!r}."
    faults = [Fault(str(stems[stem])[-120:], "one of the nearest names") for stem in nearest]
    raise InvalidInput("robot-description-missing", message, faults)


def pack_description(package: InstalledPackage, inside: PurePosixPath, target: Path) -> None:
    """Write a zip of the description ``inside``, the files that it includes, and the meshes that it names.

    The same files give the same bytes. Meshes that are not installed are left out; the reader names them.

    Raises ``UnreadableFile`` (``robot-data-unreadable``, ``robot-description-too-large``) for a document that is no
    XML, ``InvalidInput`` (``robot-package-too-large``).
    """
    parts = _included_files(package, inside)
    packed = {**parts}
    for path, file in parts.items():
        root = read_xml(file, str(path))
        folders = {element.get(name, "") for element in root.iter("compiler") for name in ("meshdir", "assetdir")}
        for mesh in root.iter("mesh"):
            stated = mesh.get("filename") or mesh.get("file") or ""
            if (found := _find_file(package, path, stated, folders, MESHES)) is not None:
                packed[found[0]] = found[1]
    n_bytes = sum(file.stat().st_size for file in packed.values())
    if n_bytes > MAX_TOTAL_BYTES:
        message = f"The description and its meshes have more than {MAX_TOTAL_BYTES / 1e6:g} MB."
        raise InvalidInput("robot-package-too-large", message, [Fault(str(inside)[-120:], f"{n_bytes / 1e6:.0f} MB")])
    with zipfile.ZipFile(target, "w") as archive:
        for path, file in sorted(packed.items()):
            archive.writestr(zipfile.ZipInfo(str(path)), file.read_bytes())


def _included_files(package: InstalledPackage, inside: PurePosixPath) -> dict[PurePosixPath, Path]:
    """The description and the files that it includes, with theirs."""
    parts = {inside: package.files[inside]}
    waiting = [inside]
    while waiting:
        path = waiting.pop()
        root = read_xml(parts[path], str(path))
        for include in root.iter("include") if root.tag != "robot" and not is_unexpanded(root) else ():
            found = _find_file(package, path, include.get("file", ""), (), DESCRIPTIONS)
            if found is not None and found[0] not in parts:
                parts[found[0]] = found[1]
                waiting.append(found[0])
    return parts


def _find_file(
    package: InstalledPackage,
    user: PurePosixPath,
    stated: str,
    folders: Sequence[str] | set[str],
    suffixes: Sequence[str],
) -> tuple[PurePosixPath, Path] | None:
    """The installed file that the description ``user`` means by ``stated``.

    In order: ``package://`` of this or of another package; relative to ``user``, or to its ``folders``; the longest
    unique end of a path in the folder of ``user``, or else in a folder above it.
    """
    scheme, separator, rest = stated.replace("\\", "/").partition("://")
    text = rest if separator else scheme
    if PurePosixPath(text).suffix.lower() not in suffixes:
        return None
    if separator:
        others = installed_packages().get(_normalise_name(text.partition("/")[0]))
        for one in (package, others):
            exact = [path for path in one.files if f"/{path}".endswith(f"/{text}")] if one is not None else []
            if one is not None and len(exact) == 1:
                return exact[0], one.files[exact[0]]
    else:
        for folder in ("", *sorted(folders)):
            path = PurePosixPath(posixpath.normpath(user.parent / folder / text))
            if path in package.files:
                return path, package.files[path]
    files = {path: file for path, file in package.files.items() if path.suffix.lower() in suffixes}
    for above in user.parents:
        below = {path: file for path, file in files.items() if path.is_relative_to(above)}
        match = UnpackedRobot(package.files[user], user, below).find_mesh(text)
        if match is not None:
            return next((path, file) for path, file in below.items() if file == match)
    return None


def _python_packages() -> Iterator[tuple[str, str, dict[PurePosixPath, Path]]]:
    """Name, version, and descriptions and meshes of each Python distribution, beside it or below the prefix."""
    for distribution in metadata.distributions():
        roots = (Path(sys.prefix), Path(os.path.normpath(str(distribution.locate_file("")))))
        files: dict[PurePosixPath, Path] = {}
        for recorded in distribution.files or ():
            if _is_wanted(recorded.name):
                file = Path(os.path.normpath(str(distribution.locate_file(recorded))))
                if any(map(file.is_relative_to, roots)):  # data files may lie beside the library, as ../../share
                    files[PurePosixPath(*(part for part in recorded.parts if part != ".."))] = file
        if any(path.suffix.lower() in DESCRIPTIONS for path in files):
            yield distribution.metadata["Name"], distribution.version, files


def _shared_packages() -> Iterator[tuple[str, str, dict[PurePosixPath, Path]]]:
    """Name, version, and descriptions and meshes of each ROS package; its folder is the first part of their paths."""
    for manifest in (one for shared in shared_folders() for one in sorted(Path(shared).glob(f"*/{MANIFEST}"))):
        folder = manifest.parent
        files: dict[PurePosixPath, Path] = {}
        n_files = 0
        for parent, folders, names in os.walk(folder):
            folders.sort()
            n_files += len(names)
            if n_files > MAX_FILES:
                break
            for name in filter(_is_wanted, sorted(names)):
                files[PurePosixPath(folder.name, *Path(parent, name).relative_to(folder).parts)] = Path(parent, name)
        yield folder.name, _manifest_version(manifest), files


def _manifest_version(manifest: Path) -> str:
    try:
        return (read_xml(manifest, MANIFEST).findtext("version") or "").strip()[:40]
    except (StridelabError, OSError):
        return ""


def _is_wanted(name: str) -> bool:
    return name != MANIFEST and name.lower().endswith((*DESCRIPTIONS, *MESHES))


def _may_walk(file: Path) -> bool:
    """Whether a file is a URDF or MJCF with at least ``MIN_JOINTS`` moving joints, by its text."""
    if file.suffix.lower() not in DESCRIPTIONS:
        return False
    try:
        if not file.is_file() or file.stat().st_size > MAX_BYTES:
            return False
        content = file.read_bytes()
    except OSError:
        return False
    is_mjcf = file.suffix.lower() == ".xml"
    if is_mjcf and not _MJCF.search(content):
        return False
    return len((_MJCF_JOINT if is_mjcf else _URDF_JOINT).findall(content)) >= MIN_JOINTS


def _normalise_name(name: str) -> str:
    """The name of a package as the index of Python packages compares it."""
    return re.sub(r"[-_.]+", "-", name).lower()
