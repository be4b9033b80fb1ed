"""The report as PDF, the same bytes for the same report: no date but those in its texts, Latin fonts embedded."""

import io
from typing import Final

from reportlab.lib.colors import HexColor
from reportlab.lib.utils import ImageReader
from reportlab.pdfgen.canvas import Canvas

from stridelab.pipelines.gait_report.content import ReportContent
from stridelab.pipelines.gait_report.drawing import Area, Line, Text
from stridelab.pipelines.gait_report.fonts import JAPANESE, font_name
from stridelab.pipelines.gait_report.paper import (
    PAGE_HEIGHT,
    PAGE_WIDTH,
    PageItem,
    Picture,
    lay_out,
)
from stridelab.translations.catalogue import in_language

POINTS_PER_MM: Final = 72.0 / 25.4
OUTLINE: Final = 0.03
"""Width of the outline of a bold text in a font without a bold face, per size of the text."""
FILLED_AND_OUTLINED: Final = 2


def render_pdf(content: ReportContent) -> bytes:
    """The document, on pages of A4."""
    with in_language(content.language):
        return _render_pages(content)


def _render_pages(content: ReportContent) -> bytes:
    buffer = io.BytesIO()
    size = (PAGE_WIDTH * POINTS_PER_MM, PAGE_HEIGHT * POINTS_PER_MM)
    canvas = Canvas(buffer, pagesize=size, invariant=1, pageCompression=1, lang=content.language)
    canvas.setTitle(content.title)
    canvas.setAuthor(content.lab_name)
    canvas.setCreator(content.version)
    for page in lay_out(content):
        canvas.setLineCap(0)
        canvas.setLineJoin(1)
        for item in page:
            _draw_item(canvas, item)
        canvas.showPage()
    canvas.save()
    return buffer.getvalue()


def _draw_item(canvas: Canvas, item: PageItem) -> None:
    if isinstance(item, Picture):
        x, y = _at(item.x, item.y + item.height)
        image = ImageReader(io.BytesIO(item.content))
        canvas.drawImage(image, x, y, item.width * POINTS_PER_MM, item.height * POINTS_PER_MM, mask="auto")
    elif isinstance(item, Text):
        name = font_name(bold=item.bold)
        canvas.setFont(name, item.size * POINTS_PER_MM)
        canvas.setFillColor(HexColor(item.colour))
        draw = {"start": canvas.drawString, "middle": canvas.drawCentredString, "end": canvas.drawRightString}
        outlined = item.bold and name == JAPANESE
        if outlined:
            canvas.setStrokeColor(HexColor(item.colour))
            canvas.setDash([])
            canvas.setLineWidth(OUTLINE * item.size * POINTS_PER_MM)
        draw[item.anchor](*_at(item.x, item.y), item.text, mode=FILLED_AND_OUTLINED if outlined else None)
    else:
        _draw_path(canvas, item)


def _draw_path(canvas: Canvas, item: Line | Area) -> None:
    path = canvas.beginPath()
    path.moveTo(*_at(*item.points[0]))
    for point in item.points[1:]:
        path.lineTo(*_at(*point))
    if isinstance(item, Area):
        path.close()
        canvas.setFillColor(HexColor(item.colour))
        canvas.setFillAlpha(item.opacity)
        canvas.drawPath(path, stroke=0, fill=1)
        canvas.setFillAlpha(1.0)
        return
    canvas.setStrokeColor(HexColor(item.colour))
    canvas.setLineWidth(item.width * POINTS_PER_MM)
    canvas.setDash([] if item.dash is None else [length * POINTS_PER_MM for length in item.dash])
    canvas.drawPath(path, stroke=1, fill=0)


def _at(x: float, y: float) -> tuple[float, float]:
    """Points from the lower left corner."""
    return x * POINTS_PER_MM, (PAGE_HEIGHT - y) * POINTS_PER_MM
