"""Result of one check, and the overall verdict of all checks."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

from stridelab.recordings.recording import Remark

Verdict = Literal["good", "doubtful", "contradicted"]
VERDICT_ORDER: Final[tuple[Verdict, ...]] = ("good", "doubtful", "contradicted")
CONTRADICTED: Final = "contradicted"
DOUBTFUL: Final = "doubtful"
"""Codes of the remarks, and verdicts."""


@dataclass(frozen=True)
class Check:
    """One value with its limits: it passes up to ``limit`` and contradicts above ``contradicted_above``.

    ``unit`` is "1" for a ratio. ``message`` is a sentence that names the compared sensors.
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
        """Whether the compared sensors contradict each other."""
        return self.value > self.contradicted_above


@dataclass(frozen=True)
class Quality:
    """Results of all possible checks, and by name the reasons why others were not possible."""

    checks: tuple[Check, ...]
    not_checked: Mapping[str, str] = field(default_factory=dict)

    @property
    def verdict(self) -> Verdict:
        """Contradicted if a check contradicts, doubtful if a check does not pass or none was possible, else good."""
        if any(check.contradicts for check in self.checks):
            return "contradicted"
        return "good" if self.checks and all(check.passed for check in self.checks) else "doubtful"

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """One remark for the verdict, to be shown before all others; empty for a good verdict."""
        if self.verdict == "good":
            return ()
        wrong = [c for c in self.checks if (c.contradicts if self.verdict == CONTRADICTED else not c.passed)]
        reasons = " ".join(check.message for check in wrong) or "No check was possible."
        if self.verdict == CONTRADICTED:
            return (Remark(CONTRADICTED, f"The sensors contradict each other; do not use these numbers. {reasons}"),)
        return (Remark(DOUBTFUL, f"Not every check of this recording passes. {reasons}"),)


def worst_verdict(verdicts: Iterable[Verdict]) -> Verdict:
    """Worst of the verdicts; good if there are none."""
    return max(verdicts, key=VERDICT_ORDER.index, default="good")
