"""Loads robots by name, once per process.

Importing this module is cheap; pinocchio is imported when the first robot is loaded.
"""

from functools import cache
from typing import TYPE_CHECKING

from stridelab.robots.card import card_bytes, parse_card, robot_names
from stridelab.robots.data_files import data_files

if TYPE_CHECKING:
    import stridelab.robots.robot

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
