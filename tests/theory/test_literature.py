"""models/references.bib: what is cited is in it, what is in it is cited, and every entry is complete."""

import ast
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "models" / "references.bib").read_text(encoding="utf-8")
ENTRIES = dict(re.findall(r"^@\w+\{([^,\s]+),(.*?)^\}", TEXT, re.MULTILINE | re.DOTALL))
KEY = re.compile(r"[a-z]+(?:19|20)\d\d[a-z]*")


def cited_in_code() -> set[str]:
    """String literals of the form of a key, in every module."""
    keys: set[str] = set()
    for path in (ROOT / "backend" / "stridelab").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and KEY.fullmatch(node.value):
                keys.add(node.value)
    return keys


def cited_in_models() -> set[str]:
    keys: set[str] = set()
    for path in (ROOT / "models").rglob("*.toml"):
        keys.update(tomllib.loads(path.read_text(encoding="utf-8")).get("references", ()))
    return keys


def cited_in_docs() -> set[str]:
    pages = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs").rglob("*.md"))
    return set(re.findall(r"`([a-z]+(?:19|20)\d\d[a-z]*)`", pages))


def test_the_literature_has_exactly_the_cited_keys() -> None:
    cited = cited_in_code() | cited_in_models() | cited_in_docs()
    assert cited - ENTRIES.keys() == set()
    assert ENTRIES.keys() - cited == set()


@pytest.mark.parametrize("key", ENTRIES)
def test_an_entry_is_complete_and_its_key_has_its_year(key: str) -> None:
    fields = dict(re.findall(r"^  (\w+) *= \{(.*)\},?$", ENTRIES[key], re.MULTILINE))
    assert {"author", "title", "year"} <= fields.keys()
    assert {"journal", "booktitle", "publisher", "school"} & fields.keys()
    assert fields["year"] in key
    family = re.sub(r"""\\['"`^~]|[{}\s]""", "", fields["author"].split(",")[0]).lower()
    assert key.startswith(family)
    assert TEXT.count(f"{{{key},") == 1
    assert all(value.count("{") == value.count("}") for value in fields.values())
    assert re.fullmatch(r"\d+--\d+", fields.get("pages", "1--2"))
    assert re.fullmatch(r"10\.\d{4,}/\S+", fields.get("doi", "10.1000/x"))
