"""Result of reproducing one figure or table: claims with the thesis' and our numbers, verdicts, tables, a drawing."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from stridelab.conventions import Progress

Verdict = Literal["met", "beaten", "not_met", "thesis_in_error"]
VERDICTS: Final[tuple[Verdict, ...]] = ("not_met", "thesis_in_error", "met", "beaten")
"""Verdicts in order of decreasing importance; the first one present is the verdict of an item."""

Column = np.ndarray
"""One column of a table: numbers or strings, one per row."""


@dataclass(frozen=True)
class Claim:
    """One statement of a figure, expressed by one number.

    ``thesis`` is the printed number, or words if there is none. ``verdict``: "met" if the claim is confirmed, "beaten"
    if our result is better than claimed, "not_met" if our result is worse, "thesis_in_error" if the claim is wrong.
    """

    key: str
    says: str
    thesis: float | str
    ours: float
    unit: str
    verdict: Verdict
    note: str = ""


@dataclass(frozen=True)
class Reproduction:
    """Result of one item; ``tables`` maps names to columns with units in their names, ``drawing`` is an SVG."""

    claims: tuple[Claim, ...]
    note: str
    tables: Mapping[str, Mapping[str, Column]]
    drawing: str
    references: tuple[str, ...] = ("carpentier2017thesis",)

    @property
    def verdict(self) -> Verdict:
        """Most important verdict of all claims, in the order of ``VERDICTS``."""
        return min((claim.verdict for claim in self.claims), key=VERDICTS.index)


@dataclass(frozen=True)
class Item:
    """A figure or table that can be reproduced; ``item(seeds, tell)`` computes it with ``seeds`` random draws.

    ``printed`` names the tables that are short enough for a page.
    """

    name: str
    title: str
    run: Callable[[int, Progress], Reproduction]
    default_seeds: int = 1
    printed: tuple[str, ...] = ()

    def __call__(self, seeds: int, tell: Progress) -> Reproduction:
        """Compute the item."""
        result = self.run(seeds, tell)
        tell(1.0, "done")
        return result


def reproduces(
    name: str, title: str, *, default_seeds: int = 1, printed: tuple[str, ...] = ()
) -> Callable[[Callable[[int, Progress], Reproduction]], Item]:
    """Decorator of the function that computes an item: makes it that item, which ``registry`` finds in its module."""
    return lambda run: Item(name, title, run, default_seeds, printed)


@dataclass(frozen=True)
class Measured:
    """The numbers of a claim, before its words: ``Measured("r", 0.67, ours, "1", met_if(ours > 0.5)).says("...")``."""

    key: str
    thesis: float | str
    ours: float
    unit: str
    verdict: Verdict

    def says(self, says: str, note: str = "") -> Claim:
        """The claim that the thesis makes in these words, with a remark on our number."""
        return Claim(self.key, says, self.thesis, self.ours, self.unit, self.verdict, note)


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
    return Measured(key, f"aim {aim}", ours, unit, "beaten" if inside and math.isfinite(ours) else "not_met")


def format_three_digits(value: float) -> str:
    """Format a number with three significant digits; integers without exponent up to a million."""
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e6 else f"{value:.3g}"
