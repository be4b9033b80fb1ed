"""Layout of the report on pages of A4: texts, lines and pictures in millimetres from the upper left corner."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from stridelab.pipelines.gait_report.content import Cell, ReportContent, Row, Tile
from stridelab.pipelines.gait_report.drawing import (
    GRID,
    INK,
    PALE,
    Area,
    Drawing,
    Item,
    Line,
    Point,
    Text,
    draw_panel,
    legend,
)
from stridelab.pipelines.gait_report.fonts import REPLACEMENT, replace_missing_glyphs, text_width_mm, wrap_text
from stridelab.translations.catalogue import gettext

PAGE_WIDTH: Final = 210.0
PAGE_HEIGHT: Final = 297.0
LEFT_EDGE: Final = 14.0
TOP_EDGE: Final = 13.0
RIGHT_EDGE: Final = PAGE_WIDTH - LEFT_EDGE
BOTTOM_EDGE: Final = PAGE_HEIGHT - 15.0
WIDTH: Final = RIGHT_EDGE - LEFT_EDGE
SIZE: Final = 2.4
SMALL: Final = 2.0
LEADING: Final = 1.32
"""Distance of base lines per size."""
LOGO_BOX: Final = (45.0, 14.0)
VERDICT_COLOURS: Final = {"good": "#0b6b3a", "doubtful": "#8a5a00", "contradicted": "#b3261e"}
DOUBT: Final = VERDICT_COLOURS["doubtful"]


@dataclass(frozen=True)
class Picture:
    """A PNG with its upper left corner at (``x``, ``y``)."""

    x: float
    y: float
    width: float
    height: float
    content: bytes


PageItem = Item | Picture
Page = list[PageItem]


@dataclass(frozen=True)
class Column:
    """A column of a table: heading and width; numbers are aligned to the right."""

    heading: str
    width: float
    numeric: bool = True


Lines = Sequence[tuple[str, float, str]]
"""Lines of a table cell: text, size and colour."""


@dataclass
class _Layout:
    """Pages with a position ``y`` from which the next block goes down."""

    pages: list[Page] = field(default_factory=lambda: [[]])
    y: float = TOP_EDGE
    has_lost: bool = False

    def require(self, height: float) -> bool:
        """Start a new page unless ``height`` fits on this one; whether it did."""
        if self.y + height <= BOTTOM_EDGE:
            return False
        self.pages.append([])
        self.y = TOP_EDGE
        return True

    def put(self, *items: PageItem) -> None:
        """Add items to this page."""
        for item in items:
            if isinstance(item, Text):
                text = replace_missing_glyphs(item.text)
                self.has_lost |= text != item.text
                item = replace(item, text=text)
            self.pages[-1].append(item)

    def draw(self, drawing: Drawing, x: float, y: float) -> None:
        """Add a drawing with its upper left corner at (x, y)."""
        for item in drawing.items:
            if isinstance(item, Text):
                self.put(replace(item, x=item.x + x, y=item.y + y))
            else:
                self.put(replace(item, points=[(px + x, py + y) for px, py in item.points]))

    def paragraph(self, text: str, *, size: float = SIZE, colour: str = INK, indent: float = 0.0) -> None:
        """Add a wrapped text."""
        for line in wrap_text(text, size, WIDTH - indent):
            self.require(size * LEADING)
            self.put(Text(LEFT_EDGE + indent, self.y + size, line, size, colour=colour))
            self.y += size * LEADING
        self.y += 0.5

    def heading(self, text: str, below: float) -> None:
        """Add a heading that stays with the ``below`` millimetres after it."""
        self.y += 2.6
        self.require(5.5 + below)
        self.put(Text(LEFT_EDGE, self.y + 3.0, text, 3.0, bold=True))
        self.y += 5.0

    def table(self, columns: Sequence[Column], rows: Sequence[Sequence[Lines]]) -> None:
        """Add a table whose rows are not divided and whose headings are repeated on every page."""
        self._table_row(columns, [[(one.heading, SMALL, PALE)] for one in columns], INK)
        for row in rows:
            height = max(_cell_height(lines, one.width) for lines, one in zip(row, columns, strict=True))
            if self.require(height + 1.0):
                self._table_row(columns, [[(one.heading, SMALL, PALE)] for one in columns], INK)
            self._table_row(columns, row, GRID)
        self.y += 1.0

    def _table_row(self, columns: Sequence[Column], row: Sequence[Lines], colour: str) -> None:
        x, bottom = LEFT_EDGE, self.y
        for lines, column in zip(row, columns, strict=True):
            y = self.y + 0.5
            for text, size, ink in lines:
                for line in wrap_text(text, size, column.width - 1.5):
                    y += size * LEADING
                    edge = x + column.width - 0.5 if column.numeric else x
                    self.put(Text(edge, y - 0.3 * size, line, size, "end" if column.numeric else "start", ink))
            bottom, x = max(bottom, y), x + column.width
        self.y = bottom + 0.6
        self.put(Line([(LEFT_EDGE, self.y), (x, self.y)], colour, 0.12))


def _cell_height(lines: Lines, width: float) -> float:
    return 1.1 + sum(len(wrap_text(text, size, width - 1.5)) * size * LEADING for text, size, _ in lines)


def lay_out(content: ReportContent) -> list[Page]:
    """The pages of the report, each with its number."""
    layout = _Layout()
    _header(layout, content)
    _tiles(layout, content.tiles)
    _panels(layout, content)
    _measures(layout, content)
    _changes(layout, content)
    for title, pairs in (
        (gettext("Not measured"), content.missing),
        (gettext("Recordings left out"), content.left_out),
    ):
        if pairs:
            layout.heading(title, 4.0)
            for what, reason in pairs:
                layout.paragraph(f"{what}: {reason}")
    if content.remarks:
        layout.heading(gettext("Remarks"), 4.0)
        for text in content.remarks:
            layout.paragraph(text)
    _recordings(layout, content)
    layout.heading(gettext("Settings"), 4.0)
    layout.paragraph(" · ".join(f"{name}: {text}" for name, text in content.settings))
    layout.heading(gettext("References"), 4.0)
    for text in content.references:
        layout.paragraph(text, size=SMALL)
    if layout.has_lost:
        lost = gettext(
            "Characters that the font of this document lacks are written as %(replacement)s; the HTML report has them.",
            replacement=REPLACEMENT,
        )
        layout.paragraph(lost, size=SMALL, colour=PALE)
    for number, page in enumerate(layout.pages, start=1):
        foot = PAGE_HEIGHT - 9.0
        foot_text = gettext("Page %(page)s of %(pages)s", page=number, pages=len(layout.pages))
        page.append(Text(LEFT_EDGE, foot, f"{content.version} · {content.created_on}", SMALL, colour=PALE))
        page.append(Text(RIGHT_EDGE, foot, foot_text, SMALL, "end", PALE))
    return layout.pages


def _header(layout: _Layout, content: ReportContent) -> None:
    room = WIDTH
    if content.logo is not None and content.logo.size is not None:
        wide, high = content.logo.size
        scale = min(LOGO_BOX[0] / wide, LOGO_BOX[1] / high)
        width, height = scale * wide, scale * high
        layout.put(Picture(RIGHT_EDGE - width, layout.y, width, height, content.logo.content))
        room -= width + 5.0
    bottom = layout.y + (LOGO_BOX[1] + 1.5 if room < WIDTH else 0.0)
    for line in wrap_text(content.title, 5.0, room, bold=True):
        layout.put(Text(LEFT_EDGE, layout.y + 4.5, line, 5.0, bold=True))
        layout.y += 6.2
    dated = gettext("Report of %(date)s", date=content.created_on)
    for line in wrap_text(f"{content.lab_name} · {dated}" if content.lab_name else dated, SIZE, room):
        layout.put(Text(LEFT_EDGE, layout.y + SIZE, line, SIZE, colour=PALE))
        layout.y += SIZE * LEADING
    layout.y = max(layout.y + 1.5, bottom)
    layout.put(Line([(LEFT_EDGE, layout.y), (RIGHT_EDGE, layout.y)], INK, 0.4))
    layout.y += 1.5
    layout.paragraph(" · ".join(f"{name}: {text}" for name, text in content.facts))
    top = layout.y
    verdict = gettext("Quality: %(verdict)s.", verdict=gettext(content.verdict))
    layout.paragraph(f"{verdict} {content.verdict_note}", indent=3.0)
    for text in content.cautions:
        layout.paragraph(text, indent=3.0)
    layout.put(Area(_rectangle(LEFT_EDGE, top, 1.0, layout.y - top), VERDICT_COLOURS.get(content.verdict, PALE)))
    layout.y += 1.0


def _rectangle(x: float, y: float, width: float, height: float) -> list[Point]:
    return [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]


def _tiles(layout: _Layout, tiles: Sequence[Tile]) -> None:
    """Four tiles a row."""
    gap = 2.0
    width = (WIDTH - 3 * gap) / 4
    for start in range(0, len(tiles), 4):
        chosen = [_tile_lines(tile, width - 4.0) for tile in tiles[start : start + 4]]
        height = 3.0 + max(sum(text.size * LEADING for text in lines) for lines in chosen)
        layout.require(height)
        for index, lines in enumerate(chosen):
            x, y = LEFT_EDGE + index * (width + gap), layout.y
            corners = _rectangle(x, y, width, height)
            layout.put(Line([*corners, corners[0]], GRID, 0.2))
            y += 1.2
            for line in lines:
                y += line.size * LEADING
                layout.put(replace(line, x=x + 2.0, y=y - 0.2 * line.size))
        layout.y += height + gap


def _tile_lines(tile: Tile, width: float) -> list[Text]:
    lines = [(tile.title, SIZE, PALE, False)]
    if tile.value:
        lines.append((tile.value, 4.2, INK, True))
        lines += [(text, SMALL, PALE, False) for text in (tile.interval, tile.sides, tile.symmetry) if text]
    else:
        lines += [(gettext("not measured"), 3.0, DOUBT, False), (tile.reason, SMALL, PALE, False)]
    return [
        Text(0.0, 0.0, line, size, colour=colour, bold=bold)
        for text, size, colour, bold in lines
        for line in wrap_text(text, size, width, bold=bold)
    ]


def _panels(layout: _Layout, content: ReportContent) -> None:
    """Two charts a row, then their key."""
    drawings = [draw_panel(panel) for panel in content.panels]
    keys = legend(content.panels)
    if keys:
        layout.heading(gettext("Gait cycle"), drawings[0].height)
        for start in range(0, len(drawings), 2):
            layout.require(drawings[start].height + 2.0)
            for drawing, x in zip(
                drawings[start : start + 2], (LEFT_EDGE, RIGHT_EDGE - drawings[0].width), strict=False
            ):
                layout.draw(drawing, x, layout.y)
            layout.y += drawings[start].height + 2.0
        layout.require(4.0)
        x = LEFT_EDGE
        for label, line in keys:
            layout.draw(line, x, layout.y + 0.4)
            name = gettext(label)
            layout.put(Text(x + line.width + 1.5, layout.y + 2.2, name, SIZE))
            x += line.width + 6.0 + text_width_mm(name, SIZE)
        layout.y += 4.0
    layout.paragraph(content.panel_note, size=SMALL, colour=PALE)


def _measures(layout: _Layout, content: ReportContent) -> None:
    layout.heading(gettext("Measures"), 20.0)
    wide = [30.0, 30.0, 30.0, 17.0]
    columns = [Column(gettext("Measure"), 61.0, numeric=False), Column(gettext("Unit"), 14.0, numeric=False)]
    if content.is_compared:
        wide = [22.5, 22.5, 22.5, 14.0]
        columns = [Column(gettext("Measure"), 35.0, numeric=False), Column(gettext("Unit"), 9.5, numeric=False)]
    sides = gettext("Left"), gettext("Right"), gettext("Both"), gettext("Symmetry")
    columns += [Column(name, w) for name, w in zip(sides, wide, strict=True)]
    if content.is_compared:
        columns += [Column(gettext("Reference"), 19.0), Column(gettext("Difference"), 21.0), Column("z", 15.5)]
    layout.table(columns, [_measure_cells(row, compared=content.is_compared) for row in content.rows])
    layout.paragraph(f"{content.table_note} {content.reference_note}".strip(), size=SMALL, colour=PALE)


def _measure_cells(row: Row, *, compared: bool) -> list[Lines]:
    cells: list[Lines] = [_plain(row.title), _plain(row.unit)]
    cells += [_value_cell(cell) for cell in (row.left, row.right, row.both)]
    cells.append(_plain(row.symmetry or "–"))
    if compared:
        cells += [
            _value_cell(row.reference),
            [*_plain(row.difference or "–"), (row.difference_interval, SMALL, PALE)],
            [*_plain(row.z or "–"), (row.z_interval, SMALL, PALE)],
        ]
    return cells


def _value_cell(cell: Cell | None) -> Lines:
    if cell is None:
        return _plain("–")
    mean = f"{cell.mean} ± {cell.sd}" if cell.sd else cell.mean
    below = f"{cell.interval}, n {cell.n}" if cell.interval else f"n {cell.n}"
    return [(mean, SIZE, INK), (below, SMALL, PALE)]


def _plain(text: str) -> Lines:
    return [(text, SIZE, INK)]


def _changes(layout: _Layout, content: ReportContent) -> None:
    if not content.changes:
        return
    layout.heading(gettext("Before and after"), 20.0)
    columns = [Column(gettext("Measure"), 66.0, numeric=False), Column(gettext("Unit"), 14.0, numeric=False)]
    titles = gettext("Before"), gettext("After"), gettext("Change")
    columns += [Column(name, 25.0) for name in titles] + [Column("95 %", 27.0)]
    rows = [
        [_plain(text) for text in (one.title, one.unit, one.before, one.after, one.change, one.interval or "–")]
        for one in content.changes
    ]
    layout.table(columns, rows)
    layout.paragraph(content.change_note, size=SMALL, colour=PALE)


def _recordings(layout: _Layout, content: ReportContent) -> None:
    layout.heading(gettext("Recordings"), 12.0)
    columns = [
        Column(gettext("File"), 58.0, numeric=False),
        Column(gettext("Recorded"), 22.0, numeric=False),
        Column(gettext("Steps"), 29.0, numeric=False),
        Column(gettext("Speed"), 18.0, numeric=False),
        Column(gettext("Estimator"), 22.0, numeric=False),
        Column(gettext("Quality"), 33.0, numeric=False),
    ]
    rows = []
    for one in content.trials:
        cells = [_plain(text) for text in (one.filename, one.recorded_on, one.steps, one.speed, one.method)]
        quality = [(one.verdict, SIZE, INK)] + ([(one.note, SMALL, PALE)] if one.note else [])
        rows.append([*cells, quality])
    layout.table(columns, rows)
