"""Loads robots by name, once per process.

Importing this module is cheap; pinocchio is imported when the first robot is loaded.

The robot's model with one operational frame on every contact frame of its effectors.

Locates the description files of a robot, in an installed data package or in ``models/robots``.
"""

from functools import cache
from typing import TYPE_CHECKING

from stridelab.robots.card import card_bytes, parse_card, robot_names

if TYPE_CHECKING:
    import stridelab.robots.robot
import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import pinocchio as pin

from stridelab.dynamics.spatial import Placement
from stridelab.errors import Unavailable
from stridelab.resources import models_dir
from stridelab.robots.card import RobotCard
from stridelab.robots.robot import Robot

__all__ = ["load_robot", "robot_names"]


@cache
def load_robot(name: str) -> "stridelab.robots.robot.Robot":
    """The robot of ``models/robots/<name>.toml``. Its arrays and models are shared: copy before changing them.

    Raises ``NotFound`` (``robot-not-found``); ``Unavailable``: ``robot-data-missing`` if its data package or a file
    is absent, ``robot-meshes-missing``, ``robot-data-unreadable`` if it is broken; ``InvalidInput``:
    ``robot-card-invalid``, ``robot-description-invalid``.
    """
    from stridelab.robots.assembly import assemble_robot

    card = parse_card(name, card_bytes(name))
    return assemble_robot(name, card, data_files(card))


def to_se3(placement: Placement) -> pin.SE3:
    """The same placement in pinocchio's type."""
    return pin.SE3(placement.rotation, placement.position_m)


def with_contact_frames(robot: Robot) -> tuple[pin.Model, Mapping[str, int]]:
    """A copy of ``robot.model`` and, per effector, the index of the frame at ``T_frame_contact`` of its link frame."""
    model = pin.Model(robot.model)
    index: dict[str, int] = {}
    for name, effector in robot.effectors.items():
        parent = model.getFrameId(effector.frame)
        link = model.frames[parent]
        T_joint_contact = link.placement * to_se3(effector.T_frame_contact)
        index[name] = model.addFrame(
            pin.Frame(f"contact of {name}", link.parentJoint, parent, T_joint_contact, pin.OP_FRAME)
        )
    return model, index


ROBOTS_FOLDER: Final = Path("share", "example-robot-data", "robots")
"""Folder of the data below the prefix into which the package example-robot-data is installed."""


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
        holder, folder = "This project", models_dir() / "robots"
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
