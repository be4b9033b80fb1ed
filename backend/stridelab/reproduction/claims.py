"""Result of reproducing one figure or table: claims with the thesis' and our numbers, verdicts, tables, a drawing."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal, TypedDict, Unpack

import numpy as np

from stridelab.conventions import Progress

Verdict = Literal["met", "beaten", "not_met", "thesis_in_error", "undecided"]
VERDICTS: Final[tuple[Verdict, ...]] = ("not_met", "thesis_in_error", "undecided", "met", "beaten")
"""Verdicts in order of decreasing importance; the first one present is the verdict of an item."""
Outcome = Literal[
    "not_met", "thesis_in_error", "undecided", "met", "beaten", "aim_missed", "aim_undecided", "aim_reached"
]
OUTCOMES: Final[tuple[Outcome, ...]] = (*VERDICTS, "aim_missed", "aim_undecided", "aim_reached")
"""Verdicts on the thesis, then what became of our own aims, which are no verdicts on the thesis."""
WORDS: Final[dict[Outcome, str]] = {
    "met": "met",
    "beaten": "better",
    "not_met": "not met",
    "thesis_in_error": "thesis in error",
    "undecided": "undecided",
    "aim_reached": "our aim: reached",
    "aim_undecided": "our aim: undecided",
    "aim_missed": "our aim: missed",
}
Evidence = Literal["simulated", "replayed", "people", "external"]
"""Origin of our number: computed from models and simulated recordings; motions carried out in a physics simulation;
recordings of people; numbers published by others (the thesis itself, descriptions of robots)."""
Threshold = Literal["thesis", "words", "ours"]
"""Whose the bounds of a claim are: printed in the thesis; implied by its words without a number of ours (a sign, an
order, equality up to rounding or to sampling error); or an aim of this project."""
Sampling = Literal["nothing", "one", "many"]
"""What an item draws at random: nothing, one sample of fixed size, or a number of draws that can be chosen."""

NoInterval = Literal["deterministic", "in_claim", "one_case", "one_sample", "machine_time"]
"""Why a number has no 95 % interval: nothing is drawn; the claim itself is on sampling error (a probability, a bound in
standard errors); there is one case; one sample of fixed size, of which a statistic has none; a time of one machine."""

Column = np.ndarray
"""One column of a table: numbers or strings, one per row."""


def outcome_of_aim(verdict: Verdict) -> Outcome:
    """Whether an aim of this project is reached, by the verdict on it."""
    if verdict == "undecided":
        return "aim_undecided"
    return "aim_reached" if verdict in ("met", "beaten") else "aim_missed"


@dataclass(frozen=True)
class Claim:
    """One statement of a figure, expressed by one number.

    ``thesis`` is the printed number, or words if there is none, ``where`` the section or figure that makes the claim.
    ``verdict``: "met" if the claim is confirmed, "beaten" if our result is better than claimed, "not_met" if our result
    is worse, "thesis_in_error" if the claim is wrong, "undecided" if the interval contains values of both kinds.
    The claim holds from ``holds_from`` to ``holds_to`` (without the bounds if ``strict``), which are the bounds of
    ``threshold``; a value on the other side overturns the verdict. ``aim`` marks claims that the thesis does not make:
    on them "beaten" and "not_met" are no verdicts on the thesis.
    ``n`` is the number of cases (draws, steps, people, contact sets) behind our number, ``interval`` its 95 % interval,
    ``comparator`` what it is compared with. A claim on every case, whose number is the most extreme one, has
    ``cases_inside`` instead of an interval: how many of the n cases are in the range themselves. ``no_interval`` says
    why neither exists. Only before ``Reproduction.with_basis``, ``evidence``, ``n``, ``where`` and all three may lack.
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
    where: str = ""
    holds_from: float | None = None
    holds_to: float | None = None
    strict: bool = False
    threshold: Threshold = "ours"
    cases_inside: int | None = None
    no_interval: NoInterval | None = None

    @property
    def has_uncertainty(self) -> bool:
        """Whether the claim has an interval, counted cases or the reason for neither."""
        return not (self.interval is None and self.cases_inside is None and self.no_interval is None)

    @property
    def outcome(self) -> Outcome:
        """The verdict on the thesis, or whether our own aim is reached."""
        return outcome_of_aim(self.verdict) if self.aim else self.verdict


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

    def with_basis(
        self, evidence: Evidence, n: int, where: str = "", no_interval: NoInterval | None = None
    ) -> "Reproduction":
        """The same with the arguments on all claims that do not state their own."""
        cases = n if self.n is None else self.n
        claims = (
            replace(
                each,
                evidence=each.evidence or evidence,
                n=cases if each.n is None else each.n,
                where=each.where or ("" if each.aim else where),
                no_interval=each.no_interval if each.has_uncertainty else no_interval,
            )
            for each in self.claims
        )
        return replace(self, claims=tuple(claims))


def place_of(item: str) -> str:
    """The figure, table or chapter of the thesis that an item reproduces: "figure 4.5"; else the study of 2.5.4."""
    kind, _, rest = item.partition("-")
    places = {"fig": "figure", "table": "table", "numbers": "chapter"}
    return f"{places[kind]} {rest.partition('-')[0]}" if kind in places else "2.5.4"


@dataclass(frozen=True)
class Item:
    """A figure or table that can be reproduced; ``item(seeds, tell)`` computes it with the seeds of its random draws.

    ``printed`` names the tables that are short enough for a page.
    """

    name: str
    title: str
    run: Callable[[range, Progress], Reproduction]
    draws: Sampling
    default_seeds: int
    min_seeds: int
    printed: tuple[str, ...]
    evidence: Evidence = "simulated"

    @property
    def where(self) -> str:
        """Place of the thesis."""
        return place_of(self.name)

    def __call__(self, seeds: range, tell: Progress) -> Reproduction:
        """Compute the item; all claims of the result have their evidence, number of cases and place."""
        certain: NoInterval | None = "deterministic" if self.draws == "nothing" else None
        result = self.run(seeds, tell).with_basis(self.evidence, len(seeds), self.where, certain)
        tell(1.0, "done")
        return result


@dataclass(frozen=True)
class PeopleItem:
    """An item on recordings of people: ``run(gait, tell)`` computes it from those below the folder ``gait``."""

    name: str
    title: str
    run: Callable[[Path, Progress], Reproduction]
    module: str
    printed: tuple[str, ...] = ()


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
    """Fields of a claim that say what our number is computed from, and where the thesis makes the claim."""

    n: int | None
    evidence: Evidence | None
    solver: str | None
    interval: tuple[float, float] | None
    comparator: str | None
    where: str
    cases_inside: int | None
    no_interval: NoInterval | None


class Certain(TypedDict):
    """Fields of ``Basis`` of a number for which nothing is drawn."""

    n: int
    no_interval: NoInterval


DETERMINISTIC: Final[Certain] = {"n": 1, "no_interval": "deterministic"}
"""Basis of a number that is computed once, from nothing that is drawn."""


@dataclass(frozen=True)
class Criterion:
    """Range of our number in which a claim holds, and whose bounds these are.

    Outside the range the verdict is ``otherwise``. Inside it is "met", or "beaten" on the far side of ``better_than``
    from the bound.
    """

    threshold: Threshold
    low: float | None = None
    high: float | None = None
    strict: bool = False
    better_than: float | None = None
    otherwise: Verdict = "not_met"

    def contains(self, value: float) -> bool:
        """Whether the claim holds for this number; never if it is not finite."""
        if not math.isfinite(value):
            return False
        if self.strict:
            return bool((self.low is None or value > self.low) and (self.high is None or value < self.high))
        return bool((self.low is None or value >= self.low) and (self.high is None or value <= self.high))

    def verdict(self, ours: float, interval: tuple[float, float] | None = None) -> Verdict:
        """Verdict on our number: "undecided" if the claim holds in a part of its ``interval`` only."""
        if interval is not None and not self._settles(*interval):
            return "undecided"
        if not self.contains(ours):
            return self.otherwise
        if self.better_than is not None and (ours < self.better_than if self.low is None else ours > self.better_than):
            return "beaten"
        return "met"

    def _settles(self, low: float, high: float) -> bool:
        """Whether the claim holds at all values of the interval, or at none of them."""
        if self.contains(low) and self.contains(high):
            return True
        below = self.low is not None and not math.isnan(high) and high < self.low
        above = self.high is not None and not math.isnan(low) and low > self.high
        return bool(below or above)


def at_most(
    bound: float, threshold: Threshold, *, better_than: float | None = None, otherwise: Verdict = "not_met"
) -> Criterion:
    """The claim holds up to ``bound``."""
    return Criterion(threshold, high=bound, better_than=better_than, otherwise=otherwise)


def at_least(
    bound: float, threshold: Threshold, *, better_than: float | None = None, otherwise: Verdict = "not_met"
) -> Criterion:
    """The claim holds from ``bound`` on."""
    return Criterion(threshold, low=bound, better_than=better_than, otherwise=otherwise)


def below(
    bound: float, threshold: Threshold, *, better_than: float | None = None, otherwise: Verdict = "not_met"
) -> Criterion:
    """The claim holds below ``bound``."""
    return Criterion(threshold, high=bound, strict=True, better_than=better_than, otherwise=otherwise)


def above(bound: float, threshold: Threshold, *, otherwise: Verdict = "not_met") -> Criterion:
    """The claim holds above ``bound``."""
    return Criterion(threshold, low=bound, strict=True, otherwise=otherwise)


def within(low: float, high: float, threshold: Threshold, *, otherwise: Verdict = "not_met") -> Criterion:
    """The claim holds from ``low`` to ``high``."""
    return Criterion(threshold, low=low, high=high, otherwise=otherwise)


@dataclass(frozen=True)
class Measured:
    """The numbers of a claim, before its words: ``Measured("r", 0.67, ours, "1", above(0.5, "ours")).says("...")``."""

    key: str
    thesis: float | str
    ours: float
    unit: str
    criterion: Criterion
    aim: bool = False

    def says(self, says: str, note: str = "", **basis: Unpack[Basis]) -> Claim:
        """The claim that the thesis makes in these words, with a remark on our number and what it is computed from."""
        holds = self.criterion
        if "interval" in basis and basis["interval"] is None:
            basis.setdefault("no_interval", "one_case")
        return Claim(
            self.key,
            says,
            self.thesis,
            self.ours,
            self.unit,
            holds.verdict(self.ours, basis.get("interval")),
            note,
            aim=self.aim,
            holds_from=holds.low,
            holds_to=holds.high,
            strict=holds.strict,
            threshold=holds.threshold,
            **basis,
        )


def target(
    key: str, ours: float, unit: str, *, at_least: float | None = None, at_most: float | None = None
) -> Measured:
    """Numbers of a target of this project, without a number in the thesis: "beaten" inside the closed bounds.

    Outside the bounds, or if the number is not finite, the verdict is "not_met".
    """
    word, scale = (f"m{unit}", 1e3) if unit in ("m", "s") else (unit, 1.0)
    suffix = "" if unit == "1" else f" {word}"
    if at_least is not None and at_most is not None:
        aim = f"{format_three_digits(scale * at_least)} to {format_three_digits(scale * at_most)}{suffix}"
    else:
        bound, sign = (at_most, "≤") if at_most is not None else (at_least, "≥")
        aim = f"{sign} {format_three_digits(scale * (bound or 0.0))}{suffix}"
    better = math.inf if at_least is None else -math.inf
    criterion = Criterion("ours", low=at_least, high=at_most, better_than=better)
    return Measured(key, f"aim {aim}", ours, unit, criterion, aim=True)


def format_three_digits(value: float) -> str:
    """Format a number with three significant digits; integers without exponent up to a million."""
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e6 else f"{value:.3g}"
