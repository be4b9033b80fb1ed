"""The pages on errors: every error of the text names a test that exists."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


def sections(page: Path) -> dict[str, str]:
    """Text below every heading of the third level."""
    _, *parts = re.split(r"^### ", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {part.partition("\n")[0]: re.split(r"^## ", part, flags=re.MULTILINE)[0] for part in parts}


def defined_in(module: Path) -> set[str]:
    tree = ast.parse(module.read_text(encoding="utf-8"))
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


@pytest.mark.parametrize("name", ["misprints.md", "pitfalls.md"])
def test_every_error_names_tests_that_exist(name: str) -> None:
    page_sections = sections(DOCS / "theory" / name)
    assert len(page_sections) > 12
    for heading, text in page_sections.items():
        named = re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", text)
        assert named, heading
        for module, test in named:
            assert test in defined_in(ROOT / module), f"{heading}: {module}::{test}"
