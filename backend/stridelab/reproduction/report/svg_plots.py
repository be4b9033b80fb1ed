"""Line plots and bar charts as SVG: panels with axes, legends, linear or logarithmic scales.

The palette of Okabe and Ito is safe for common forms of colour blindness. Colours and sizes are presentation
attributes: the file contains neither scripts nor styles.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final
from xml.sax.saxutils import escape

import numpy as np
from jaxtyping import Float

PALETTE: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
WIDTH, HEIGHT = 720, 240
_LEFT, _RIGHT, _TOP, _BOTTOM = 70.0, 150.0, 26.0, 40.0
_BAR_LEFT, _BAR_RIGHT = 170.0, 70.0
_MAX_POINTS = 900
_FONT: Final = 'font-family="sans-serif" font-size="11" fill="#222222"'

Values = Float[np.ndarray, "_"]
"""Coordinates of one curve; curves of a panel may differ in length."""


@dataclass(frozen=True)
class Curve:
    """One curve, interrupted at non-finite values; ``colour`` is an index into ``PALETTE``."""

    x: Values
    y: Values
    name: str
    colour: int = 0
    dashed: bool = False


@dataclass(frozen=True)
class Panel:
    """One pair of axes with curves; a logarithmic axis omits values that are not positive."""

    title: str
    x_label: str
    y_label: str
    curves: Sequence[Curve]
    log_x: bool = False
    log_y: bool = False


@dataclass(frozen=True)
class Bars:
    """Horizontal bar chart; a non-finite value is labelled but has no bar."""

    title: str
    unit: str
    values: Sequence[tuple[str, float]]


def render_svg(*panels: Panel | Bars) -> str:
    """Render the panels below each other as one SVG document."""
    size = f'width="{WIDTH}" height="{HEIGHT * len(panels)}"'
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT * len(panels)}" {size} role="img">',
        f'<rect {size} fill="#ffffff"/>',
    ]
    for number, panel in enumerate(panels):
        parts.append(f'<g transform="translate(0 {HEIGHT * number})">')
        parts += _render_panel(panel) if isinstance(panel, Panel) else _render_bars(panel)
        parts.append("</g>")
    return "\n".join([*parts, "</svg>"]) + "\n"


@dataclass(frozen=True)
class _Scale:
    """Mapping from data to pixels along one axis."""

    low: float
    high: float
    start: float
    end: float
    log: bool

    def __call__(self, value: float) -> float:
        a, b, v = (math.log10(x) if self.log else x for x in (self.low, self.high, value))
        return self.start + (v - a) / (b - a) * (self.end - self.start)

    def tick_values(self) -> list[float]:
        if self.log:
            first, last = math.ceil(math.log10(self.low) - 1e-9), math.floor(math.log10(self.high) + 1e-9)
            every = max(1, math.ceil((last - first) / 6))
            return [10.0**k for k in range(first, last + 1, every)]
        raw = (self.high - self.low) / 5
        unit = 10.0 ** math.floor(math.log10(raw))
        step = next(k * unit for k in (1, 2, 5, 10) if k * unit >= raw)
        return [k * step for k in range(math.ceil(self.low / step), math.floor(self.high / step) + 1)]


def _render_panel(panel: Panel) -> list[str]:
    x = _scale_of_values([c.x for c in panel.curves], panel.log_x, _LEFT, WIDTH - _RIGHT, margin=0.0)
    y = _scale_of_values([c.y for c in panel.curves], panel.log_y, HEIGHT - _BOTTOM, _TOP, margin=0.05)
    parts = [f'<text x="{_LEFT}" y="16" {_FONT} font-weight="bold">{escape(panel.title)}</text>']
    for tick in x.tick_values():
        at = x(tick)
        parts.append(_line_path(at, _TOP, at, HEIGHT - _BOTTOM, "#e3e3e3"))
        parts.append(f'<text x="{at:.1f}" y="{HEIGHT - _BOTTOM + 14}" {_FONT} text-anchor="middle">{tick:g}</text>')
    for tick in y.tick_values():
        at = y(tick)
        parts.append(_line_path(_LEFT, at, WIDTH - _RIGHT, at, "#e3e3e3"))
        parts.append(f'<text x="{_LEFT - 6}" y="{at + 4:.1f}" {_FONT} text-anchor="end">{tick:g}</text>')
    parts.append(
        f'<rect x="{_LEFT}" y="{_TOP}" width="{WIDTH - _LEFT - _RIGHT}" height="{HEIGHT - _TOP - _BOTTOM}" '
        'fill="none" stroke="#555555"/>'
    )
    middle = (_LEFT + WIDTH - _RIGHT) / 2
    parts.append(f'<text x="{middle}" y="{HEIGHT - 8}" {_FONT} text-anchor="middle">{escape(panel.x_label)}</text>')
    half = (_TOP + HEIGHT - _BOTTOM) / 2
    parts.append(
        f'<text x="14" y="{half}" {_FONT} text-anchor="middle" transform="rotate(-90 14 {half})">'
        f"{escape(panel.y_label)}</text>"
    )
    for row, curve in enumerate(panel.curves):
        colour = PALETTE[curve.colour % len(PALETTE)]
        dash = ' stroke-dasharray="5 3"' if curve.dashed else ""
        parts += [
            f'<polyline points="{run}" fill="none" stroke="{colour}" stroke-width="1.4"{dash}/>'
            for run in _polyline_runs(curve, x, y)
        ]
        at = _TOP + 10 + 16 * row
        right = WIDTH - _RIGHT + 10
        parts.append(f'<path d="M {right} {at} h 18" stroke="{colour}" stroke-width="2"{dash}/>')
        parts.append(f'<text x="{right + 24}" y="{at + 4}" {_FONT}>{escape(curve.name)}</text>')
    return parts


def _render_bars(bars: Bars) -> list[str]:
    parts = [f'<text x="16" y="16" {_FONT} font-weight="bold">{escape(bars.title)} ({escape(bars.unit)})</text>']
    finite = [value for _, value in bars.values if math.isfinite(value)]
    low, high = min(0.0, *finite, 0.0), max(0.0, *finite, 0.0)
    scale = _Scale(low, high if high > low else low + 1.0, _BAR_LEFT, WIDTH - _BAR_RIGHT, log=False)
    pitch = (HEIGHT - _TOP - 8.0) / max(len(bars.values), 1)
    for row, (name, value) in enumerate(bars.values):
        y = _TOP + row * pitch
        middle = y + pitch / 2 + 4
        parts.append(f'<text x="{_BAR_LEFT - 8}" y="{middle:.1f}" {_FONT} text-anchor="end">{escape(name)}</text>')
        start, end = sorted((scale(0.0), scale(value) if math.isfinite(value) else scale(0.0)))
        parts.append(
            f'<rect x="{start:.1f}" y="{y + 1:.1f}" width="{end - start:.1f}" height="{pitch - 2:.1f}" '
            f'fill="{PALETTE[0]}"/>'
        )
        written = f"{value:.3g}" if math.isfinite(value) else "none"
        parts.append(f'<text x="{end + 6:.1f}" y="{middle:.1f}" {_FONT}>{written}</text>')
    parts.append(_line_path(scale(0.0), _TOP, scale(0.0), HEIGHT - 8.0, "#555555"))
    return parts


def _scale_of_values(values: Sequence[Values], log: bool, start: float, end: float, *, margin: float) -> _Scale:
    finite = np.concatenate([v[np.isfinite(v) & ((v > 0.0) | (not log))] for v in values])
    if len(finite) == 0:
        finite = np.array([1.0])
    low, high = float(finite.min()), float(finite.max())
    if log:
        return _Scale(low, high if high > low else 10.0 * low, start, end, log)
    padding = margin * (high - low) or (0.0 if high > low else max(abs(high), 1.0) / 2)
    return _Scale(low - padding, high + padding, start, end, log)


def _polyline_runs(curve: Curve, x: _Scale, y: _Scale) -> list[str]:
    """Segments of the curve between gaps, thinned to ``_MAX_POINTS`` points."""
    every = max(1, len(curve.x) // _MAX_POINTS)
    runs: list[list[str]] = [[]]
    for a, b in zip(curve.x[::every].tolist(), curve.y[::every].tolist(), strict=True):
        drawn = math.isfinite(a) and math.isfinite(b) and (a > 0.0 or not x.log) and (b > 0.0 or not y.log)
        if drawn:
            runs[-1].append(f"{x(a):.1f},{y(b):.1f}")
        elif runs[-1]:
            runs.append([])
    return [" ".join(run) for run in runs if run]


def _line_path(x0: float, y0: float, x1: float, y1: float, colour: str) -> str:
    return f'<path d="M {x0:.1f} {y0:.1f} L {x1:.1f} {y1:.1f}" stroke="{colour}" stroke-width="0.7"/>'
