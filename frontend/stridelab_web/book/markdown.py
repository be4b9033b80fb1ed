"""Rendering of a page of the book: CommonMark with tables, formulas in TeX, and links inside the book."""

import re
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from posixpath import dirname, join, normpath
from typing import Final

from markdown_it import MarkdownIt
from markdown_it.token import Token

from stridelab_web.book.contents import page_file, page_title, picture_file
from stridelab_web.book.formulas import mathml

CODE_OR_FORMULA: Final = re.compile(
    r"(?P<code>^```.*?^```|`+[^`].*?`+)|\\\[(?P<block>.+?)\\\]|\\\((?P<inline>.+?)\\\)", re.DOTALL | re.MULTILINE
)
PLACE: Final = "\ue000{}\ue001"
"""Stands for a formula while Markdown is parsed, which would read its backslashes; private characters of Unicode."""
PLACED: Final = re.compile("\ue000(\\d+)\ue001")


@dataclass(frozen=True)
class BookPage:
    """A page as HTML, with its title and its headings of the second level as (id, text)."""

    title: str
    html: str
    headings: tuple[tuple[str, str], ...]


def read_page(name: str) -> BookPage | None:
    """The page ``name`` (its path without ``.md``); None if there is none."""
    path = page_file(name)
    return None if path is None else _render_file(name, path, path.stat().st_mtime_ns)


@lru_cache(maxsize=32)
def _render_file(name: str, path: Path, _changed_ns: int) -> BookPage:
    formulas: list[str] = []
    text = CODE_OR_FORMULA.sub(lambda found: _take_formula(found, formulas), path.read_text(encoding="utf-8"))
    parser = MarkdownIt("commonmark", {"html": False}).enable("table")
    tokens = parser.parse(text)
    headings = _mark_headings(tokens)
    for token in tokens:
        for child in token.children or ():
            _resolve_target(child, dirname(name))
    rendered = PLACED.sub(lambda place: formulas[int(place[1])], parser.renderer.render(tokens, parser.options, {}))
    rendered = rendered.replace("<pre>", '<pre class="scroll">')
    rendered = rendered.replace("<table>", '<div class="scroll"><table>').replace("</table>", "</table></div>")
    return BookPage(page_title(path), rendered, tuple(headings))


def _take_formula(found: re.Match[str], formulas: list[str]) -> str:
    if found["code"]:
        return found[0]
    is_block = found["block"] is not None
    made = mathml(found["block"] or found["inline"], block=is_block)
    formulas.append(f'<span class="formula scroll">{made}</span>' if is_block else made)
    return PLACE.format(len(formulas) - 1)


def _mark_headings(tokens: list[Token]) -> list[tuple[str, str]]:
    """Give every heading the id that mkdocs gives it; returns those of the second level."""
    headings, taken = [], set[str]()
    for opening, inline in pairwise(tokens):
        if opening.type != "heading_open":
            continue
        text = "".join(child.content for child in inline.children or () if child.type in ("text", "code_inline"))
        base = heading_id(text)
        name, k = base, 0
        while name in taken:
            k += 1
            name = f"{base}_{k}"
        taken.add(name)
        opening.attrSet("id", name)
        if opening.tag == "h2":
            headings.append((name, PLACED.sub("…", text)))
    return headings


def heading_id(text: str) -> str:
    """The id of a heading as Python-Markdown makes it."""
    plain = re.sub(r"[^\w\s-]", "", PLACED.sub("", text)).strip().lower()
    return re.sub(r"[-\s]+", "-", plain)


def _resolve_target(token: Token, folder: str) -> None:
    """Address of a link or a picture inside the book; a link to a page that is not here loses its target."""
    if token.type == "image":
        name = normpath(join(folder, str(token.attrGet("src"))))
        if picture_file(name.removeprefix("pictures/")) is not None:
            token.attrSet("src", f"/help/{name}")
        return
    if token.type != "link_open":
        return
    target = str(token.attrGet("href"))
    if re.match(r"[a-z]+:|#|/", target):
        return
    file, _, anchor = target.partition("#")
    name = normpath(join(folder, file)).removesuffix(".md")
    if page_file(name) is None:
        del token.attrs["href"]
    else:
        token.attrSet("href", f"/help/{name}{'#' if anchor else ''}{anchor}")
