"""Where a robot's description lies: in an installed data package, never in this project (licences differ)."""

import importlib.util
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from stridelab.errors import Unavailable
from stridelab.robots.card import RobotCard

ROBOTS_FOLDER: Final = Path("share", "example-robot-data", "robots")
"""Folder of the data below the prefix into which the package example-robot-data is installed."""


@dataclass(frozen=True)
class DataFiles:
    """Files of one robot; ``package_dir`` is what ``package://`` in the URDF is relative to."""

    urdf: Path
    srdf: Path
    package_dir: Path


def data_files(card: RobotCard) -> DataFiles:
    """Files that ``card`` names. Finds the package without importing it.

    Raises ``Unavailable`` (``robot-data-missing``) where the package or one of its files is absent.
    """
    spec = importlib.util.find_spec(card.data.package)
    if spec is None or spec.origin is None:
        raise _missing(card, f"The package {card.data.package} is not installed.")
    # the package lies in <prefix>/lib/python3.x/site-packages/<package>/__init__.py
    prefixes = Path(spec.origin).resolve().parents
    folder = next((p / ROBOTS_FOLDER for p in prefixes if (p / ROBOTS_FOLDER).is_dir()), None)
    if folder is None:
        raise _missing(card, f"The package {card.data.package} is installed without its data.")
    urdf, srdf = folder / card.data.urdf, folder / card.data.srdf
    for path in (urdf, srdf):
        if not path.is_file():
            raise _missing(card, f"The package {card.data.package} has no file {path.relative_to(folder)}.")
    return DataFiles(urdf, srdf, folder.parent.parent)


def _missing(card: RobotCard, reason: str) -> Unavailable:
    return Unavailable("robot-data-missing", f"The description of {card.title} is missing. {reason}")
