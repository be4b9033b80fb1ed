"""Estimates that a proposed card offers for torques which its description states and which cannot be right.

They are in the text of what is assumed of a field; nothing here imports a library of robots, for the web server.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from stridelab.robots.card import RobotCard

_ESTIMATE: Final = re.compile(r"the estimate is ([0-9.e+-]+) N m")
_CHOSEN: Final = "in place of what the description states"


def offered_estimate(stated_nm: float, why: str, estimate_nm: float) -> str:
    """What is assumed of a stated torque that is implausible: nothing yet, but an estimate is offered."""
    return f"{stated_nm:g} N m as stated, which is implausible: {why}; the estimate is {estimate_nm:g} N m"


def estimate_of(how: str) -> float | None:
    """The estimate (N m) that ``offered_estimate`` states; None for any other text."""
    found = _ESTIMATE.search(how)
    return None if found is None else float(found[1])


def chosen_estimate(how: str) -> str:
    """What is assumed of a field once its estimate was chosen."""
    return f"{estimate_of(how):g} N m, estimated, {_CHOSEN} ({how.partition(' N m')[0]} N m)"


def take_estimates(card: RobotCard, assumed: Mapping[str, str]) -> tuple[RobotCard, dict[str, str]]:
    """The card with every estimate that is offered in place of what is stated, and what is then assumed."""
    torque_nm, now = dict(card.limits.torque_nm), dict(assumed)
    for field, how in assumed.items():
        if (estimate_nm := estimate_of(how)) is not None:
            torque_nm[re.escape(field.removeprefix("limits.torque_nm."))] = estimate_nm
            now[field] = chosen_estimate(how)
    return replace(card, limits=replace(card.limits, torque_nm=torque_nm)), now
