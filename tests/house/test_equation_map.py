"""Every numbered equation of the thesis has a module or a reason, and a test; the page says what the code says."""

import importlib.util
import re
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
SPEC = importlib.util.spec_from_file_location("make_equation_map", ROOT / "scripts" / "make_equation_map.py")
assert SPEC
assert SPEC.loader
themap = importlib.util.module_from_spec(SPEC)
sys.modules[SPEC.name] = themap
SPEC.loader.exec_module(themap)

LISTED = themap.equations()
ORDER = [equation.number for equation in LISTED]
CITING = [
    path for folder in ("backend", "frontend", "tests", "scripts") for path in sorted((ROOT / folder).rglob("*.py"))
]


@pytest.fixture(scope="module")
def computed() -> Any:
    return themap.implementations(ORDER)


@pytest.fixture(scope="module")
def tested() -> Any:
    return themap.tests(ORDER)


def natural(number: str) -> tuple[int, int, str]:
    chapter, rest = number.split(".")
    return int(chapter), int(rest.rstrip("abcdef")), rest.lstrip("0123456789")


def test_the_list_of_equations_is_complete_and_in_order() -> None:
    assert sorted(set(ORDER), key=natural) == ORDER
    wholes = list(dict.fromkeys(e.whole for e in LISTED))
    assert wholes == [f"{chapter}.{k}" for chapter, last in ((2, 31), (3, 4), (4, 20)) for k in range(1, last + 1)]
    for whole in wholes:
        letters = "".join(number[len(whole) :] for number in ORDER if number.rstrip("abcdef") == whole)
        assert letters == "abcdef"[: len(letters)], whole


@pytest.mark.parametrize("equation", LISTED, ids=ORDER)
def test_an_equation_has_a_module_and_a_test_or_a_reason(equation: Any, computed: Any, tested: Any) -> None:
    if equation.unused:
        assert equation.unused.endswith(".")
    else:
        assert themap.places(equation, computed), "no docstring of a module that computes cites it"
        assert themap.places(equation, tested), "no docstring of a test cites it"


def test_only_listed_equations_are_cited_and_in_one_way() -> None:
    known = {*ORDER, *(e.whole for e in LISTED)}
    texts = [(path.relative_to(ROOT), text) for path in CITING for _, text in themap.docstrings(path)]
    assert [(p, n) for p, text in texts for n in themap.cited_in(text, ORDER) if n not in known] == []
    several = re.compile(r"\([234]\.\d+[a-f]?(?:,|-\d| and )[^)]*\)")
    assert [(p, citation) for p, text in texts for citation in several.findall(text)] == [], (
        "each number in parentheses"
    )


def test_corrections_lead_to_headings() -> None:
    headings = re.findall(r"^### (.*)$", (ROOT / "docs" / "theory" / "misprints.md").read_text("utf-8"), re.MULTILINE)
    assert {e.corrected for e in LISTED if e.corrected} <= set(headings)


def test_ranges_and_parts_are_read() -> None:
    assert list(themap.cited_in("of (2.24)-(2.27), see (4.20)", ORDER)) == ["2.24", "2.25", "2.26", "2.27", "4.20"]
    assert list(themap.cited_in("0.4 (4.7 ms), section 4.4 and (4.4.3), f(2.5, x)", ORDER)) == []


def test_the_page_is_what_the_script_writes() -> None:
    assert themap.PAGE.read_text(encoding="utf-8") == themap.page(), "run scripts/make_equation_map.py"
