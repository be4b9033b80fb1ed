"""Fonts of the PDF by the language of the report, and lines of text that fit a width."""

import re
from functools import cache
from typing import Final

from reportlab.pdfbase import pdfmetrics
from reportlab.pdfbase.cidfonts import UnicodeCIDFont
from reportlab.pdfbase.ttfonts import TTFont

from stridelab.translations.catalogue import current_language

LATIN: Final = ("Vera", "VeraBd")
"""Regular and bold; they come with reportlab."""
JAPANESE: Final = "HeiseiKakuGo-W5"
"""One of PDF's own Japanese fonts, which is not embedded: the program that opens the document draws it with one of the
system. It has no bold face: bold texts are drawn with an outline (``pdf.py``)."""
REPLACEMENT: Final = "?"
LAST_OF_PLANE: Final = 0xFFFF
_CJK: Final = "\u3000-\u30ff\u3400-\u9fff\uff00-\uffef"
_CLOSING: Final = "、。，．・：；）」』】〕ー々％ぁぃぅぇぉっゃゅょァィゥェォッャュョ"
"""Characters that do not begin a line."""
_OPENING: Final = "（「『【〔"
"""Characters that do not end a line."""
_PIECE: Final = re.compile(rf" ?[{_OPENING}]*(?:[{_CJK}]|[^ {_CJK}]+)[{_CLOSING}]*")
"""What is not divided: a word, or one Japanese character with its punctuation."""


@cache
def _register_latin() -> None:
    for name in LATIN:
        pdfmetrics.registerFont(TTFont(name, f"{name}.ttf"))


@cache
def _register_japanese() -> None:
    pdfmetrics.registerFont(UnicodeCIDFont(JAPANESE))


def font_name(*, bold: bool = False) -> str:
    """Name of the font of the current language; all but Japanese ones are embedded in the document."""
    if current_language() == "ja":
        _register_japanese()
        return JAPANESE
    _register_latin()
    return LATIN[bold]


def text_width_mm(text: str, size: float, *, bold: bool = False) -> float:
    """Width of a text."""
    return float(pdfmetrics.stringWidth(text, font_name(bold=bold), size))


def wrap_text(text: str, size: float, width: float, *, bold: bool = False) -> list[str]:
    """Lines of at most ``width``; words that are longer are divided."""
    lines: list[str] = []
    line = ""
    for piece in _PIECE.findall(" ".join(text.split())):
        longer = f"{line}{piece}".strip()
        if text_width_mm(longer, size, bold=bold) <= width:
            line = longer
            continue
        if line:
            lines.append(line)
        line = piece.strip()
        while text_width_mm(line, size, bold=bold) > width and len(line) > 1:
            fits = next(
                k for k in range(len(line) - 1, 0, -1) if k == 1 or text_width_mm(line[:k], size, bold=bold) <= width
            )
            lines.append(line[:fits])
            line = line[fits:]
    return [*lines, line] if line else lines


def replace_missing_glyphs(text: str) -> str:
    """``text`` with the characters that the font lacks replaced: in Japanese those beyond the basic plane."""
    if current_language() == "ja":
        return "".join(character if ord(character) <= LAST_OF_PLANE else REPLACEMENT for character in text)
    known = pdfmetrics.getFont(font_name()).face.charToGlyph
    return "".join(character if ord(character) in known else REPLACEMENT for character in text)
