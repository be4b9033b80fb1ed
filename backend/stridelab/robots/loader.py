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

    Raises ``NotFound`` (``robot-not-found``); ``Unavailable``: ``robot-data-missing`` where its data package or a file
    is absent, ``robot-meshes-missing``, ``robot-data-unreadable`` where it is broken; ``InvalidInput``:
    ``robot-card-invalid``, ``robot-description-invalid``.
    """
    from stridelab.robots.assembly import assemble

    card = parse(name, card_bytes(name))
    return assemble(name, card, data_files(card))
