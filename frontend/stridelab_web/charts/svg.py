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
    """A line through ``points`` (of an SVG), or the closed outline of an area; ``text`` describes it."""

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
class Circle:
    """A circle that is drawn to scale."""

    x: float
    y: float
    radius: float
    css: str


@dataclass
class Chart:
    """A chart over ``x_range`` and ``y_range``, in their units, to which elements are added; the caption is a sentence.

    With ``true_scale`` both axes have the same scale, and the height follows from the width.
    """

    x_range: Range
    y_range: Range
    x_title: str
    y_title: str
    width: float = 560.0
    height: float = 300.0
    true_scale: bool = False
    caption: str = ""
    shades: list[Shade] = field(default_factory=list)
    bands: list[Curve] = field(default_factory=list)
    circles: list[Circle] = field(default_factory=list)
    curves: list[Curve] = field(default_factory=list)
    whiskers: list[Whisker] = field(default_factory=list)
    marks: list[Mark] = field(default_factory=list)

    def __post_init__(self) -> None:
        if self.true_scale:
            self.height = self.px_per_x * (self.y_range[1] - self.y_range[0]) + TOP_PX + BOTTOM_PX

    left, top = LEFT_PX, TOP_PX

    @property
    def right(self) -> float:
        return round(self.width - RIGHT_PX, 1)

    @property
    def bottom(self) -> float:
        return round(self.height - BOTTOM_PX, 1)

    @property
    def x_ticks(self) -> list[Tick]:
        """Ticks of the horizontal axis."""
        at_most = (self.width - LEFT_PX - RIGHT_PX) / TICK_PX_X
        return [Tick(round(self.x_px(v), 1), text) for v, text in axis_ticks(self.x_range, at_most)]

    @property
    def y_ticks(self) -> list[Tick]:
        """Ticks of the vertical axis."""
        at_most = (self.height - TOP_PX - BOTTOM_PX) / TICK_PX_Y
        return [Tick(round(self.y_px(v), 1), text) for v, text in axis_ticks(self.y_range, at_most)]

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
                self.curves.append(Curve(points, css, text))

    def add_band(self, x: np.ndarray, low: np.ndarray, high: np.ndarray, css: str) -> None:
        """Add the area between two curves over the same ``x``."""
        outline = [*zip(x, low, strict=True), *zip(x[::-1], high[::-1], strict=True)]
        self.bands.append(Curve(" ".join(f"{self.x_px(u):.1f},{self.y_px(v):.1f}" for u, v in outline), css))

    def add_cell(self, x: Range, y: Range, css: str, text: str) -> None:
        """Add a rectangle over an interval of each axis."""
        corners = [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])]
        self.bands.append(Curve(" ".join(f"{self.x_px(u):.1f},{self.y_px(v):.1f}" for u, v in corners), css, text))

    def add_mark(
        self, x: float, y: float, css: str, shape: Shape = "circle", text: str = "", label: str = "", href: str = ""
    ) -> None:
        """Add a point, unless a coordinate is missing."""
        if math.isfinite(x) and math.isfinite(y):
            self.marks.append(Mark(round(self.x_px(x), 1), round(self.y_px(y), 1), css, shape, text, label, href))

    def add_vertical_line(self, x: float, low: float, high: float, css: str) -> None:
        """Add a vertical line, such as an error bar."""
        if all(math.isfinite(v) for v in (x, low, high)):
            px = round(self.x_px(x), 1)
            self.whiskers.append(Whisker(px, round(self.y_px(low), 1), px, round(self.y_px(high), 1), css))

    def add_horizontal_line(self, y: float, low: float, high: float, css: str) -> None:
        """Add a horizontal line."""
        if all(math.isfinite(v) for v in (y, low, high)):
            px = round(self.y_px(y), 1)
            self.whiskers.append(Whisker(round(self.x_px(low), 1), px, round(self.x_px(high), 1), px, css))

    def add_shade(self, start: float, end: float, css: str, text: str) -> None:
        """Add a shaded interval of the horizontal axis, cut at the ends of the axis."""
        low, high = max(start, self.x_range[0]), min(end, self.x_range[1])
        if high > low:
            self.shades.append(Shade(round(self.x_px(low), 1), round((high - low) * self.px_per_x, 1), css, text))

    def add_circle(self, x: float, y: float, radius: float, css: str) -> None:
        """Add a circle; ``radius`` is in units of the horizontal axis, for charts of true scale."""
        self.circles.append(
            Circle(round(self.x_px(x), 1), round(self.y_px(y), 1), round(radius * self.px_per_x, 1), css)
        )

    def with_caption(self, caption: str) -> "Chart":
        """The chart itself, with this caption."""
        self.caption = caption
        return self


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
