"""Hooks of mkdocs while it builds the book: pages made of the program itself, links to the literature, formulas.

Nothing of it is kept in docs/: endpoints and models come of the interface's own description, the numeric packages of
their docstrings, the literature of models/references.bib.
"""

import re
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from posixpath import relpath

from formulas import in_page, in_title
from http_pages import endpoints_page, models_page
from literature import bibliography_page, entries
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from mkdocs.structure.toc import AnchorLink
from python_pages import PACKAGES, package_page

ROOT = Path(__file__).parents[2]
MADE: dict[str, Callable[[], str]] = {
    "reference/endpoints.md": endpoints_page,
    "reference/models.md": models_page,
    "reference/literature.md": lambda: bibliography_page(ROOT),
    **{f"reference/{name}.md": partial(package_page, ROOT, name) for name in PACKAGES},
}
WIDE = {"thesis-to-code.md"}


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """Add the pages that are made."""
    for name, make in MADE.items():
        files.append(File.generated(config, name, content=make()))
    return files


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Lead citation keys to the literature, and give wide tables the room of the table of contents."""
    if page.file.src_uri in WIDE:
        page.meta["hide"] = ["toc"]
    if page.file.src_uri in MADE:
        return markdown
    there = relpath("reference/literature.md", str(Path(page.file.src_uri).parent))
    known = "|".join(entries(ROOT))
    return re.sub(rf"(?<!\[)`({known})`", rf"[`\1`]({there}#\1)", markdown)


def on_page_content(html: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Show formulas, in the table of contents too."""

    def titled(links: Iterable[AnchorLink]) -> None:
        for link in links:
            link.title = in_title(link.title)
            titled(link.children)

    titled(page.toc)
    return in_page(html)
