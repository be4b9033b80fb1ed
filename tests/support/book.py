"""The pages of the book and the papers beside it: their code blocks, inline code, links and headings."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path

from markdown_it import MarkdownIt
from markdown_it.token import Token

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAPERS = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
PAGES = [*PAPERS, *sorted(DOCS.rglob("*.md"))]
READER = MarkdownIt("commonmark").enable("table")


@dataclass(frozen=True)
class Block:
    """A code block: ``language`` is empty where it is only indented; ``line`` is that of its text, from 1."""

    page: Path
    line: int
    language: str
    text: str

    @property
    def place(self) -> str:
        """How a failure names it."""
        return f"{self.page.relative_to(ROOT)}:{self.line}"


@cache
def tokens(page: Path) -> tuple[Token, ...]:
    """The page as CommonMark sees it."""
    return tuple(READER.parse(page.read_text(encoding="utf-8")))


def _all(page: Path) -> Iterator[Token]:
    for token in tokens(page):
        yield token
        yield from token.children or ()


def blocks(page: Path) -> list[Block]:
    """All code blocks, fenced or indented."""
    found = [t for t in tokens(page) if t.type in {"fence", "code_block"}]
    return [Block(page, (t.map or [0])[0] + (2 if t.type == "fence" else 1), t.info.strip(), t.content) for t in found]


def inline_code(page: Path) -> list[str]:
    """Everything between single backticks."""
    return [t.content for t in _all(page) if t.type == "code_inline"]


def links(page: Path) -> list[str]:
    """Targets of all links and pictures."""
    return [
        str(t.attrs["href" if t.type == "link_open" else "src"]) for t in _all(page) if t.type in {"link_open", "image"}
    ]


def slug(heading: str) -> str:
    """How mkdocs names the anchor of a heading."""
    kept = re.sub(r"[^\w\s-]", "", heading.lower()).strip()
    return re.sub(r"[-\s]+", "-", kept)


def anchors(page: Path) -> set[str]:
    """Anchors of a page's headings; the second of one name has ``_1``, as mkdocs has it."""
    found: set[str] = set()
    for opening, inside in pairwise(tokens(page)):
        if opening.type == "heading_open":
            name = slug("".join(t.content for t in inside.children or () if t.type in {"text", "code_inline"}))
            again = (f"{name}_{k}" for k in range(1, 100))
            found.add(name if name not in found else next(n for n in again if n not in found))
    return found
