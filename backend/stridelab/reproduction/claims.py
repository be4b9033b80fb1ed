"""Result of reproducing one figure or table: claims with the thesis' and our numbers, verdicts, tables, a drawing."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal, TypedDict, Unpack

import numpy as np

from stridelab.conventions import Progress

Verdict = Literal["met", "beaten", "not_met", "thesis_in_error"]
VERDICTS: Final[tuple[Verdict, ...]] = ("not_met", "thesis_in_error", "met", "beaten")
"""Verdicts in order of decreasing importance; the first one present is the verdict of an item."""
Outcome = Literal["not_met", "thesis_in_error", "met", "beaten", "aim_missed", "aim_reached"]
OUTCOMES: Final[tuple[Outcome, ...]] = (*VERDICTS, "aim_missed", "aim_reached")
"""Verdicts on the thesis, then what became of our own aims, which are no verdicts on the thesis."""
WORDS: Final[dict[Outcome, str]] = {
    "met": "met",
    "beaten": "better",
    "not_met": "not met",
    "thesis_in_error": "thesis in error",
    "aim_reached": "our aim: reached",
    "aim_missed": "our aim: missed",
}
Evidence = Literal["simulated", "replayed", "people", "external"]
"""Origin of our number: computed from models and simulated recordings; motions carried out in a physics simulation;
recordings of people; numbers published by others (the thesis itself, descriptions of robots)."""
Sampling = Literal["nothing", "one", "many"]
"""What an item draws at random: nothing, one sample of fixed size, or a number of draws that can be chosen."""

Column = np.ndarray
"""One column of a table: numbers or strings, one per row."""


@dataclass(frozen=True)
class Claim:
    """One statement of a figure, expressed by one number.

    ``thesis`` is the printed number, or words if there is none. ``verdict``: "met" if the claim is confirmed, "beaten"
    if our result is better than claimed, "not_met" if our result is worse, "thesis_in_error" if the claim is wrong.
    ``aim`` marks a threshold of this project, on which "beaten" and "not_met" are no verdicts on the thesis.
    ``n`` is the number of cases (draws, steps, people, contact sets) behind our number, ``interval`` its 95 % interval,
    ``comparator`` what it is compared with. Only before ``Reproduction.with_basis``, ``evidence`` and ``n`` may lack.
    """

    key: str
    says: str
    thesis: float | str
    ours: float
    unit: str
    verdict: Verdict
    note: str = ""
    evidence: Evidence | None = None
    n: int | None = None
    solver: str | None = None
    interval: tuple[float, float] | None = None
    comparator: str | None = None
    aim: bool = False

    @property
    def outcome(self) -> Outcome:
        """The verdict on the thesis, or whether our own aim is reached."""
        if not self.aim:
            return self.verdict
        return "aim_reached" if self.verdict in ("met", "beaten") else "aim_missed"


@dataclass(frozen=True)
class Reproduction:
    """Result of one item; ``tables`` maps names to columns with units in their names, ``drawing`` is an SVG.

    ``n`` is the number of cases behind all claims that do not state their own.
    """

    claims: tuple[Claim, ...]
    note: str
    tables: Mapping[str, Mapping[str, Column]]
    drawing: str
    references: tuple[str, ...] = ("carpentier2017thesis",)
    n: int | None = None

    @property
    def verdict(self) -> Verdict:
        """Most important verdict on the thesis, in the order of ``VERDICTS``; of our aims if there is none."""
        judged = [claim for claim in self.claims if not claim.aim] or self.claims
        return min((claim.verdict for claim in judged), key=VERDICTS.index)

    def with_basis(self, evidence: Evidence, n: int) -> "Reproduction":
        """The same with ``evidence`` and ``n`` on all claims that do not state their own."""
        cases = n if self.n is None else self.n
        claims = (
            replace(each, evidence=each.evidence or evidence, n=cases if each.n is None else each.n)
            for each in self.claims
        )
        return replace(self, claims=tuple(claims))


@dataclass(frozen=True)
class Item:
    """A figure or table that can be reproduced; ``item(seeds, tell)`` computes it with the seeds of its random draws.

    ``printed`` names the tables that are short enough for a page.
    """

    name: str
    title: str
    run: Callable[[range, Progress], Reproduction]
    draws: Sampling = "nothing"
    default_seeds: int = 1
    min_seeds: int = 1
    printed: tuple[str, ...] = ()
    evidence: Evidence = "simulated"

    def __call__(self, seeds: range, tell: Progress) -> Reproduction:
        """Compute the item; all claims of the result have their evidence and number of cases."""
        result = self.run(seeds, tell).with_basis(self.evidence, len(seeds))
        tell(1.0, "done")
        return result


def reproduces(
    name: str,
    title: str,
    *,
    draws: Sampling = "nothing",
    default_seeds: int = 1,
    min_seeds: int = 1,
    printed: tuple[str, ...] = (),
) -> Callable[[Callable[[range, Progress], Reproduction]], Item]:
    """Decorator of the function that computes an item: makes it that item, which ``registry`` finds in its module."""
    return lambda run: Item(name, title, run, draws, default_seeds, min_seeds, printed)


def sampling_text(draws: Sampling, seeds: range) -> str:
    """How often an item draws, as a sentence."""
    if draws == "nothing":
        return "Draws nothing at random."
    if draws == "one":
        return f"One random sample, seed {seeds[0]}."
    return f"{len(seeds)} random draws, seeds {seeds[0]} to {seeds[-1]}." if len(seeds) > 1 else f"Seed {seeds[0]}."


class Basis(TypedDict, total=False):
    """Fields of a claim that say what our number is computed from."""

    n: int | None
    evidence: Evidence | None
    solver: str | None
    interval: tuple[float, float] | None
    comparator: str | None


@dataclass(frozen=True)
class Measured:
    """The numbers of a claim, before its words: ``Measured("r", 0.67, ours, "1", met_if(ours > 0.5)).says("...")``."""

    key: str
    thesis: float | str
    ours: float
    unit: str
    verdict: Verdict
    aim: bool = False

    def says(self, says: str, note: str = "", **basis: Unpack[Basis]) -> Claim:
        """The claim that the thesis makes in these words, with a remark on our number and what it is computed from."""
        return Claim(self.key, says, self.thesis, self.ours, self.unit, self.verdict, note, aim=self.aim, **basis)


def met_if(holds: bool | np.bool) -> Verdict:
    """Verdict "met" or "not_met"."""
    return "met" if holds else "not_met"


def error_unless(holds: bool | np.bool) -> Verdict:
    """Verdict "met" or "thesis_in_error"."""
    return "met" if holds else "thesis_in_error"


def target(
    key: str, ours: float, unit: str, *, at_least: float | None = None, at_most: float | None = None
) -> Measured:
    """Numbers of a target of this project, without a number in the thesis: "beaten" inside the closed bounds.

    Outside the bounds, or if the number is not finite, the verdict is "not_met".
    """
    inside = (at_most is None or ours <= at_most) and (at_least is None or ours >= at_least)
    word, scale = (f"m{unit}", 1e3) if unit in ("m", "s") else (unit, 1.0)
    suffix = "" if unit == "1" else f" {word}"
    if at_least is not None and at_most is not None:
        aim = f"{format_three_digits(scale * at_least)} to {format_three_digits(scale * at_most)}{suffix}"
    else:
        bound, sign = (at_most, "≤") if at_most is not None else (at_least, "≥")
        aim = f"{sign} {format_three_digits(scale * (bound or 0.0))}{suffix}"
    verdict: Verdict = "beaten" if inside and math.isfinite(ours) else "not_met"
    return Measured(key, f"aim {aim}", ours, unit, verdict, aim=True)


def format_three_digits(value: float) -> str:
    """Format a number with three significant digits; integers without exponent up to a million."""
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e6 else f"{value:.3g}"
