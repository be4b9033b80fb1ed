"""Makes models/fonts/japanese.ttf.xz, the font of Japanese reports: a part of Noto Sans JP (SIL Open Font Licence 1.1).

    python scripts/make_japanese_font.py NotoSansJP-Regular.otf

Needs fonttools, which stridelab does not. The font has JIS X 0208 level 1, its symbols, the characters of the
translations, and Latin and Greek letters. Its outlines become quadratic, because reportlab embeds TrueType alone.
"""

import io
import lzma
import sys
from pathlib import Path

from fontTools.pens.cu2quPen import Cu2QuPen
from fontTools.pens.ttGlyphPen import TTGlyphPen
from fontTools.subset import Options, Subsetter
from fontTools.ttLib import TTFont, newTable

FONT = Path(__file__).resolve().parents[1] / "models/fonts/japanese.ttf.xz"
TRANSLATIONS = Path(__file__).resolve().parents[1] / "backend/stridelab/translations/ja.po"
ROWS = (*range(1, 9), *range(16, 48))
"""Symbols, letters and kana of JIS X 0208, and the kanji of its level 1."""
FURTHER = "～−–—―‘’“”„‚‹›«»…·±²³×÷≤≥≈°µ‰"
ERROR_UNITS = 2.0
"""Largest distance of the outlines, of 1000 units per em."""
NAMES = [0, 1, 2, 3, 4, 5, 6, 13, 14]
"""Copyright, names, version and licence stay in the font."""


def wanted_characters() -> str:
    """The characters of the font."""
    wanted = set(TRANSLATIONS.read_text(encoding="utf-8")) - {"\n"}
    wanted |= {chr(code) for code in (*range(0x20, 0x250), *range(0x370, 0x3D0))} | set(FURTHER)
    for row in ROWS:
        pairs = (bytes([0xA0 + row, 0xA0 + cell]) for cell in range(1, 95))
        wanted.update(pair.decode("euc_jp", errors="ignore") for pair in pairs)
    return "".join(sorted(wanted - {""}))


def convert_outlines(font: TTFont) -> None:
    """Replace cubic outlines (CFF) by quadratic ones (glyf)."""
    order, glyphs = font.getGlyphOrder(), font.getGlyphSet()
    drawn = {}
    for name in order:
        pen = TTGlyphPen(glyphs)
        glyphs[name].draw(Cu2QuPen(pen, ERROR_UNITS, reverse_direction=True))
        drawn[name] = pen.glyph()
    font["loca"], font["glyf"] = newTable("loca"), newTable("glyf")
    font["glyf"].glyphOrder, font["glyf"].glyphs = order, drawn
    del font["CFF "]
    limits = font["maxp"]
    limits.tableVersion, limits.maxZones = 0x00010000, 1
    for field in ("TwilightPoints", "Storage", "FunctionDefs", "InstructionDefs", "StackElements"):
        setattr(limits, f"max{field}", 0)
    limits.maxSizeOfInstructions = limits.maxComponentElements = limits.maxComponentDepth = 0
    font["post"].formatType = 3.0
    font.sfntVersion = "\000\001\000\000"


def main() -> None:
    """Write the font."""
    font = TTFont(sys.argv[1], recalcTimestamp=False)
    dropped = ["GSUB", "GPOS", "GDEF", "BASE", "VORG", "vhea", "vmtx", "DSIG"]
    chosen = Subsetter(Options(layout_features=[], hinting=False, name_IDs=NAMES, notdef_outline=True))
    chosen.options.drop_tables += dropped
    chosen.populate(text=wanted_characters())
    chosen.subset(font)
    convert_outlines(font)
    written = io.BytesIO()
    font.save(written)
    FONT.write_bytes(lzma.compress(written.getvalue(), preset=9 | lzma.PRESET_EXTREME))


if __name__ == "__main__":
    main()
