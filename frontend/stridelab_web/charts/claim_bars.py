"""A claim as a small picture: our number with its interval beside the range in which the claim holds."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

MARGIN: Final = 0.12
"""Space on both sides of the numbers, as a share of their span."""
_IN_UNITS: Final = {"mm": ("m", 1e-3), "ms": ("s", 1e-3)}
"""Units that short lengths and times are written in."""
_NUMBER: Final = r"(-?\d[\d.]*(?:e[+-]?\d+)?)(?: ([^\s(;,]+))?"
_BOUND: Final = re.compile(rf"([≤<≥>]) {_NUMBER}")
_RANGE: Final = re.compile(rf"{_NUMBER} to {_NUMBER}")
_INTERVAL: Final = re.compile(rf"95 % from {_NUMBER} to {_NUMBER}(?=;|$)")
_ALONE: Final = re.compile(_NUMBER)
_EXACTLY: Final = re.compile(rf"{_NUMBER}(?= \()")
LEAST_WIDTH: Final = 1.5
"""Least width of a range in percent, so that a single value is seen."""


@dataclass(frozen=True)
class ClaimBar:
    """Places in percent of the width: of our number, of its interval, and of the range that holds; and all as text."""

    ours_x: float
    range_x: float
    range_width: float
    interval_x: float | None
    interval_width: float
    ours: str
    caption: str

    @property
    def text(self) -> str:
        """The picture in words."""
        return f"{self.ours}; {self.caption}"


def draw_claim(
    ours: float, holds: tuple[float | None, float | None], interval: Sequence[float] | None, texts: tuple[str, str]
) -> ClaimBar | None:
    """The picture of a claim that holds between the bounds ``holds``; one of them may be None, for an open side.

    An open side of the range reaches the edge of the picture. ``texts`` are our number with its unit, and a caption
    that states interval and range. None if there is no bound, or a number is not finite.
    """
    low, high = holds
    drawn = [value for value in (ours, low, high, *(interval or ())) if value is not None]
    if (low is None and high is None) or not all(map(math.isfinite, drawn)):
        return None
    first, last = min(drawn), max(drawn)
    space = MARGIN * (last - first or abs(first) or 1.0)
    first, span = first - space, last - first + 2 * space

    def place_percent(value: float) -> float:
        return round(100 * (value - first) / span, 2)

    start, end = (0.0 if low is None else place_percent(low)), (100.0 if high is None else place_percent(high))
    if end - start < LEAST_WIDTH:
        start, end = (start + end - LEAST_WIDTH) / 2, (start + end + LEAST_WIDTH) / 2
    edges = None if interval is None else (place_percent(interval[0]), place_percent(interval[1]))
    return ClaimBar(
        ours_x=place_percent(ours),
        range_x=round(start, 2),
        range_width=round(end - start, 2),
        interval_x=edges[0] if edges else None,
        interval_width=round(edges[1] - edges[0], 2) if edges else 0.0,
        ours=texts[0],
        caption=texts[1],
    )


def read_claim(holds: str, ours: str, evidence: str) -> ClaimBar | None:
    """The picture of a claim that the book has recorded as texts; None if they have no numbers or differ in units."""
    bounds, number = _bounds_of(holds), _ALONE.fullmatch(ours)
    if bounds is None or number is None:
        return None
    value, unit = _in_base_units(number[1], number[2])
    spread = _INTERVAL.search(evidence)
    edges = None if spread is None else (_in_base_units(*spread.group(1, 2)), _in_base_units(*spread.group(3, 4)))
    given = [one for one in (*bounds, *(edges or ())) if one is not None]
    if any(one_unit != unit for one, one_unit in given if one != 0):
        return None
    low, high = (None if one is None else one[0] for one in bounds)
    interval = None if edges is None else (edges[0][0], edges[1][0])
    caption = f"holds if {holds}" if spread is None else f"{spread[0]}; holds if {holds}"
    return draw_claim(value, (low, high), interval, (ours, caption))


def _bounds_of(holds: str) -> tuple[tuple[float, str] | None, tuple[float, str] | None] | None:
    if match := _RANGE.match(holds):
        return _in_base_units(*match.group(1, 2)), _in_base_units(*match.group(3, 4))
    if match := _BOUND.match(holds):
        bound = _in_base_units(match[2], match[3])
        return (None, bound) if match[1] in "≤<" else (bound, None)
    if match := _EXACTLY.match(holds):
        bound = _in_base_units(match[1], match[2])
        return bound, bound
    return None


def _in_base_units(number: str, unit: str | None) -> tuple[float, str]:
    base, factor = _IN_UNITS.get(unit or "", (unit or "", 1.0))
    return float(number) * factor, base
