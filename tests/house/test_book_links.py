"""Every link of the book and of the papers beside it leads somewhere, and what they name in this tree exists."""

import re
from pathlib import Path
from urllib.parse import unquote

from support.docs.book import DOCS, PAGES, PAPERS, ROOT, anchors, each_of, inline_code, links

BACKEND = ROOT / "backend" / "stridelab"
PACKAGES = {p.name for p in BACKEND.iterdir() if (p / "__init__.py").is_file()}
WRITTEN = (".parquet", ".csv", ".json", ".log", ".html")
"""Files that a run leaves and no tree holds."""
INVENTED = r"myrobot/|\b[A-Z]{2,}\.\w+$"
"""The reader's own robot, and a name in capitals, which stands for any."""
NAMED = re.compile(r"((?:tests|scripts|models|docs|deploy)/[\w/.-]+\.\w+|scripts/[\w-]+)(?:::(\w+))?")


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


def broken(page: Path) -> list[str]:
    """Links that lead to no file, no heading, or out of the book."""
    wrong = []
    for link in links(page):
        if re.match(r"(https?|mailto):", link):
            continue
        target, _, anchor = unquote(link).partition("#")
        path = (page.parent / target).resolve() if target else page
        inside = path == page or path.is_relative_to(DOCS) or page in PAPERS
        if not (path.exists() and inside) or (anchor and anchor not in anchors(path)):
            wrong.append(link)
    return wrong


@each_of(PAGES)
def test_links_lead_to_a_file_and_a_heading(page: Path) -> None:
    assert broken(page) == []


def test_a_broken_link_is_detected(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# One\n\n# One\n\n[a](#one_1) [b](#two) [c](none.md)\n\n![d](none.png)\n\n`[e](none.md)`\n")
    assert broken(page) == ["#two", "none.md", "none.png"]


@each_of(PAGES)
def test_files_and_tests_that_a_page_names_exist(page: Path) -> None:
    for code in inline_code(page):
        if (named := NAMED.fullmatch(code)) and not re.search(INVENTED, code):
            path = ROOT / named[1]
            assert path.is_file(), code
            assert named[2] is None or f"def {named[2]}(" in path.read_text(encoding="utf-8"), code


@each_of(PAGES)
def test_modules_and_functions_that_a_page_names_exist(page: Path) -> None:
    """``dynamics.wrench.zmp_of_motion``: a module below backend/stridelab, and a name that it defines."""
    for code in inline_code(page):
        if re.fullmatch(r"(?:stridelab\.)?[a-z_]+(?:\.\w+)+(?:\(\))?", code) and not code.endswith(WRITTEN):
            first, *rest = code.removeprefix("stridelab.").removesuffix("()").split(".")
            if first in PACKAGES and not (BACKEND / first / ".".join(rest)).is_file():
                assert defined(BACKEND / first, rest), code


def defined(folder: Path, names: list[str]) -> bool:
    """Whether a dotted name is a package, a module, or something that is defined in one."""
    if not names:
        return folder.is_dir()
    if (folder / names[0]).is_dir():
        return defined(folder / names[0], names[1:])
    module = folder / f"{names[0]}.py"
    text = (module if module.is_file() else folder / "__init__.py").read_text(encoding="utf-8")
    needed = names[1:] if module.is_file() else names
    return all(
        re.search(rf"^\s*(?:(?:async )?def|class) {n}\b|^\s*{n}(?::[^=]*)? ?=|^\s*{n}:", text, re.M) for n in needed
    )
