"""The book inside the installation: its folder, its table of contents, and the page of each section of the service."""

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

INDEX: Final = "index"
SECTION_PAGES: Final = {
    "Home": "index",
    "Recordings": "tutorials/human-wing",
    "Subjects": "theory/sessions",
    "Population": "theory/population",
    "Live": "how-to/stream-markers",
    "Scenarios": "contact-sequences",
    "Sweeps": "tutorials/robot-wing",
    "Robots": "theory/reachability",
    "Jobs": "pages",
    "Reproduction": "reproduction",
    "Settings": "settings",
    "Viewer": "player",
    "Login": "operations",
}
"""Page of the book for the pages of a section of the service; other pages lead to ``pages``."""
_ENTRY = re.compile(r"^(?P<indent> +)- (?:(?P<section>[^:]+):|(?P<page>\S+)\.md)\s*$")


@dataclass(frozen=True)
class Chapter:
    """A chapter of the book with its pages, each as (address, title)."""

    title: str
    pages: tuple[tuple[str, str], ...]


@cache
def book_dir() -> Path:
    """Folder of the Markdown files: inside the installed package, or that of the checkout."""
    package = Path(__file__).resolve().parents[1]
    for candidate in (package / "docs", package.parents[1] / "docs"):
        if (candidate / "index.md").is_file():
            return candidate
    raise FileNotFoundError(f"no book beside {package}; the installation is incomplete")


def section_page(section: str) -> str:
    """Address of the page of the book about a section of the service."""
    return f"/help/{SECTION_PAGES.get(section, 'pages')}"


def page_file(name: str) -> Path | None:
    """File of a page by its name without ``.md``; None if there is none."""
    return _files_of_book().get(f"{name}.md")


def picture_file(name: str) -> Path | None:
    """A picture of the book; None if there is none."""
    return _files_of_book().get(f"pictures/{name}")


@cache
def _files_of_book() -> dict[str, Path]:
    """Pages and pictures by their paths: an address is looked up, never joined to a folder."""
    folder = book_dir()
    found = [*folder.rglob("*.md"), *(folder / "pictures").iterdir()]
    return {path.relative_to(folder).as_posix(): path for path in found}


@cache
def chapters() -> tuple[Chapter, ...]:
    """The table of contents of ``mkdocs.yml``, without the pages that are made while the book is built elsewhere."""
    inside, beside = book_dir() / "mkdocs.yml", book_dir().parent / "mkdocs.yml"
    text = (inside if inside.is_file() else beside).read_text(encoding="utf-8")
    found: list[Chapter] = []
    for line in text.partition("\nnav:\n")[2].splitlines():
        entry = _ENTRY.match(line)
        if entry is None:
            continue
        if entry["section"]:
            if len(entry["indent"]) == 2:
                found.append(Chapter(entry["section"], ()))
        elif (path := page_file(entry["page"])) is not None:
            page = (f"/help/{entry['page']}", page_title(path))
            found[-1] = Chapter(found[-1].title, (*found[-1].pages, page))
    return tuple(found)


def page_title(path: Path) -> str:
    """Heading of a page."""
    with path.open(encoding="utf-8") as file:
        return file.readline().lstrip("# ").strip()
