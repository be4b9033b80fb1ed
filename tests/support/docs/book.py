"""The book and the files of the project, as the tests of the house read them.

The pages of the book and the papers beside it: their code blocks, inline code, links and headings.

Shell lines of the book taken apart into simple commands; nothing is run.

One test over many files: it checks each and lists those that fail, so that numbers of tests mean behaviour.

The rooms of the backend and the floors that they stand on, for the tests of the house.

The compose files as docker compose reads them: merged, with the defaults of their variables.
"""

import ast
import re
import shlex
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import yaml
from markdown_it import MarkdownIt
from markdown_it.token import Token

ROOT = Path(__file__).parents[3]
DOCS = ROOT / "docs"
PAPERS = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
PAGES = [*PAPERS, *sorted(DOCS.rglob("*.md"))]
READER = MarkdownIt("commonmark").enable("table")


@dataclass(frozen=True)
class Block:
    """A code block: ``language`` is empty where it is only indented; ``line`` is that of its text, from 1."""

    page: Path
    line: int
    language: str
    text: str

    @property
    def place(self) -> str:
        """How a failure names it."""
        return f"{self.page.relative_to(ROOT)}:{self.line}"


@cache
def tokens(page: Path) -> tuple[Token, ...]:
    """The page as CommonMark sees it."""
    return tuple(READER.parse(page.read_text(encoding="utf-8")))


@cache
def syntax_tree(path: Path) -> ast.Module:
    """The syntax tree of a Python file, parsed once for all tests of the house."""
    return ast.parse(path.read_text(encoding="utf-8"))


def _all(page: Path) -> Iterator[Token]:
    for token in tokens(page):
        yield token
        yield from token.children or ()


def blocks(page: Path) -> list[Block]:
    """All code blocks, fenced or indented."""
    code_tokens = [t for t in tokens(page) if t.type in {"fence", "code_block"}]
    return [
        Block(page, (t.map or [0])[0] + (2 if t.type == "fence" else 1), t.info.strip(), t.content) for t in code_tokens
    ]


def inline_code(page: Path) -> list[str]:
    """Everything between single backticks."""
    return [t.content for t in _all(page) if t.type == "code_inline"]


def links(page: Path) -> list[str]:
    """Targets of all links and pictures."""
    return [
        str(t.attrs["href" if t.type == "link_open" else "src"]) for t in _all(page) if t.type in {"link_open", "image"}
    ]


def slug(heading: str) -> str:
    """How mkdocs names the anchor of a heading."""
    words = re.sub(r"[^\w\s-]", "", heading.lower()).strip()
    return re.sub(r"[-\s]+", "-", words)


def anchors(page: Path) -> set[str]:
    """Anchors of a page's headings; the second of one name has ``_1``, as mkdocs has it."""
    slugs: set[str] = set()
    for opening, inside in pairwise(tokens(page)):
        if opening.type == "heading_open":
            name = slug("".join(t.content for t in inside.children or () if t.type in {"text", "code_inline"}))
            again = (f"{name}_{k}" for k in range(1, 100))
            slugs.add(name if name not in slugs else next(n for n in again if n not in slugs))
    return slugs


ASSIGNMENT = re.compile(r"([A-Za-z_]\w*)=(.*)", re.DOTALL)
SEPARATORS = {"|", "||", "&&", ";", "&"}
GRAMMAR = {"if", "then", "else", "fi", "while", "until", "do", "done", "!"}
"""Words of the shell itself, before a command."""


@dataclass(frozen=True)
class Command:
    """``program`` with its arguments, what is assigned before it, and the command whose output it reads.

    What ``$(...)`` stands for reads ``$VALUE``.
    """

    program: str
    arguments: tuple[str, ...]
    assigned: dict[str, str]
    fed_by: "Command | None" = None


def commands(text: str) -> list[Command]:
    """All simple commands of a script, those inside of ``$(...)`` first; open quotes are a ``ValueError``."""
    joined = re.sub(r"\\\n\s*", " ", text)
    joined = re.sub(r"(\||&&)[ \t]*(?:#[^\n]*)?\n\s*", r"\1 ", joined)
    return [command for line in joined.splitlines() for command in _of_line(line)]


def _of_line(line: str) -> Iterator[Command]:
    outer, inner = _substituted(line)
    for part in inner:
        yield from _of_line(part)
    reader = shlex.shlex(outer, posix=True, punctuation_chars="|&;<>")
    reader.whitespace_split = True
    words: list[str] = []
    before: Command | None = None
    for word in [*reader, ";"]:
        if word in SEPARATORS:
            if words:
                before = _command(words, before)
                yield before
            before = before if word == "|" else None
            words = []
        elif words or word not in GRAMMAR:
            words.append(word)


def _substituted(line: str) -> tuple[str, list[str]]:
    """The line with ``$VALUE`` for every ``$(...)``, and what stood in them."""
    inner = []
    while (start := line.find("$(")) >= 0:
        depth, end = 1, start + 2
        while depth:
            if end >= len(line):
                raise ValueError(f"$( is never closed: {line}")
            depth += {"(": 1, ")": -1}.get(line[end], 0)
            end += 1
        inner.append(line[start + 2 : end - 1])
        line = line[:start] + "$VALUE" + line[end:]
    return line, inner


def _command(words: list[str], fed_by: Command | None) -> Command:
    arguments: list[str] = []
    place = iter(words)
    for word in place:
        if set(word) <= set("<>&"):
            next(place, None)  # where it is read from or written to
        else:
            arguments.append(word)
    assigned = {}
    while arguments and (assignment := ASSIGNMENT.fullmatch(arguments[0])):
        assigned[assignment[1]] = assignment[2]
        arguments.pop(0)
    if arguments and arguments[0] == "export":
        assigned |= {m[1]: m[2] for word in arguments[1:] if (m := ASSIGNMENT.fullmatch(word))}
    return Command(arguments[0] if arguments else "", tuple(arguments[1:]), assigned, fed_by)


def each_of(paths: Iterable[Path]) -> Callable[[Callable[[Path], None]], Callable[[], None]]:
    """Decorate a check of one file: the test runs it for all ``paths`` and names every file that fails."""
    known = list(paths)

    def decorate(check: Callable[[Path], None]) -> Callable[[], None]:
        def test() -> None:
            assert known, "no files to check"
            failures = {}
            for path in known:
                try:
                    check(path)
                except AssertionError as error:
                    failures[str(path.relative_to(ROOT))] = str(error)
            assert not failures, "\n".join(f"{path}: {why}" for path, why in failures.items())

        test.__name__, test.__qualname__, test.__doc__ = check.__name__, check.__qualname__, check.__doc__
        test.__module__ = check.__module__
        return test

    return decorate


BACKEND = ROOT / "backend" / "stridelab"
FRONTEND = ROOT / "frontend" / "stridelab_web"

GROUND = {"conventions", "machine", "errors"}
WINGS = ["dynamics", "recordings", "body", "estimation", "walking", "measures"]
ROBOT_WING = ["dynamics", "robots", "contacts", "reachability", "centroidal", "wholebody"]
SCIENCE = GROUND | set(WINGS) | set(ROBOT_WING)
STUDIES = ["simulation", "reproduction"]
NUMERIC = SCIENCE | set(STUDIES)
"""What computes: it knows no web and prints nothing, and a docstring says what each public part of it is."""


def room_of(path: Path) -> str:
    """Which room a module of the backend belongs to."""
    return path.relative_to(BACKEND).parts[0].removesuffix(".py")


def numeric_modules() -> list[Path]:
    """Every module of the rooms that compute."""
    return [path for path in sorted(BACKEND.rglob("*.py")) if room_of(path) in NUMERIC]


LAB = ROOT / "docker-compose.yml"
OBSERVED = ROOT / "compose.observability.yml"
OURS = "stridelab:latest"
_VARIABLE = re.compile(r"\$\{([A-Z_]+)(?::-([^}]*))?\}")


def compose(*files: Path) -> dict[str, Any]:
    """All compose files merged into one; fails if two of them define the same part."""
    merged: dict[str, Any] = {}
    for file in files:
        text = _VARIABLE.sub(lambda match: match[2] or "", file.read_text(encoding="utf-8"))
        for part, content in yaml.safe_load(text).items():
            if isinstance(content, dict):
                twice = set(merged.setdefault(part, {})) & set(content)
                assert not twice or part.startswith("x-"), f"{part} defines {twice} twice"
                merged[part] = {**merged[part], **content}
            else:
                merged[part] = content
    return merged


def megabytes(size: str) -> int:
    """``4g`` -> 4096."""
    return int(size[:-1]) * {"m": 1, "g": 1024}[size[-1]]
