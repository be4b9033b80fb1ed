"""Rules of the house that no linter knows."""

import ast
import json
import subprocess
from collections import Counter
from pathlib import Path

from support.docs.book import ROOT, each_of, numeric_modules, syntax_tree


def tracked() -> list[Path]:
    """Files of the project: what git tracks, or every source file where this is no checkout."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode == 0 and listed.stdout:
        return [path for name in listed.stdout.split("\0") if name and (path := ROOT / name).is_file()]
    return [
        path for folder in ("backend", "frontend", "models", "tests", "docs") for path in (ROOT / folder).rglob("*.*")
    ]


PRODUCT = {"backend", "frontend"}
MOST_MODULES = 24
SOURCES = [path for path in tracked() if path.suffix in {".py", ".js", ".html", ".css"}]


def test_no_tracked_file_is_over_a_megabyte() -> None:
    assert [path for path in tracked() if path.stat().st_size > 1_000_000] == []


@each_of(SOURCES)
def test_modules_stay_readable(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 400


def test_no_folder_of_the_product_holds_more_than_24_modules_or_templates() -> None:
    kinds = {".py", ".js", ".html"}
    modules = [path for path in SOURCES if path.suffix in kinds and path.relative_to(ROOT).parts[0] in PRODUCT]
    counts = Counter(str(path.parent.relative_to(ROOT)) for path in modules)
    assert {folder: number for folder, number in counts.items() if number > MOST_MODULES} == {}


def test_numeric_code_does_not_print() -> None:
    for path in numeric_modules():
        calls = [n for n in ast.walk(syntax_tree(path)) if isinstance(n, ast.Call)]
        assert not [c for c in calls if isinstance(c.func, ast.Name) and c.func.id == "print"], path


def test_locks_name_no_index_and_hash_everything() -> None:
    for name in ("requirements.lock", "requirements-cluster.lock", "requirements-dev.lock", "requirements-uv.lock"):
        text = (ROOT / name).read_text(encoding="utf-8")
        assert "://" not in text
        pins = [line for line in text.splitlines() if "==" in line and not line.lstrip().startswith("#")]
        assert pins
        assert all(line.endswith("\\") for line in pins), "a pin without a hash"


def test_lock_of_the_javascript_tools_names_no_registry_and_hashes_everything() -> None:
    lock = json.loads((ROOT / "frontend" / "package-lock.json").read_text(encoding="utf-8"))
    packages = {name: package for name, package in lock["packages"].items() if name}
    assert {"node_modules/@biomejs/biome", "node_modules/typescript"} <= set(packages)
    assert [name for name, package in packages.items() if "resolved" in package or "integrity" not in package] == []


def test_pages_carry_no_inline_scripts() -> None:
    for path in (ROOT / "frontend").rglob("*.html"):
        text = path.read_text(encoding="utf-8")
        assert "<script>" not in text, path
        assert " onclick=" not in text, path
        assert "style=" not in text, path
