"""What reproducing one figure or table yields: claims with both numbers and a verdict, tables, a drawing."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from stridelab.conventions import Progress

Verdict = Literal["met", "beaten", "not_met", "thesis_in_error"]
VERDICTS: Final[tuple[Verdict, ...]] = ("not_met", "thesis_in_error", "met", "beaten")
"""From what weighs most to what weighs least, when a figure makes several claims."""

Column = np.ndarray
"""One column of a table: numbers or words, one per row."""


@dataclass(frozen=True)
class Claim:
    """One statement that a figure makes, in one number.

    ``thesis`` is the printed number, or words where it prints none. ``verdict``: "met" within the claim, "beaten"
    better than claimed, "not_met" where our computation falls short of it, "thesis_in_error" where it cannot hold.
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
    """The result of one item; ``tables`` maps a name to columns with units in their names, ``drawing`` is an SVG."""

    claims: tuple[Claim, ...]
    note: str
    tables: Mapping[str, Mapping[str, Column]]
    drawing: str
    references: tuple[str, ...] = ("carpentier2017thesis",)

    @property
    def verdict(self) -> Verdict:
        """The verdict of the claim that weighs most."""
        return min((claim.verdict for claim in self.claims), key=VERDICTS.index)


@dataclass(frozen=True)
class Item:
    """A figure or a table that can be reproduced. ``run(seeds, tell)`` repeats it on that many simulated walks.

    ``printed`` names those of its tables that are short enough for a page.
    """

    name: str
    title: str
    run: Callable[[int, Progress], Reproduction]
    default_seeds: int = 1
    printed: tuple[str, ...] = ()


def judged(ours: float, *, at_most: float | None = None, at_least: float | None = None) -> Verdict:
    """Verdict of a number with a bound on one side: "met" or "not_met"."""
    if at_most is not None:
        return "met" if ours <= at_most else "not_met"
    return "met" if at_least is not None and ours >= at_least else "not_met"


def aimed(
    key: str,
    says: str,
    ours: float,
    unit: str,
    *,
    at_most: float | None = None,
    at_least: float | None = None,
    note: str = "",
) -> Claim:
    """An aim of our own, where the thesis has no number: "beaten" inside the bounds (both included), else "not_met".

    A number that is not finite lies inside no bounds.
    """
    inside = (at_most is None or ours <= at_most) and (at_least is None or ours >= at_least)
    word, scale = (f"m{unit}", 1e3) if unit in ("m", "s") else (unit, 1.0)
    suffix = "" if unit == "1" else f" {word}"
    if at_least is not None and at_most is not None:
        aim = f"{three_digits(scale * at_least)} to {three_digits(scale * at_most)}{suffix}"
    else:
        bound, sign = (at_most, "≤") if at_most is not None else (at_least, "≥")
        aim = f"{sign} {three_digits(scale * (bound or 0.0))}{suffix}"
    return Claim(key, says, f"aim {aim}", ours, unit, "beaten" if inside and math.isfinite(ours) else "not_met", note)


def three_digits(value: float) -> str:
    """A number to three digits, all before the point where there are more (up to a million)."""
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e6 else f"{value:.3g}"
