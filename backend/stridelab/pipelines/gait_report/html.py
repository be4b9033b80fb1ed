"""The report as one page of HTML without scripts and without addresses of other files."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from stridelab.pipelines.gait_report.content import ReportContent
from stridelab.pipelines.gait_report.drawing import Area, Drawing, Item, Line, Point, draw_panel, legend
from stridelab.translations.catalogue import gettext, in_language

TEMPLATE: Final = "report.html.j2"


def render_html(content: ReportContent) -> str:
    """The page; every text of ``content`` is escaped."""
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    environment.globals["_"] = gettext
    template = environment.from_string((Path(__file__).parent / TEMPLATE).read_text(encoding="utf-8"))
    with in_language(content.language):
        return template.render(
            report=content,
            drawings=[draw_svg(draw_panel(panel), panel.title) for panel in content.panels],
            keys=[(gettext(label), draw_svg(line, gettext(label))) for label, line in legend(content.panels)],
        )


def draw_svg(drawing: Drawing, title: str) -> Markup:
    """A drawing as an inline SVG element, one unit per millimetre."""
    items = Markup("").join(_draw_item(item) for item in drawing.items)
    box = f"0 0 {drawing.width:g} {drawing.height:g}"
    return Markup('<svg viewBox="{}" role="img" aria-label="{}">{}</svg>').format(box, title, items)


def _draw_item(item: Item) -> Markup:
    if isinstance(item, Area):
        area = Markup('<polygon points="{}" fill="{}" fill-opacity="{:g}"/>')
        return area.format(_points(item.points), item.colour, item.opacity)
    if isinstance(item, Line):
        dash = "none" if item.dash is None else f"{item.dash[0]:g} {item.dash[1]:g}"
        line = Markup('<polyline points="{}" fill="none" stroke="{}" stroke-width="{:g}" stroke-dasharray="{}"/>')
        return line.format(_points(item.points), item.colour, item.width, dash)
    text = Markup('<text x="{:g}" y="{:g}" font-size="{:g}" text-anchor="{}" fill="{}" font-weight="{}">{}</text>')
    return text.format(item.x, item.y, item.size, item.anchor, item.colour, 600 if item.bold else 400, item.text)


def _points(points: Sequence[Point]) -> str:
    return " ".join(f"{x:g},{y:g}" for x, y in points)
