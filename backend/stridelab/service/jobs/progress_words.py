"""Progress messages of jobs in words for people: ``"centroidal: iteration 12, ..."`` names a stage of the program."""

import re
from collections.abc import Mapping
from typing import Final

from stridelab.schemas.jobs import Progress

STAGE_WORDS: Final[Mapping[str, str]] = {
    "check": "checking the contacts",
    "reachability": "reading where the centre of mass can be",
    "centroidal": "planning the centre of mass",
    "whole body": "moving the whole body along the plan",
    "certificate": "checking the motion against its limits",
    "replay": "simulating the motion in physics",
    "export": "writing the files",
    "pushes": "pushing the robot",
    "uniform": "learning the reach of all postures",
    "conditioned": "learning the reach of standing postures",
    "walk": "trying a first walk",
    "search": "searching for the limits of the robot",
}
"""Words for the stages of a run, by their names in messages and in ``stage_times_s``."""
_CONTAINED_IN_STAGE: Final = frozenset(
    {
        "looking at the scenario",
        "reading the learned densities",
        "checking the motion",
        "simulating",
        "writing the plan",
    }
)
"""Activities that the words of their stage contain."""
_ACTIVITIES: Final[tuple[tuple[re.Pattern[str], str], ...]] = (
    (re.compile(r"iteration (\d+)\b.*"), r"improved \1 times so far"),
    (re.compile(r"solving for ([\d.]+ s)"), r"a motion of \1"),
    (re.compile(r"([\d.]+) of ([\d.]+ s)"), r"at \1 of \2 of the motion"),
    (re.compile(r"(\d+ %), ([\d.]+) of ([\d.]+ s)"), r"\1, at \2 of \3 of the motion"),
    (re.compile(r"whole body at ([\d.]+) s of ([\d.]+ s)"), r"at \1 of \2 of the motion"),
    (re.compile(r"pace ([\d.]+)"), r"at \1 times the pace"),
)
"""Forms of an activity, and the words for them."""


def progress_words(message: str) -> str:
    """The progress message in words: stages as what they do, numbers of the solver without its terms."""
    words = list[str]()
    for part in message.split(": "):
        if part not in _CONTAINED_IN_STAGE or not words:
            word = STAGE_WORDS.get(part) or _activity_words(part)
            if word not in words:
                words.append(word)
    return ": ".join(words)


def progress_of(fraction: float, message: str) -> Progress:
    """Progress of a job with its message, and with the same in words."""
    return Progress(fraction=fraction, message=message, text=progress_words(message))


def _activity_words(activity: str) -> str:
    for form, words in _ACTIVITIES:
        if match := form.fullmatch(activity):
            return match.expand(words)
    return activity
