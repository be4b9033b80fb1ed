"""The robots that have a card: read from small files, without loading a robot."""

from stridelab.errors import NotFound, StridelabError
from stridelab.robots.card import robot_card, robot_names
from stridelab.robots.data_files import data_files
from stridelab.schemas.robots import RobotSummary


def known_name(name: str) -> str:
    """``name`` if there is such a robot; what a user typed goes no further otherwise.

    Raises ``NotFound`` (``robot-not-found``).
    """
    names = robot_names()
    if name not in names:
        raise NotFound("robot-not-found", f"There is no robot of this name; there is {', '.join(names) or 'none'}.")
    return names[names.index(name)]


def summaries() -> list[RobotSummary]:
    """One line per robot, by name; a robot that cannot be loaded here says why."""
    return [_summary(name) for name in robot_names()]


def _summary(name: str) -> RobotSummary:
    try:
        card = robot_card(name)
    except StridelabError as error:
        return RobotSummary(name=name, title=name, licence="", available=False, reason=error.message, effectors=[])
    reason = None
    try:
        data_files(card)
    except StridelabError as error:
        reason = error.message
    return RobotSummary(
        name=name,
        title=card.title,
        licence=card.licence,
        available=reason is None,
        reason=reason,
        effectors=list(card.effectors),
    )
