"""Intervals as bars: positions in percent of the recording's duration, ready for an SVG."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from stridelab.schemas.recordings import PlateInfo, Recording

TICKS_AT_MOST = 8
NUMBER_FROM_PERCENT = 1.6
"""An interval at least this wide, in percent of the whole, has its number written on it."""


@dataclass(frozen=True)
class Bar:
    """One interval; ``x`` and ``width`` in percent. ``css`` is one more class, ``at_s`` an instant that it marks."""

    x: float
    width: float
    text: str
    css: str = ""
    at_s: float | None = None


@dataclass(frozen=True)
class Tick:
    """One mark of the time axis; ``x`` in percent, ``anchor`` for the text beside an edge."""

    x: float
    text: str
    anchor: str


@dataclass(frozen=True)
class Row:
    """Bars beside a label; ``text`` says the same in words, ``css`` is the class of the bars."""

    label: str
    bars: tuple[Bar, ...]
    text: str
    css: str


@dataclass(frozen=True)
class Layer:
    """Nodes of a scene that can be hidden: all whose names begin with ``prefix``; ``said`` explains them."""

    prefix: str
    label: str
    shown: bool = True
    said: str = ""


@dataclass(frozen=True)
class PlateBars:
    """The loaded intervals of one plate, and the sentence that says the same."""

    index: int
    use: bool
    bars: tuple[Bar, ...]
    text: str


def bars(intervals: Iterable[Sequence[float]], duration_s: float) -> tuple[Bar, ...]:
    """Intervals in seconds as bars, cut at the ends of the recording; none where the duration is zero."""
    if duration_s <= 0:
        return ()
    found = []
    for start, end in intervals:
        low, high = max(0.0, start), min(duration_s, end)
        if high > low:
            text = f"{start:.2f} s to {end:.2f} s"
            found.append(Bar(round(100 * low / duration_s, 3), round(100 * (high - low) / duration_s, 3), text))
    return tuple(found)


def numbered(intervals: Iterable[Sequence[float]], duration_s: float, first: int = 0) -> tuple[Bar, ...]:
    """Intervals as bars with their numbers, where there is room for them."""
    return tuple(
        Bar(bar.x, bar.width, str(first + k) if bar.width >= NUMBER_FROM_PERCENT else "")
        for k, bar in enumerate(bars(intervals, duration_s))
    )


def plate_bars(plate: PlateInfo, duration_s: float) -> PlateBars:
    """The loaded intervals of a plate."""
    drawn = bars(plate.loaded_s, duration_s)
    said = "; ".join(bar.text for bar in drawn) or "never"
    return PlateBars(plate.index, plate.use, drawn, f"Plate {plate.index} loaded: {said}")


def windows_text(recording: Recording) -> str:
    """The sentence that says what the strip of windows shows."""
    if not recording.windows_s:
        return "There is no interval in which all contact forces are measured: only markers can be used."
    listed = ", ".join(f"{start:.2f} s to {end:.2f} s" for start, end in recording.windows_s)
    return f"All contact forces are measured from {listed}."


def ticks(duration_s: float) -> tuple[Tick, ...]:
    """Round times along the axis: steps of 1, 2 or 5 times a power of ten."""
    if duration_s <= 0:
        return ()
    rough = duration_s / TICKS_AT_MOST
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(factor * power for factor in (1, 2, 5, 10) if factor * power >= rough * (1 - 1e-9))
    digits = max(0, -math.floor(math.log10(step)))
    marks = []
    for k in range(math.floor(duration_s / step + 1e-9) + 1):
        x = 100 * k * step / duration_s
        anchor = "start" if k == 0 else "end" if x > 97 else "middle"
        marks.append(Tick(round(x, 3), f"{k * step:.{digits}f} s", anchor))
    return tuple(marks)
