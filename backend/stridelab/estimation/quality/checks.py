"""A check, and the verdict of all checks."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

from stridelab.recordings.recording import Remark

Verdict = Literal["good", "doubtful", "contradicted"]
ORDER: Final[tuple[Verdict, ...]] = ("good", "doubtful", "contradicted")
CONTRADICTED: Final = "contradicted"
DOUBTFUL: Final = "doubtful"
"""Codes of the remarks, and verdicts."""


@dataclass(frozen=True)
class Check:
    """One number against its limit: above ``limit`` it does not pass, from ``contradicted_above`` on it contradicts.

    ``unit`` is "1" for a ratio. ``message`` is a sentence that names the sensors that the check holds together.
    """

    name: str
    value: float
    unit: str
    limit: float
    contradicted_above: float
    message: str

    @property
    def passed(self) -> bool:
        """Whether the value is within its limit."""
        return self.value <= self.limit

    @property
    def contradicts(self) -> bool:
        """Whether the sensors cannot both be right."""
        return self.value > self.contradicted_above


@dataclass(frozen=True)
class Quality:
    """All checks that were possible, and why the others were not, by name."""

    checks: tuple[Check, ...]
    not_checked: Mapping[str, str] = field(default_factory=dict)

    @property
    def verdict(self) -> Verdict:
        """Contradicted where one check contradicts, doubtful where one does not pass or none was possible."""
        if any(check.contradicts for check in self.checks):
            return "contradicted"
        return "good" if self.checks and all(check.passed for check in self.checks) else "doubtful"

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """One remark for the verdict, to be shown before all others; none where it is good."""
        if self.verdict == "good":
            return ()
        wrong = [c for c in self.checks if (c.contradicts if self.verdict == CONTRADICTED else not c.passed)]
        reasons = " ".join(check.message for check in wrong) or "No check was possible."
        if self.verdict == CONTRADICTED:
            return (Remark(CONTRADICTED, f"The sensors contradict each other; do not use these numbers. {reasons}"),)
        return (Remark(DOUBTFUL, f"Not every check of this recording passes. {reasons}"),)


def worst(verdicts: Iterable[Verdict]) -> Verdict:
    """The worst of some verdicts; good where there is none."""
    return max(verdicts, key=ORDER.index, default="good")
