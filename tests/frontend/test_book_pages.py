"""The book that the service serves: every page is rendered, and every link and picture inside it exists."""

import html
import re
from collections.abc import Callable
from pathlib import Path
from urllib.parse import urldefrag

import httpx
import pytest

from stridelab_web.book.contents import SECTION_PAGES, book_dir, chapters, page_file
from stridelab_web.book.markdown import heading_id, read_page
from stridelab_web.pages.render import NAVIGATION
from support.fakes.service import FakeService

Browse = Callable[[str], httpx.Response]
PAGES = [href.removeprefix("/help/") for chapter in chapters() for href, _ in chapter.pages]
IDS = {name: set(re.findall(r'<h\d id="([^"]+)"', page.html)) for name in PAGES if (page := read_page(name))}


def test_every_page_of_the_book_has_a_place_in_the_contents() -> None:
    files = {path.relative_to(book_dir()).with_suffix("").as_posix() for path in Path(book_dir()).rglob("*.md")}
    assert set(PAGES) == files


def test_every_link_and_picture_exists() -> None:
    missing = []
    for name in PAGES:
        page = read_page(name)
        assert page is not None
        for target in re.findall(r'(?:href|src)="([^"]+)"', page.html):
            address, anchor = urldefrag(html.unescape(target))
            if re.match("https?:", address):
                continue
            inside = address.removeprefix("/help/") if address else name
            if inside.startswith("pictures/"):
                result = (book_dir() / inside).is_file()
            else:
                result = inside in IDS and (not anchor or anchor in IDS[inside])
            if not result:
                missing.append((name, target))
    assert missing == []


def test_formulas_are_mathml_and_code_stays_code() -> None:
    for name in PAGES:
        page = read_page(name)
        assert page is not None
        outside = re.sub(r"<(pre|code)\b.*?</\1>", "", page.html, flags=re.DOTALL)
        assert "\\(" not in outside
        assert "\\[" not in outside
        assert not re.search("[\ue000\ue001]", page.html)
    smoother, path = read_page("theory/smoother"), page_file("theory/smoother")
    assert smoother is not None
    assert path is not None
    assert smoother.html.count("<math") == len(re.findall(r"\\[(\[]", path.read_text(encoding="utf-8"))) > 0


def test_headings_have_the_ids_of_the_book_elsewhere() -> None:
    assert heading_id("What is measured, in metres") == "what-is-measured-in-metres"
    assert heading_id("`GET /jobs` and the rest") == "get-jobs-and-the-rest"


@pytest.mark.parametrize("name", ["../pyproject", "nothing", "pictures/../../README"])
def test_nothing_outside_of_the_book_is_served(fake: FakeService, browse: Browse, name: str) -> None:
    assert page_file(name) is None
    assert browse(f"/help/{name}").status_code == 404


def test_every_section_leads_to_its_page(fake: FakeService, browse: Browse) -> None:
    assert {name for name, _ in NAVIGATION} <= set(SECTION_PAGES)
    for page in SECTION_PAGES.values():
        assert page in PAGES
    assert 'href="/help/tutorials/human-wing"' in browse("/recordings").text
    assert 'href="/help/contact-sequences"' in browse("/scenarios/new").text
    assert 'href="/help/player"' in browse(f"/view/?plan={fake.add_plan().id}").text
    shown = browse("/help/contact-sequences")
    assert "<h1" in shown.text
    assert browse("/help").status_code in (200, 307)
    assert browse("/help/pictures/editor.png").headers["content-type"] == "image/png"
