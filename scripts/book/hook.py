"""What mkdocs asks while it builds the book: pages that are made of the program itself, and links to the literature.

Nothing of it is kept in docs/: endpoints and models come of the interface's own description, the numeric packages of
their docstrings, the literature of models/references.bib.
"""

import re
from collections.abc import Callable
from pathlib import Path
from posixpath import relpath

from http_pages import endpoints_page, models_page
from literature import bibliography_page, entries
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from python_pages import PACKAGES, package_page

ROOT = Path(__file__).parents[2]
MADE: dict[str, Callable[[], str]] = {
    "reference/endpoints.md": endpoints_page,
    "reference/models.md": models_page,
    "reference/literature.md": lambda: bibliography_page(ROOT),
    **{f"reference/{name}.md": lambda name=name: package_page(ROOT, name) for name in PACKAGES},
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
