"""The book's table of contents is whole, and the pages that are made of the program say all of it."""

import ast
import importlib
import inspect
import re
import sys
import unicodedata
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from stridelab.service.kinds.provenance import known_references
from support.docs.book import DOCS, PAGES, ROOT, each_of, inline_code
from support.docs.shown_calls import description

PROSE_WIDTH = 130
BOOK = ROOT / "scripts" / "book"
sys.path.insert(0, str(BOOK))  # where mkdocs looks for what the hook imports
import formulas  # noqa: E402
import hook  # noqa: E402
import http_pages  # noqa: E402
import literature  # noqa: E402
import python_pages  # noqa: E402

sys.path.remove(str(BOOK))


def entries(nav: object) -> Iterator[str]:
    """Files of a table of contents, however deep."""
    if isinstance(nav, str):
        yield nav
    elif isinstance(nav, dict | list):
        for inner in nav.values() if isinstance(nav, dict) else nav:
            yield from entries(inner)


def test_every_page_is_in_the_table_of_contents_once() -> None:
    """mkdocs warns of it too; this is what says so without building the book."""
    listed = sorted(entries(yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"]))
    pages = [str(path.relative_to(DOCS)) for path in DOCS.rglob("*.md")]
    assert listed == sorted([*pages, *hook.MADE])


def test_warnings_are_fatal() -> None:
    """Under ``--quiet`` mkdocs counts none, strict or not."""
    script = (ROOT / "scripts" / "docs").read_text(encoding="utf-8")
    assert re.search(r"mkdocs build --strict$", script, re.MULTILINE)
    assert "scripts/docs" in (ROOT / "scripts" / "check").read_text(encoding="utf-8")


def test_every_endpoint_is_there_with_its_parameters_and_answers() -> None:
    sections = re.split(r"^### ", http_pages.endpoints_page(), flags=re.MULTILINE)
    by_name = {section.partition("\n")[0]: section for section in sections}
    for path, methods in description()["paths"].items():
        for method, operation in methods.items():
            entry = by_name[f"{method.upper()} {path}"]
            assert all(f"| `{p['name']}` | {p['in']} |" in entry for p in operation.get("parameters", []))
            assert all(f"| {status} |" in entry for status in operation["responses"])
            codes = set(
                re.findall(r"`[a-z]+(?:-[a-z]+)+`", str([r["description"] for r in operation["responses"].values()]))
            )
            assert all(code in entry for code in codes)


def test_every_model_is_there_with_its_fields() -> None:
    sections = re.split(r"^## ", http_pages.models_page(), flags=re.MULTILINE)
    by_name = {section.partition("\n")[0]: section for section in sections}
    for name, schema in description()["components"]["schemas"].items():
        entry = by_name[http_pages.shown(name)]
        assert all(f"| `{field}` |" in entry for field in schema.get("properties", {})), name


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("height_m", "m"),
        ("velocity_m_s", "m/s"),
        ("omega_rad_s", "rad/s"),
        ("moment_nm", "N m"),
        ("items", ""),
        ("s", ""),
    ],
)
def test_units_are_read_from_names(name: str, unit: str) -> None:
    assert http_pages.unit(name) == unit


@pytest.mark.parametrize("package", sorted(python_pages.PACKAGES))
def test_the_page_of_a_package_documents_exactly_what_it_exports(package: str) -> None:
    page = python_pages.package_page(ROOT, package)
    module = importlib.import_module("stridelab" if package == "library" else f"stridelab.{package}")
    headings = re.findall(r"^## (\w+)$", page, re.M)
    assert sorted(headings) == sorted(module.__all__)
    for name in module.__all__:
        exported = getattr(module, name)
        if inspect.isclass(exported) or inspect.isfunction(exported):
            docstring = inspect.getdoc(exported)
            assert docstring, name
            assert docstring.splitlines()[0].replace("``", "`") in page


def test_a_signature_is_that_of_the_source() -> None:
    node: Any = ast.parse("def f(self, a: int, *, b: float = 2.0) -> str: ...").body[0]
    assert python_pages.signature(node, method=True) == "f(a: int, *, b: float=2.0) -> str"
    assert python_pages.signature(node, method=False).startswith("f(self, ")
    node = ast.parse("@property\ndef g(self) -> Series: ...").body[0]
    assert python_pages.signature(node, method=True) == "g: Series"


def test_all_literature_is_there_without_tex_and_is_cited() -> None:
    page = literature.bibliography_page(ROOT)
    assert set(literature.entries(ROOT)) == known_references()
    assert not set("{}\\") & set(page)
    assert "Cited by ." not in page
    assert "Raphaël Dumas, Laurence Chèze" in unicodedata.normalize("NFC", page)


@each_of(PAGES)
def test_keys_that_a_page_cites_are_known(page: Path) -> None:
    cited = {code for code in inline_code(page) if re.fullmatch(r"[a-z]{3,}(?:19|20)\d\d[a-z]*", code)}
    assert cited <= known_references()


def test_formulas_become_mathml() -> None:
    marked = '<p>of <span class="arithmatex">\\(a &lt; \\dot L_c\\)</span></p>\n<div class="arithmatex">\\[ b \\]</div>'
    page = formulas.in_page(marked)
    assert "arithmatex" not in page
    assert page.count("<math ") == 2
    assert "<mo>&#x0003C;</mo>" in page
    assert "<mover><mi>L</mi><mo>&#x002D9;</mo></mover>" in page
    assert formulas.in_title("the moment \\(\\nu_c\\)").startswith("the moment <math")
    with pytest.raises(ValueError, match="nonsense"):
        formulas.mathml("\\nonsense")


@each_of(PAGES)
def test_every_formula_of_a_page_is_understood(page: Path) -> None:
    for inline, block in re.findall(r"\\\((.+?)\\\)|\\\[(.+?)\\\]", page.read_text(encoding="utf-8"), re.DOTALL):
        assert "<math" in formulas.mathml(inline or block)


def test_prose_is_wrapped() -> None:
    """At 120 characters, or a little later where a word may not begin a line; code, tables and formulas aside."""
    wide: list[str] = []
    pages = [*DOCS.rglob("*.md"), *(ROOT / f"{name}.md" for name in ("README", "CONTRIBUTING", "CHANGELOG"))]
    for path in pages:
        is_code = False
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            is_code ^= line.lstrip().startswith("```")
            is_prose = not (
                is_code or line.startswith("    ") or line.lstrip().startswith(("|", "\\[", "$$", "<", "`tests/"))
            )
            if is_prose and len(line) > PROSE_WIDTH and path.name != "reproduction.md":  # which a script writes
                wide.append(f"{path.name}:{number}")
    assert not wide
