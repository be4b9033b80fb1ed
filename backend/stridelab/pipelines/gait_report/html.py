"""The report as one page of HTML without scripts and without addresses of other files."""

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Final

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from stridelab.pipelines.gait_report.content import ReportContent
from stridelab.pipelines.gait_report.drawing import Area, Drawing, Item, Line, Point, draw_panel, legend

TEMPLATE: Final = "report.html.j2"


def render_html(content: ReportContent) -> str:
    """The page; every text of ``content`` is escaped."""
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    template = environment.from_string((Path(__file__).parent / TEMPLATE).read_text(encoding="utf-8"))
    return template.render(
        report=content,
        drawings=[draw_svg(draw_panel(panel), panel.title) for panel in content.panels],
        keys=[(label, draw_svg(line, label)) for label, line in legend(content.panels)],
    )


def draw_svg(drawing: Drawing, title: str) -> Markup:
    """A drawing as an inline SVG element, one unit per millimetre."""
    items = "".join(_draw_item(item) for item in drawing.items)
    box = f"0 0 {drawing.width:g} {drawing.height:g}"
    return Markup(f'<svg viewBox="{box}" role="img" aria-label="{escape(title)}">{items}</svg>')


def _draw_item(item: Item) -> str:
    if isinstance(item, Area):
        return f'<polygon points="{_points(item.points)}" fill="{item.colour}" fill-opacity="{item.opacity:g}"/>'
    if isinstance(item, Line):
        dash = "" if item.dash is None else f' stroke-dasharray="{item.dash[0]:g} {item.dash[1]:g}"'
        style = f'fill="none" stroke="{item.colour}" stroke-width="{item.width:g}"{dash}'
        return f'<polyline points="{_points(item.points)}" {style}/>'
    weight = ' font-weight="600"' if item.bold else ""
    place = f'x="{item.x:g}" y="{item.y:g}" font-size="{item.size:g}" text-anchor="{item.anchor}"'
    return f'<text {place} fill="{item.colour}"{weight}>{escape(item.text)}</text>'


def _points(points: Sequence[Point]) -> str:
    return " ".join(f"{x:g},{y:g}" for x, y in points)
