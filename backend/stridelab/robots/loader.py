"""The door to the robots: by name, loaded once per process.

Importing this module is light; pinocchio comes in with the first robot.
"""

from functools import cache
from typing import TYPE_CHECKING

from stridelab.robots.card import card_bytes, parse, robot_names
from stridelab.robots.data_files import data_files

if TYPE_CHECKING:
    import stridelab.robots.robot

__all__ = ["load_robot", "robot_names"]


@cache
def load_robot(name: str) -> "stridelab.robots.robot.Robot":
    """The robot of ``models/robots/<name>.toml``. Its arrays and models are shared: copy before changing them.

    Raises ``NotFound`` (``robot-not-found``), ``Unavailable`` (``robot-data-missing``) where its data package is
    absent, ``Unavailable`` (``robot-data-unreadable``) where it is broken, ``InvalidInput`` (``robot-card-invalid``).
    """
    from stridelab.robots.assembly import assemble

    text = card_bytes(name)
    card = parse(name, text)
    return assemble(name, card, text, data_files(card))
