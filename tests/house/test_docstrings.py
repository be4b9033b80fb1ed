"""Every public part of what computes says what it is, what it raises by itself, and of what shape its arrays are.

The form is: Raises ``InvalidInput`` (``some-code``); class and code stand in double backticks behind a form of *raise*.
What ``__init__`` or ``__post_init__`` raises may stand with the class. What is called in turn is not looked at.
"""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from support.docs.book import BACKEND, each_of, numeric_modules, syntax_tree

RAISES = re.compile(r"\b[Rr]aises?\b")
ODD_CODE = re.compile(r"[\"(][a-z]+(?:-[a-z0-9]+)+[\",)]")
"""A code in quotes, or bare in parentheses."""
Function = ast.FunctionDef | ast.AsyncFunctionDef
SHAPED = {"Complex", "Float", "Int", "Bool", "Num", "Shaped", "UInt8"}
"""Types of jaxtyping that say a shape."""
MAKES = {"__init__", "__post_init__"}
INNER = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.Lambda)


class Part(NamedTuple):
    """A public class or function: its name with those around it, its docstring, and its node."""

    name: str
    docstring: str
    node: ast.ClassDef | Function


def parts(body: list[ast.stmt], inside: str = "", above: str = "") -> Iterator[Part]:
    """Public parts of a module or, ``inside`` its name, of a class whose docstring is ``above``."""
    for node in body:
        if not isinstance(node, ast.ClassDef | Function):
            continue
        docstring = ast.get_docstring(node) or ""
        if node.name in MAKES:
            yield Part(inside + node.name, f"{above}\n{docstring}", node)
        elif not node.name.startswith("_"):
            yield Part(inside + node.name, docstring, node)
            if isinstance(node, ast.ClassDef):
                yield from parts(node.body, f"{inside}{node.name}.", docstring)


def own(node: ast.AST) -> Iterator[ast.AST]:
    """What stands in a function itself, not in those that it holds."""
    for child in ast.iter_child_nodes(node):
        if not isinstance(child, INNER):
            yield child
            yield from own(child)


@cache
def error_classes() -> frozenset[str]:
    """Names of ``StridelabError`` and of every class below it, wherever in the backend it stands."""
    trees = [syntax_tree(path) for path in BACKEND.rglob("*.py")]
    bases = {
        node.name: {base.id for base in node.bases if isinstance(base, ast.Name)}
        for tree in trees
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
    }
    names = {"StridelabError"}
    while more := {name for name, above in bases.items() if above & names} - names:
        names |= more
    return frozenset(names)


def raised(node: Function, errors: frozenset[str]) -> Iterator[str]:
    """Classes of this project's errors that a function raises by itself, and their codes as far as they are written."""
    for inner in own(node):
        if isinstance(inner, ast.Raise) and isinstance(inner.exc, ast.Call) and isinstance(inner.exc.func, ast.Name):
            if inner.exc.func.id not in errors:
                continue
            yield inner.exc.func.id
            first = inner.exc.args[0] if inner.exc.args else None
            if isinstance(first, ast.Constant):
                yield str(first.value)


def unsaid(part: Part, errors: frozenset[str]) -> list[str]:
    """What the docstring of a part lacks."""
    lacking = [] if part.docstring.strip() or part.node.name in MAKES else ["a docstring"]
    if isinstance(part.node, ast.ClassDef):
        return lacking
    named = behind_raises(part.docstring)
    return lacking + [name for name in dict.fromkeys(raised(part.node, errors)) if f"``{name}``" not in named]


def behind_raises(docstring: str) -> str:
    """What a docstring says from its first form of *raise* on."""
    _, *behind = RAISES.split(docstring, maxsplit=1)
    return "".join(behind)


def shapeless(annotation: ast.AST | None) -> bool:
    """Whether an annotation names an array and not the shape that it has: ``np.ndarray`` outside ``Float[...]``."""
    if annotation is None:
        return False
    if isinstance(annotation, ast.Subscript) and getattr(annotation.value, "id", "") in SHAPED:
        return False
    if isinstance(annotation, ast.Attribute) and annotation.attr == "ndarray":
        return True
    return any(shapeless(child) for child in ast.iter_child_nodes(annotation))


def annotations(part: Part) -> Iterator[ast.AST | None]:
    """Of the fields of a class; of what a function takes and returns."""
    if isinstance(part.node, ast.ClassDef):
        yield from (field.annotation for field in part.node.body if isinstance(field, ast.AnnAssign))
    else:
        arguments = part.node.args
        yield from (each.annotation for each in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs))
        yield part.node.returns


@each_of(numeric_modules())
def test_public_parts_say_what_they_are_and_what_they_raise(path: Path) -> None:
    missing = {part.name: unsaid(part, error_classes()) for part in parts(syntax_tree(path).body)}
    assert {name: lacking for name, lacking in missing.items() if lacking} == {}


@each_of(numeric_modules())
def test_arrays_of_public_parts_have_their_shape_in_the_type(path: Path) -> None:
    public_parts = parts(syntax_tree(path).body)
    assert [part.name for part in public_parts if any(map(shapeless, annotations(part)))] == []


def test_codes_in_docstrings_are_written_in_one_way() -> None:
    texts = [
        (path.relative_to(BACKEND), part.name, behind_raises(part.docstring))
        for path in sorted(BACKEND.rglob("*.py"))
        for part in parts(syntax_tree(path).body)
    ]
    assert [(path, name) for path, name, docstring in texts if ODD_CODE.search(docstring)] == []
    assert ODD_CODE.search('``NotFound`` ("no-such-thing") where')
    assert ODD_CODE.search("``NotFound`` (no-such-thing)")


def test_incomplete_docstrings_are_detected() -> None:
    source = '''
class Silent:
    def __post_init__(self) -> None:
        raise NotFound("first-code", "words")
    def explained(self) -> None:
        """Raises ``InvalidInput`` (``second-code``)."""
        def inner() -> None:
            raise NotFound("of-another", "words")
        raise InvalidInput("second-code", "words")
    def half(self) -> None:
        """Raises ``InvalidInput``, always."""
        raise InvalidInput("third-code", "words")
    def _own(self) -> None:
        raise InvalidInput("fourth-code", "words")
'''
    missing = {part.name: unsaid(part, error_classes()) for part in parts(ast.parse(source).body)}
    assert missing == {
        "Silent": ["a docstring"],
        "Silent.__post_init__": ["NotFound", "first-code"],
        "Silent.explained": [],
        "Silent.half": ["third-code"],
    }
    (odd, fine) = parts(ast.parse("def odd(x: list[np.ndarray]): ...\ndef fine(x: Float[np.ndarray, 'n 3']): ...").body)
    assert [any(map(shapeless, annotations(part))) for part in (odd, fine)] == [True, False]
