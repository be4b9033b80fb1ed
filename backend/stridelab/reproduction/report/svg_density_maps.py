"""Maps of projected densities as SVG, as in figures 4.2 and 4.4: one row per density, one column per axis.

The colour scale of a column is that of its first map; the darkest colour is its maximum. Solid lines in all rows
enclose the smallest area with 95 % of the first row, dashed lines that of the row itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final
from xml.sax.saxutils import escape

import numpy as np
from jaxtyping import Float
from skimage.measure import find_contours
from skimage.morphology import convex_hull_image

from stridelab.reachability.proxy.projections import PLOT_AXES, Grid, Map
from stridelab.reproduction.report.svg_plots import PALETTE

BANDS: Final = ("#eff3ff", "#d6e4f5", "#bdd7e7", "#94c4df", "#6baed6", "#4a97c9", "#2e7ebc", "#1764ab", "#084a91")
"""Sequential colours of one hue, readable in greyscale."""
MASS: Final = 0.95
WIDTH: Final = 720
_LABEL, _GAP, _TOP, _BOTTOM = 116.0, 34.0, 20.0, 34.0
_FONT: Final = 'font-family="sans-serif" font-size="11" fill="#222222"'


AnyMap = Float[np.ndarray, "_ _"]
"""A map of any size."""


@dataclass(frozen=True)
class Row:
    """One density, projected along x, y and z."""

    name: str
    maps: tuple[AnyMap, AnyMap, AnyMap]


def level_of_mass(density: Map, mass: float = MASS) -> float:
    """Level above which a map on a uniform grid contains the share ``mass`` of its total."""
    falling = np.sort(density.ravel())[::-1]
    return float(falling[np.searchsorted(np.cumsum(falling), mass * falling.sum())])


def svg_maps(rows: Sequence[Row], grid: Grid) -> str:
    """Render the maps as one SVG document with axes in metres and a common scale."""
    extents = [[grid.axis_m(axis)[-1] - grid.low_m[axis] for axis in across] for across in PLOT_AXES]
    pixels = (WIDTH - _LABEL - 3 * _GAP) / sum(width for width, _ in extents)  # per metre
    tall = max(height for _, height in extents) * pixels + _TOP + _BOTTOM
    size = f'width="{WIDTH}" height="{tall * len(rows):.0f}"'
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {tall * len(rows):.0f}" {size} role="img">',
        f'<rect {size} fill="#ffffff"/>',
    ]
    for number, row in enumerate(rows):
        y = number * tall + _TOP
        parts.append(f'<text x="8" y="{y + 12:.1f}" {_FONT} font-weight="bold">{escape(row.name)}</text>')
        x = _LABEL
        for along, (width, height) in enumerate(extents):
            step = grid.step_m * pixels
            parts.append(f'<g transform="translate({x:.1f} {y + height * pixels:.1f})">')
            parts += _filled_bands(row.maps[along], rows[0].maps[along].max(), step)
            parts += _contour_lines(rows[0].maps[along], step, 0, dashed=False)
            if number:
                parts += _contour_lines(row.maps[along], step, 1, dashed=True)
            parts += _draw_axes(along, grid, width * pixels, height * pixels)
            parts.append("</g>")
            x += width * pixels + _GAP
    return "\n".join([*parts, "</svg>"]) + "\n"


def _filled_bands(density: Map, top: float, step: float) -> list[str]:
    """Filled cells, one path per colour band; rows go upwards."""
    band = np.minimum(len(BANDS) * density / top, len(BANDS) - 1).astype(int)
    paths: list[list[str]] = [[] for _ in BANDS]
    for j, line in enumerate(band):
        starts = np.flatnonzero(np.diff(line, prepend=-1))
        for start, end in zip(starts, [*starts[1:], len(line)], strict=True):
            paths[line[start]].append(
                f"M{(start - 0.5) * step:.1f} {-(j + 0.5) * step:.1f}h{(end - start) * step:.1f}v{step:.1f}"
                f"h{-(end - start) * step:.1f}z"
            )
    return [f'<path d="{"".join(runs)}" fill="{BANDS[i]}"/>' for i, runs in enumerate(paths) if runs and i]


def _contour_lines(density: Map, step: float, colour: int, *, dashed: bool) -> list[str]:
    dash = ' stroke-dasharray="4 2"' if dashed else ""
    polylines = []
    for line in find_contours(density, level_of_mass(density)):  # type: ignore[no-untyped-call]
        points = " ".join(f"{j * step:.1f},{-i * step:.1f}" for i, j in line)
        polylines.append(
            f'<polyline points="{points}" fill="none" stroke="{PALETTE[colour]}" stroke-width="1.1"{dash}/>'
        )
    return polylines


def _draw_axes(along: int, grid: Grid, width: float, height: float) -> list[str]:
    """Frame, ticks every 0.5 m, and axis labels."""
    right, up = PLOT_AXES[along]
    parts = [
        f'<path d="M0 0h{width:.1f}v{-height:.1f}h{-width:.1f}z" fill="none" stroke="#555555" stroke-width="0.7"/>'
    ]
    for axis, pixels in ((right, width), (up, height)):
        values = grid.axis_m(axis)
        for tick in 0.5 * np.arange(int(np.ceil(2 * values[0])), int(np.floor(2 * values[-1])) + 1):
            at = pixels * (tick - values[0]) / (values[-1] - values[0])
            place = f'x="{at:.1f}" y="12" text-anchor="middle"' if axis == right else f'x="-3" y="{4 - at:.1f}"'
            end = "" if axis == right else ' text-anchor="end"'
            parts.append(f"<text {place}{end} {_FONT}>{tick:g}</text>")
    names = f"{'xyz'[right]} to the right, {'xyz'[up]} upwards (m)"
    parts.append(f'<text x="{width / 2:.1f}" y="26" {_FONT} text-anchor="middle">{names}</text>')
    return parts


def hull_area_share(density: Map, mass: float) -> float:
    """Area of the set with ``mass`` over that of its convex hull; 1 for a convex set, up to discretisation."""
    inside: Float[np.ndarray, "up right"] = (density >= level_of_mass(density, mass)).astype(float)
    hull = convex_hull_image(inside > 0.5, offset_coordinates=False)  # type: ignore[no-untyped-call]
    return float(inside.sum() / hull.sum())
