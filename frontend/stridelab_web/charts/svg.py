"""Charts drawn on the server: axes with units, curves, marks with error bars, ready for an SVG (_charts.html).

Every mark has a text that is shown to pointers and keyboards. A chart with the same scale on both axes is drawn to
scale; others have different units in their titles.
"""

import math
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np

Shape = Literal["circle", "square", "triangle", "diamond", "cross", "ring"]
Range = tuple[float, float]
SHAPES: Final[tuple[Shape, ...]] = ("circle", "square", "triangle", "diamond", "cross", "ring")
LEFT_PX, RIGHT_PX, TOP_PX, BOTTOM_PX = 64.0, 14.0, 12.0, 44.0
TICK_PX_X, TICK_PX_Y = 80.0, 42.0
"""Minimum distance between two ticks."""
STEPS: Final = (1.0, 2.0, 2.5, 5.0, 10.0)


@dataclass(frozen=True)
class Tick:
    """A mark of an axis at ``px``."""

    px: float
    text: str


@dataclass(frozen=True)
class Curve:
    """A line through ``points`` (of an SVG); ``text`` describes it."""

    points: str
    css: str
    text: str = ""


@dataclass(frozen=True)
class Mark:
    """A point with a shape, a description, and an optional short label beside it."""

    x: float
    y: float
    css: str
    shape: Shape = "circle"
    text: str = ""
    label: str = ""
    href: str = ""


@dataclass(frozen=True)
class Whisker:
    """A straight line, such as an error bar."""

    x1: float
    y1: float
    x2: float
    y2: float
    css: str


@dataclass(frozen=True)
class Shade:
    """An interval of the horizontal axis."""

    x: float
    width: float
    css: str
    text: str


@dataclass(frozen=True)
class Band:
    """A closed outline ``points`` (of an SVG), such as that of a curve's standard errors; ``text`` describes it."""

    points: str
    css: str
    text: str = ""


@dataclass(frozen=True)
class Circle:
    """A circle that is drawn to scale."""

    x: float
    y: float
    radius: float
    css: str


@dataclass(frozen=True)
class Chart:
    """A drawn chart with a caption of one sentence."""

    width: float
    height: float
    left: float
    top: float
    right: float
    bottom: float
    x_title: str
    y_title: str
    x_ticks: tuple[Tick, ...]
    y_ticks: tuple[Tick, ...]
    shades: tuple[Shade, ...]
    bands: tuple[Band, ...]
    circles: tuple[Circle, ...]
    curves: tuple[Curve, ...]
    whiskers: tuple[Whisker, ...]
    marks: tuple[Mark, ...]
    caption: str


@dataclass
class Canvas:
    """Collects the elements of a chart over ``x_range`` and ``y_range``, in their units.

    With ``true_scale`` both axes have the same scale, and the height follows from the width.
    """

    x_range: Range
    y_range: Range
    x_title: str
    y_title: str
    width: float = 560.0
    height: float = 300.0
    true_scale: bool = False
    _shades: list[Shade] = field(default_factory=list)
    _bands: list[Band] = field(default_factory=list)
    _circles: list[Circle] = field(default_factory=list)
    _curves: list[Curve] = field(default_factory=list)
    _whiskers: list[Whisker] = field(default_factory=list)
    _marks: list[Mark] = field(default_factory=list)

    def __post_init__(self) -> None:
        if self.true_scale:
            self.height = self.px_per_x * (self.y_range[1] - self.y_range[0]) + TOP_PX + BOTTOM_PX

    @property
    def px_per_x(self) -> float:
        return (self.width - LEFT_PX - RIGHT_PX) / (self.x_range[1] - self.x_range[0])

    def x_px(self, value: float) -> float:
        """Pixel position of a value of the horizontal axis."""
        return LEFT_PX + (value - self.x_range[0]) * self.px_per_x

    def y_px(self, value: float) -> float:
        """Pixel position of a value of the vertical axis."""
        low, high = self.y_range
        return self.height - BOTTOM_PX - (value - low) / (high - low) * (self.height - TOP_PX - BOTTOM_PX)

    def add_curve(self, x: np.ndarray, y: np.ndarray, css: str, text: str = "") -> None:
        """Add a line, interrupted at missing values."""
        finite = np.isfinite(x) & np.isfinite(y)
        for part in np.split(np.arange(len(x)), np.flatnonzero(~finite)):
            run = part[finite[part]]
            if len(run) > 1:
                points = " ".join(f"{self.x_px(u):.1f},{self.y_px(v):.1f}" for u, v in zip(x[run], y[run], strict=True))
                self._curves.append(Curve(points, css, text))

    def add_band(self, x: np.ndarray, low: np.ndarray, high: np.ndarray, css: str) -> None:
        """Add the area between two curves over the same ``x``."""
        outline = [*zip(x, low, strict=True), *zip(x[::-1], high[::-1], strict=True)]
        self._bands.append(Band(" ".join(f"{self.x_px(u):.1f},{self.y_px(v):.1f}" for u, v in outline), css))

    def add_cell(self, x: Range, y: Range, css: str, text: str) -> None:
        """Add a rectangle over an interval of each axis."""
        corners = [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])]
        self._bands.append(Band(" ".join(f"{self.x_px(u):.1f},{self.y_px(v):.1f}" for u, v in corners), css, text))

    def add_mark(
        self, x: float, y: float, css: str, shape: Shape = "circle", text: str = "", label: str = "", href: str = ""
    ) -> None:
        """Add a point, unless a coordinate is missing."""
        if math.isfinite(x) and math.isfinite(y):
            self._marks.append(Mark(round(self.x_px(x), 1), round(self.y_px(y), 1), css, shape, text, label, href))

    def add_vertical_line(self, x: float, low: float, high: float, css: str) -> None:
        """Add a vertical line, such as an error bar."""
        if all(math.isfinite(v) for v in (x, low, high)):
            px = round(self.x_px(x), 1)
            self._whiskers.append(Whisker(px, round(self.y_px(low), 1), px, round(self.y_px(high), 1), css))

    def add_horizontal_line(self, y: float, low: float, high: float, css: str) -> None:
        """Add a horizontal line."""
        if all(math.isfinite(v) for v in (y, low, high)):
            px = round(self.y_px(y), 1)
            self._whiskers.append(Whisker(round(self.x_px(low), 1), px, round(self.x_px(high), 1), px, css))

    def add_shade(self, start: float, end: float, css: str, text: str) -> None:
        """Add a shaded interval of the horizontal axis, cut at the ends of the axis."""
        low, high = max(start, self.x_range[0]), min(end, self.x_range[1])
        if high > low:
            self._shades.append(Shade(round(self.x_px(low), 1), round((high - low) * self.px_per_x, 1), css, text))

    def add_circle(self, x: float, y: float, radius: float, css: str) -> None:
        """Add a circle; ``radius`` is in units of the horizontal axis, for charts of true scale."""
        self._circles.append(
            Circle(round(self.x_px(x), 1), round(self.y_px(y), 1), round(radius * self.px_per_x, 1), css)
        )

    def build_chart(self, caption: str) -> Chart:
        """Build the chart of all elements."""
        inner = self.width - LEFT_PX - RIGHT_PX, self.height - TOP_PX - BOTTOM_PX
        return Chart(
            width=round(self.width, 1),
            height=round(self.height, 1),
            left=LEFT_PX,
            top=TOP_PX,
            right=round(self.width - RIGHT_PX, 1),
            bottom=round(self.height - BOTTOM_PX, 1),
            x_title=self.x_title,
            y_title=self.y_title,
            x_ticks=tuple(
                Tick(round(self.x_px(v), 1), text) for v, text in axis_ticks(self.x_range, inner[0] / TICK_PX_X)
            ),
            y_ticks=tuple(
                Tick(round(self.y_px(v), 1), text) for v, text in axis_ticks(self.y_range, inner[1] / TICK_PX_Y)
            ),
            shades=tuple(self._shades),
            bands=tuple(self._bands),
            circles=tuple(self._circles),
            curves=tuple(self._curves),
            whiskers=tuple(self._whiskers),
            marks=tuple(self._marks),
            caption=caption,
        )


def axis_ticks(span: Range, at_most: float) -> list[tuple[float, str]]:
    """Round numbers inside ``span``, about ``at_most`` of them (at least two), and their texts."""
    low, high = span
    wanted = (high - low) / max(at_most, 2.0)
    power = 10.0 ** math.floor(math.log10(wanted))
    size = next(power * step for step in STEPS if power * step >= wanted * (1 - 1e-9))
    first, last = math.ceil(low / size - 1e-9), math.floor(high / size + 1e-9)
    digits = next((d for d in range(7) if abs(round(size, d) - size) < 1e-9 * size), 7)
    return [(k * size, f"{k * size:z.{digits}f}") for k in range(first, last + 1)]


def range_of(*values: np.ndarray, share: float = 0.08, min_width: float = 1e-6) -> Range:
    """Range of ``values`` with a margin and a minimum width; 0 to 1 without finite values."""
    finite = np.concatenate([np.ravel(np.asarray(v, dtype=float)) for v in values]) if values else np.empty(0)
    finite = finite[np.isfinite(finite)]
    if not len(finite):
        return (0.0, 1.0)
    low, high = float(finite.min()), float(finite.max())
    margin = max(share * (high - low), (min_width - (high - low)) / 2, 0.0)
    return (low - margin, high + margin)
