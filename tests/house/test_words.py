"""The words of the product: names that can be searched for, and sentences in plain English."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from support.docs.book import ROOT, each_of, syntax_tree

PYTHON = [
    path
    for folder in ("backend/stridelab", "frontend/stridelab_web")
    for path in sorted((ROOT / folder).rglob("*.py"))
    if "migrations" not in path.parts
]
TESTS_AND_SCRIPTS = [path for folder in ("tests", "scripts") for path in sorted((ROOT / folder).rglob("*.py"))]
TEMPLATES = sorted((ROOT / "frontend").rglob("*.html"))
VAGUE = frozenset({"found", "told", "said", "kept", "asked", "nought", "whoever", "nobody"})
"""Participles and pronouns that once stood for results, reports, requests and callers; see docs/glossary.md."""
NEVER_WRITTEN = re.compile(
    r"\b(nought|whoever|nobody|is told|are told|was told|is asked for|what is kept)\b", re.IGNORECASE
)
MOST_VAGUE_PER_1000_LINES = 3.0
MOST_ONE_WORD_NAMES = 0.40
PARTICIPLES = frozenset({*VAGUE, "told", "known", "chosen", "given", "taken", "held", "seen", "shown", "made", "done"})
MOST_PARTICIPLES = 0.01
PLAIN_WORDS_IN_ED = frozenset({"need", "feed", "speed", "seed", "embed", "exceed", "proceed", "shed"})


def functions(tree: ast.AST) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and not node.name.startswith("__"):
            yield node


def public_names(tree: ast.Module) -> Iterator[str]:
    """Names of public functions, classes, their methods and parameters, and of module constants."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and not node.name.startswith("_"):
            yield node.name
            yield from (each.arg for each in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs))
    for statement in tree.body:
        if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
            yield statement.target.id


def sentences(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Docstrings and messages: every string with a space in it."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value.strip():
            yield node.lineno, node.value


@each_of(PYTHON)
def test_public_names_are_field_words(path: Path) -> None:
    names = public_names(syntax_tree(path))
    words = {name: name.lower().replace("not_found", "").split("_") for name in names}
    assert sorted(name for name in words if VAGUE & set(words[name])) == []


@each_of(PYTHON)
def test_docstrings_and_messages_are_plain_english(path: Path) -> None:
    text = sentences(syntax_tree(path))
    assert [(line, match[0]) for line, sentence in text if (match := NEVER_WRITTEN.search(sentence))] == []


@each_of(TEMPLATES)
def test_pages_are_plain_english(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert [match[0] for match in NEVER_WRITTEN.finditer(text)] == []
    assert [line for line in text.splitlines() if len(line) > 160] == []


def vague_per_1000_lines(paths: list[Path]) -> float:
    words = lines = 0
    for path in paths:
        text = path.read_text(encoding="utf-8")
        lines += text.count("\n")
        words += sum(word in VAGUE for word in re.split(r"[\s_]+", text.lower()))
    return 1000 * words / lines


def test_vague_words_are_rare() -> None:
    assert vague_per_1000_lines(PYTHON) < MOST_VAGUE_PER_1000_LINES


def test_vague_words_are_rare_in_tests_and_scripts() -> None:
    """Each folder of tests and the scripts keep the limit."""
    folders: dict[str, list[Path]] = {}
    for path in TESTS_AND_SCRIPTS:
        parts = path.relative_to(ROOT).parts
        if len(parts) > 2 or parts[0] == "scripts":
            folders.setdefault("/".join(parts[: 2 if parts[0] == "tests" else 1]), []).append(path)
    per_folder = {folder: vague_per_1000_lines(paths) for folder, paths in folders.items()}
    assert {folder: figure for folder, figure in per_folder.items() if figure >= MOST_VAGUE_PER_1000_LINES} == {}


def test_names_of_functions_are_more_than_one_word() -> None:
    names = [node.name.strip("_") for path in PYTHON for node in functions(syntax_tree(path))]
    one_word = [name for name in names if "_" not in name]
    participles = [name for name in one_word if name in PARTICIPLES or re.fullmatch(r"\w+[^e]ed", name)]
    participles = [name for name in participles if name not in PLAIN_WORDS_IN_ED]
    assert len(one_word) <= MOST_ONE_WORD_NAMES * len(names)
    assert len(participles) <= MOST_PARTICIPLES * len(names), sorted(participles)
