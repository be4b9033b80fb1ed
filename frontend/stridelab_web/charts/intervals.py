"""Intervals as bars: positions in percent of the recording's duration, ready for an SVG."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from stridelab.schemas.recordings import PlateInfo, Recording
from stridelab.translations.catalogue import gettext

MAX_TICKS = 8
MIN_NUMBERED_PERCENT = 1.6
"""Minimum width, in percent of the whole, of intervals that show their number."""


@dataclass(frozen=True)
class Bar:
    """One interval; ``x`` and ``width`` in percent. ``css`` is an additional class, ``at_s`` a time that it marks."""

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
    """Bars beside a label; ``text`` describes them, ``css`` is their class."""

    label: str
    bars: tuple[Bar, ...]
    text: str
    css: str


@dataclass(frozen=True)
class Layer:
    """Nodes of a scene that can be hidden: those whose names begin with ``prefix``; ``scale`` is that of its arrows."""

    prefix: str
    label: str
    shown: bool = True
    tooltip: str = ""
    scale: str = ""

    def translated(self) -> "Layer":
        """The layer with its label and its tooltip in the language of the page."""
        return replace(self, label=gettext(self.label), tooltip=gettext(self.tooltip) if self.tooltip else "")


@dataclass(frozen=True)
class PlateBars:
    """The loaded intervals of one plate, and a sentence that describes them."""

    index: int
    use: bool
    bars: tuple[Bar, ...]
    text: str


def interval_bars(intervals: Iterable[Sequence[float]], duration_s: float) -> tuple[Bar, ...]:
    """Intervals in seconds as bars, cut at the ends of the recording; empty if the duration is zero."""
    if duration_s <= 0:
        return ()
    inside = []
    for start, end in intervals:
        low, high = max(0.0, start), min(duration_s, end)
        if high > low:
            text = _interval_text(start, end)
            inside.append(Bar(round(100 * low / duration_s, 3), round(100 * (high - low) / duration_s, 3), text))
    return tuple(inside)


def numbered_bars(intervals: Iterable[Sequence[float]], duration_s: float, first: int = 0) -> tuple[Bar, ...]:
    """Intervals as bars, with their numbers on bars that are wide enough."""
    return tuple(
        Bar(bar.x, bar.width, str(first + k) if bar.width >= MIN_NUMBERED_PERCENT else "")
        for k, bar in enumerate(interval_bars(intervals, duration_s))
    )


def plate_bars(plate: PlateInfo, duration_s: float) -> PlateBars:
    """The loaded intervals of a plate."""
    drawn = interval_bars(plate.loaded_s, duration_s)
    intervals_text = "; ".join(bar.text for bar in drawn) or gettext("never")
    text = gettext("Plate %(index)s loaded: %(intervals)s", index=plate.index, intervals=intervals_text)
    return PlateBars(plate.index, plate.use, drawn, text)


def windows_text(recording: Recording) -> str:
    """Sentence that describes the strip of windows."""
    if not recording.windows_s:
        return gettext("There is no interval in which all contact forces are measured: only markers can be used.")
    listed = ", ".join(_interval_text(start, end) for start, end in recording.windows_s)
    return gettext("All contact forces are measured from %(intervals)s.", intervals=listed)


def _interval_text(start_s: float, end_s: float) -> str:
    return gettext("%(start)s s to %(end)s s", start=f"{start_s:.2f}", end=f"{end_s:.2f}")


def time_ticks(duration_s: float) -> tuple[Tick, ...]:
    """Round times along the axis: steps of 1, 2 or 5 times a power of ten."""
    if duration_s <= 0:
        return ()
    rough = duration_s / MAX_TICKS
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(factor * power for factor in (1, 2, 5, 10) if factor * power >= rough * (1 - 1e-9))
    digits = max(0, -math.floor(math.log10(step)))
    marks = []
    for k in range(math.floor(duration_s / step + 1e-9) + 1):
        x = 100 * k * step / duration_s
        anchor = "start" if k == 0 else "end" if x > 97 else "middle"
        marks.append(Tick(round(x, 3), f"{k * step:.{digits}f} s", anchor))
    return tuple(marks)
