"""Locates the description files of a robot, in an installed data package or in ``models/robots``."""

import importlib.util
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from stridelab.errors import Unavailable
from stridelab.machine.models_folder import models_dir, robot_file
from stridelab.robots.card import RobotCard

ROBOTS_FOLDER: Final = Path("share", "example-robot-data", "robots")
"""Folder of the data below the prefix into which the package example-robot-data is installed."""


PREFIXES_VARIABLE: Final = "AMENT_PREFIX_PATH"
"""Environment variable with the prefixes of ROS packages, which lie in their folders ``share``."""


def shared_folders() -> list[str]:
    """Folders of installed ROS packages: below ``AMENT_PREFIX_PATH``, and below the prefix of Python."""
    prefixes = [*filter(None, os.environ.get(PREFIXES_VARIABLE, "").split(os.pathsep)), sys.prefix]
    return [str(Path(prefix, "share")) for prefix in prefixes]


@dataclass(frozen=True)
class DataFiles:
    """Files of one robot; ``package_dir`` is what ``package://`` in the URDF is relative to."""

    urdf: Path
    srdf: Path | None
    package_dir: Path


def data_files(card: RobotCard) -> DataFiles:
    """Paths of the files that ``card`` names. Locates the package without importing it.

    Raises ``Unavailable`` (``robot-data-missing``) if the package or one of its files is absent.
    """
    if card.data.package is None:
        urdf = robot_file(models_dir(), "robots", card.data.urdf)
        holder, folder = "This project", urdf.parents[len(Path(card.data.urdf).parts) - 1]
        package_dir = folder
    else:
        holder, folder = f"The package {card.data.package}", _package_robots(card, card.data.package)
        package_dir = folder.parent.parent
    urdf = folder / card.data.urdf
    srdf = None if card.data.srdf is None else folder / card.data.srdf
    for path in (urdf, srdf):
        if path is not None and not path.is_file():
            raise _data_missing(card, f"{holder} has no file {path.relative_to(folder)}.")
    return DataFiles(urdf, srdf, package_dir)


def _package_robots(card: RobotCard, package: str) -> Path:
    spec = importlib.util.find_spec(package)
    if spec is None or spec.origin is None:
        raise _data_missing(card, f"The package {package} is not installed.")
    # the package lies in <prefix>/lib/python3.x/site-packages/<package>/__init__.py
    prefixes = Path(spec.origin).resolve().parents
    folder = next((p / ROBOTS_FOLDER for p in prefixes if (p / ROBOTS_FOLDER).is_dir()), None)
    if folder is None:
        raise _data_missing(card, f"The package {package} is installed without its data.")
    return folder


def _data_missing(card: RobotCard, reason: str) -> Unavailable:
    return Unavailable("robot-data-missing", f"The description of {card.title} is missing. {reason}")
