"""The robots that have a card: what small files say of them, and whether they can be loaded."""

from stridelab.errors import NotFound, StridelabError
from stridelab.robots.card import robot_card, robot_names
from stridelab.robots.data_files import data_files
from stridelab.schemas.robots import RobotSummary
from stridelab.service.api.robots.shelf import RobotShelf


def known_name(name: str) -> str:
    """``name`` if there is such a robot; what a user typed goes no further otherwise.

    Raises ``NotFound`` (``robot-not-found``).
    """
    names = robot_names()
    if name not in names:
        raise NotFound("robot-not-found", f"There is no robot of this name; there is {', '.join(names) or 'none'}.")
    return names[names.index(name)]


def summaries() -> list[RobotSummary]:
    """One line per robot, by name; one whose card cannot be read, or whose files are missing, says why."""
    return [_summary(name) for name in robot_names()]


async def loaded(summary: RobotSummary, robots: RobotShelf) -> RobotSummary:
    """``summary`` of a robot that can be loaded, or with the reason why it cannot."""
    reason = await robots.problem(summary.name) if summary.available else summary.reason
    return summary.model_copy(update={"available": reason is None, "reason": reason})


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
