"""docs/thesis-to-code.md: every numbered equation of the thesis, the modules that compute it and the tests of it.

An equation is cited in a docstring by its number in parentheses of its own, ``(2.5)`` or ``(4.20a)``; several as
``(3.1), (3.2)`` or ``(2.24)-(2.27)``, and all parts at once as ``(4.20)``. The list is docs/thesis_equations.toml.
"""

import ast
import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
LIST = ROOT / "docs" / "thesis_equations.toml"
PAGE = ROOT / "docs" / "thesis-to-code.md"
MODULES = ("conventions.py", "dynamics", "recordings", "body", "estimation", "walking", "contacts",
           "reachability", "centroidal", "wholebody", "simulation", "studies", "reproduction")  # fmt: skip
"""What computes: the packages below the service."""
CHAPTERS = {"2": "The centre of mass of a moving body", "3": "The rolling wheel", "4": "Multi-contact motion"}
CITED = re.compile(r"\((\d\.\d+[a-z]?)\)(?:-\((\d\.\d+[a-z]?)\))?")

HEAD = """# From the thesis to the code

Every numbered equation of chapters 2 to 4 of Carpentier, *Computational foundations of anthropomorphic locomotion*,
2017; the numbers are its own, the words are ours. Modules are those whose docstrings cite the equation, tests those
that say that they check it. Where the code computes something else than what is printed, the link leads to
[why](theory/misprints.md). Where nothing computes an equation, the reason stands in its place.

Written by `scripts/make_equation_map.py` from `docs/thesis_equations.toml` and the docstrings; a test fails when an
equation has neither module nor reason, when it has no test, when somebody cites what is not listed, and when this page
is not what the script would write.
"""


@dataclass(frozen=True)
class Equation:
    """A row of the list; ``unused`` is why nothing computes it, ``corrected`` a heading of the misprints."""

    number: str
    section: str
    says: str
    unused: str = ""
    corrected: str = ""

    @property
    def whole(self) -> str:
        """The number without the letter of the part."""
        return self.number.rstrip("abcdef")


class Citation(NamedTuple):
    """Where an equation is cited: a file, and the test in it unless the whole file is meant."""

    path: Path
    test: str = ""


def equations() -> list[Equation]:
    """The list, in the order of the thesis."""
    return [Equation(**row) for row in tomllib.loads(LIST.read_text(encoding="utf-8"))["equation"]]


def cited_in(text: str, order: list[str]) -> Iterator[str]:
    """Numbers of the equations that a text cites, as written; ranges in ``order``."""
    for first, last in CITED.findall(text):
        yield first
        if last and {first, last} <= set(order):
            yield from order[order.index(first) + 1 : order.index(last) + 1]
        elif last:
            yield last


@cache
def docstrings(path: Path) -> tuple[tuple[str, str], ...]:
    """Docstrings and other bare strings of a file, each with the name of the test function around it."""
    return tuple(_named_strings(path))


def _named_strings(path: Path) -> Iterator[tuple[str, str]]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    tests = [n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name.startswith("test")]
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            inside = [t.name for t in tests if t.lineno <= node.lineno <= (t.end_lineno or t.lineno)]
            yield "".join(inside), node.value.value


def sources(root: Path, names: tuple[str, ...]) -> list[Path]:
    """Python files of a folder that are, or lie in, one of ``names``."""
    paths = (
        path for name in names for path in ([root / name] if name.endswith(".py") else (root / name).rglob("*.py"))
    )
    return sorted(paths)


def citations(paths: list[Path], order: list[str]) -> dict[str, list[Citation]]:
    """By the number as cited, every place once."""
    by_equation: dict[str, list[Citation]] = {}
    for path in paths:
        for test, text in docstrings(path):
            for number in cited_in(text, order):
                places = by_equation.setdefault(number, [])
                if (place := Citation(path, test)) not in places:
                    places.append(place)
    return by_equation


def places(equation: Equation, cited: dict[str, list[Citation]]) -> list[Citation]:
    """Where the equation itself is cited, and otherwise where all its parts are at once."""
    return cited.get(equation.number) or cited.get(equation.whole, [])


def implementations(order: list[str]) -> dict[str, list[Citation]]:
    """Citations of the modules that compute."""
    return citations(sources(ROOT / "backend" / "stridelab", MODULES), order)


def tests(order: list[str]) -> dict[str, list[Citation]]:
    """Citations of test modules and test functions."""
    return citations(sorted((ROOT / "tests").rglob("test_*.py")), order)


def anchor(heading: str) -> str:
    """How mkdocs names the anchor of a heading."""
    words = re.sub(r"[^\w\s-]", "", heading.lower()).strip()
    return re.sub(r"[-\s]+", "-", words)


def row(equation: Equation, modules: list[Citation], tested: list[Citation]) -> str:
    """A line of the table."""
    says = equation.says
    if equation.corrected:
        says += f" ([corrected](theory/misprints.md#{anchor(equation.corrected)}))"
    dotted = [".".join(m.path.relative_to(ROOT / "backend" / "stridelab").with_suffix("").parts) for m in modules]
    test_names = [f"`{t.path.relative_to(ROOT)}" + (f"::{t.test}`" if t.test else "`") for t in tested]
    where = ["not computed: " + equation.unused] if equation.unused else [f"`{name}`" for name in dotted]
    return f"| ({equation.number}) | {equation.section} | {says} | {'<br>'.join(where)} | {'<br>'.join(test_names)} |"


def page() -> str:
    """The whole page."""
    listed = equations()
    order = [e.number for e in listed]
    code, tested = implementations(order), tests(order)
    lines = [HEAD]
    for chapter, title in CHAPTERS.items():
        lines += [f"## Chapter {chapter}: {title.lower()}", "", "| | section | says | modules | tests |"]
        lines += ["| --- | --- | --- | --- | --- |"]
        for equation in listed:
            if equation.number.startswith(chapter):
                lines.append(row(equation, places(equation, code), places(equation, tested)))
        lines.append("")
    return "\n".join(lines)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
