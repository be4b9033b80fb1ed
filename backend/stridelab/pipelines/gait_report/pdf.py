"""The report as PDF, the same bytes for the same report: no date but those in its texts, fonts embedded."""

import io
from typing import Final

from reportlab.lib.colors import HexColor
from reportlab.lib.utils import ImageReader
from reportlab.pdfgen.canvas import Canvas

from stridelab.pipelines.gait_report.content import ReportContent
from stridelab.pipelines.gait_report.drawing import Area, Line, Text
from stridelab.pipelines.gait_report.paper import (
    BOLD_FONT,
    FONT,
    PAGE_HEIGHT,
    PAGE_WIDTH,
    PageItem,
    Picture,
    lay_out,
    register_fonts,
)

POINTS_PER_MM: Final = 72.0 / 25.4


def render_pdf(content: ReportContent) -> bytes:
    """The document, on pages of A4."""
    register_fonts()
    buffer = io.BytesIO()
    size = (PAGE_WIDTH * POINTS_PER_MM, PAGE_HEIGHT * POINTS_PER_MM)
    canvas = Canvas(buffer, pagesize=size, invariant=1, pageCompression=1, lang="en")
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
        canvas.setFont(BOLD_FONT if item.bold else FONT, item.size * POINTS_PER_MM)
        canvas.setFillColor(HexColor(item.colour))
        draw = {"start": canvas.drawString, "middle": canvas.drawCentredString, "end": canvas.drawRightString}
        draw[item.anchor](*_at(item.x, item.y), item.text)
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
