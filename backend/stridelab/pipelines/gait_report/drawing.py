"""Charts of the report as lines, areas and texts in millimetres, which HTML and PDF draw alike."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from jaxtyping import Float

from stridelab.measures.gait_cycle import N_SAMPLES
from stridelab.pipelines.gait_report.content import Curve, Label, Panel
from stridelab.translations.catalogue import gettext

Point = tuple[float, float]
Place = Callable[[float, float], Point]
LEFT_COLOUR: Final = "#0b62a4"
RIGHT_COLOUR: Final = "#c4560a"
REFERENCE_COLOUR: Final = "#70757d"
INK: Final = "#1b1f24"
PALE: Final = "#5b636d"
GRID: Final = "#d5d9de"
COLOURS: Final[Mapping[Label, str]] = {"left": LEFT_COLOUR, "right": RIGHT_COLOUR, "reference": REFERENCE_COLOUR}
DASHES: Final[Mapping[Label, tuple[float, float] | None]] = {"left": None, "right": (1.6, 0.9), "reference": (0.5, 0.7)}
"""Dashes in millimetres, so that the sides also differ on a printer without colours."""


@dataclass(frozen=True)
class Line:
    """An open line; ``dash`` are the lengths of stroke and gap."""

    points: Sequence[Point]
    colour: str
    width: float = 0.2
    dash: tuple[float, float] | None = None


@dataclass(frozen=True)
class Area:
    """A filled polygon."""

    points: Sequence[Point]
    colour: str
    opacity: float = 1.0


@dataclass(frozen=True)
class Text:
    """A text with its base line at ``y``; ``size`` in millimetres."""

    x: float
    y: float
    text: str
    size: float
    anchor: Literal["start", "middle", "end"] = "start"
    colour: str = INK
    bold: bool = False


Item = Line | Area | Text


@dataclass(frozen=True)
class Drawing:
    """Items on an area of ``width`` x ``height``, x to the right, y down."""

    width: float
    height: float
    items: tuple[Item, ...]


WIDTH: Final = 88.0
HEIGHT: Final = 44.0
_PLOT: Final = (11.0, 9.5, WIDTH - 4.5, HEIGHT - 5.0)
"""Left, top, right and bottom of the axes."""
_SIZE: Final = 2.5


def draw_panel(panel: Panel) -> Drawing:
    """Curves of one quantity over the gait cycle with bands of one standard deviation; the reference is shaded."""
    left, top, right, bottom = _PLOT
    items: list[Item] = [Text(0.0, 3.0, panel.title, 3.0, bold=True), Text(0.0, 6.8, panel.caption, _SIZE, colour=PALE)]
    if not panel.curves:
        items.append(Text((left + right) / 2, (top + bottom) / 2, gettext("not measured"), _SIZE, "middle", PALE))
        return Drawing(WIDTH, HEIGHT, tuple(items))
    drawn = [*([panel.reference] if panel.reference else []), *panel.curves]
    low, high = _limits(drawn)

    def place(percent: float, value: float) -> Point:
        across, up = percent / 100.0, (value - low) / (high - low)
        return round(left + across * (right - left), 3), round(bottom - up * (bottom - top), 3)

    for value in _round_values(low, high):
        items.append(Line([place(0.0, value), place(100.0, value)], GRID, 0.15 if value else 0.4))
        x, y = place(0.0, value)
        items.append(Text(x - 1.0, y + 0.9, f"{value:zg}", _SIZE, "end", PALE))
    for percent in range(0, 101, 20):
        x, y = place(float(percent), low)
        items.append(Text(x, y + 3.4, f"{percent} %" if percent == 100 else str(percent), _SIZE, "middle", PALE))
    for one in drawn:
        if one.sd is not None:
            opacity = 0.3 if one.label == "reference" else 0.16
            items += [Area(points, COLOURS[one.label], opacity) for points in _bands(one, place)]
    for one in drawn:
        width = 0.3 if one.label == "reference" else 0.5
        for run in _runs(one.mean):
            points = [place(float(k), float(one.mean[k])) for k in run]
            items.append(Line(points, COLOURS[one.label], width, DASHES[one.label]))
    return Drawing(WIDTH, HEIGHT, tuple(items))


def _limits(curves: Sequence[Curve]) -> tuple[float, float]:
    edges = [edge for one in curves for sign in (-1.0, 1.0) for edge in _edge(one, sign) if math.isfinite(edge)]
    low, high = min(edges), max(edges)
    space = 0.05 * (high - low) or 1.0
    return low - space, high + space


def _edge(one: Curve, sign: float) -> Float[np.ndarray, "101"]:
    """Curve with its standard deviation added or subtracted where it is known."""
    return one.mean if one.sd is None else np.asarray(one.mean + sign * np.nan_to_num(one.sd))


def _bands(one: Curve, place: Place) -> Iterator[list[Point]]:
    upper, lower = _edge(one, 1.0), _edge(one, -1.0)
    for run in _runs(one.mean):
        there = [place(float(k), float(upper[k])) for k in run]
        yield there + [place(float(k), float(lower[k])) for k in reversed(run)]


def _runs(values: Float[np.ndarray, "101"]) -> Iterator[range]:
    """Ranges of at least two samples without a gap."""
    start = None
    for k in range(N_SAMPLES + 1):
        given = k < N_SAMPLES and bool(np.isfinite(values[k]))
        if given and start is None:
            start = k
        elif not given and start is not None:
            if k - start > 1:
                yield range(start, k)
            start = None


def _round_values(low: float, high: float) -> list[float]:
    """Three to six multiples of 1, 2 or 5 times a power of ten."""
    raw = (high - low) / 5.0
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= raw)
    first, last = math.ceil(low / step), math.floor(high / step)
    return [round(k * step, 9) for k in range(first, last + 1)]


def legend(panels: Sequence[Panel]) -> list[tuple[Label, Drawing]]:
    """The curves that occur, each with a piece of its line."""
    given = {one.label for panel in panels for one in (*panel.curves, panel.reference) if one is not None}
    labels: tuple[Label, ...] = ("left", "right", "reference")
    return [
        (label, Drawing(8.0, 2.0, (Line([(0.0, 1.0), (8.0, 1.0)], COLOURS[label], 0.5, DASHES[label]),)))
        for label in labels
        if label in given
    ]
