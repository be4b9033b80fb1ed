"""Hash over everything that the cached files of a robot are computed from; it names their folder."""

import hashlib
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

from stridelab import __version__
from stridelab.machine.models_folder import models_dir
from stridelab.robots.card import card_bytes, robot_card
from stridelab.robots.data_files import DataFiles, data_files

EDITION: Final = 4
"""Incremented when the computation of facts, meshes or densities changes within one version of this program."""
LIBRARIES: Final = ("pin", "fast-simplification", "scikit-image", "trimesh")
"""Distributions whose versions affect the files."""
CACHED_LINKS_FILE: Final = "links.glb"
"""The cached display meshes of a robot."""


def cached_files_prefix(name: str) -> str:
    """Key prefix of the cached files of the robot ``name``. Raises as ``source_sha256``."""
    return f"robots/{name}/{source_sha256(name)}"


def source_sha256(name: str) -> str:
    """SHA-256 over the card, the description, all its meshes, the learned densities, and the versions.

    Only reads files, without importing numeric libraries. A missing file is hashed as a placeholder.

    Raises ``NotFound`` (``robot-not-found``), ``InvalidInput`` (``robot-card-invalid``), ``Unavailable``
    (``robot-data-missing``).
    """
    total = hashlib.sha256()
    versions = [f"{library} {_distribution_version(library)}" for library in LIBRARIES]
    for word in (f"edition {EDITION}", f"stridelab {__version__}", *versions):
        total.update(hashlib.sha256(word.encode()).digest())
    total.update(hashlib.sha256(card_bytes(name)).digest())
    files = data_files(robot_card(name))
    learned = models_dir() / "reachability" / name
    for path in (files.urdf, files.srdf, *_mesh_files(files), *sorted(learned.glob("*"))):
        total.update(b"-" * 32 if path is None or not path.is_file() else _file_digest(path))
    return total.hexdigest()


def _mesh_files(files: DataFiles) -> Iterator[Path]:
    """Mesh files of the URDF, without duplicates, sorted by name; empty if the URDF cannot be parsed."""
    try:
        root = ET.parse(files.urdf).getroot()  # noqa: S314 (a file of the installation, not a user's)
    except ET.ParseError:
        return
    for name in sorted({mesh.attrib.get("filename", "") for mesh in root.iter("mesh")}):
        yield files.package_dir / name.removeprefix("package://")


def _file_digest(path: Path) -> bytes:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").digest()


def _distribution_version(distribution: str) -> str:
    try:
        return version(distribution)
    except PackageNotFoundError:
        return "not installed"
