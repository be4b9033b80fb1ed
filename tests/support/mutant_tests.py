"""Which tests execute a changed place of the reproduction, those that are done first in front."""

import ast
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

DEFINITIONS: Final = (ast.FunctionDef, ast.ClassDef)


class ExecutedTests:
    """Tests by the lines of a package that they execute, as ``executed_lines`` writes them."""

    def __init__(self, package: Path, executed: Mapping[str, Mapping[str, Any]]) -> None:
        self._trees = {
            path.relative_to(package).as_posix(): ast.parse(path.read_text(encoding="utf-8"))
            for path in sorted(package.rglob("*.py"))
        }
        self._seconds = {test: float(of["seconds"]) for test, of in executed.items()}
        self._tests_at = defaultdict[tuple[str, int], set[str]](set)
        for test, of in executed.items():
            for file, line in of["lines"]:
                self._tests_at[file, line].add(test)
        root = package.parents[2]
        self._test_trees = {
            file: ast.parse((root / file).read_text(encoding="utf-8"))
            for file in sorted({test.partition("::")[0] for test in executed})
            if (root / file).is_file()
        }

    def tests_of(self, file: str, line: int) -> list[str]:
        """Tests that execute the statement at a line; if none does, its function, and then its module.

        A statement outside of functions is executed by those that execute a function that reads its names; tests of a
        file that reads them from the module are added, with all their parameters, of which a name may be one.
        """
        path = _path_to(self._trees[file], line)
        functions = [node for node in path if isinstance(node, ast.FunctionDef)]
        naming: set[str] = set()
        if not functions:
            names = _assigned_names(path)
            places = self._readers_of(names)
            module = Path(file).stem
            files = [of for of, tree in self._test_trees.items() if _reads_of_module(tree, module, names)]
            naming = {test for test in self._seconds if test.partition("::")[0] in files}
        else:
            places = [(file, _own_lines(path[-1])), (file, _body_lines(functions[-1]))]
            places = places[:1] if self._tests_in(places[:1]) else places[1:]
        tests = self._tests_in(places) or self._tests_in(
            [(file, _body_lines(node)) for node in ast.walk(self._trees[file]) if isinstance(node, ast.FunctionDef)]
        )
        in_order = self._in_order(tests | naming)
        return list(dict.fromkeys(test.partition("[")[0] if test in naming else test for test in in_order))

    def _tests_in(self, places: Sequence[tuple[str, range]]) -> set[str]:
        return {test for file, lines in places for line in lines for test in self._tests_at.get((file, line), ())}

    def _readers_of(self, names: set[str]) -> list[tuple[str, range]]:
        """Bodies of all functions that read one of the names, also by way of other statements outside of functions."""
        names = set(names)
        while True:
            more = {
                target
                for tree in self._trees.values()
                for path in _outside_of_functions(tree, ())
                if _reads(path[-1], names)
                for target in _assigned_names(path)
            }
            if more <= names:
                break
            names |= more
        return [
            (file, _body_lines(node))
            for file, tree in self._trees.items()
            for node in ast.walk(tree)
            if isinstance(node, ast.FunctionDef) and _reads(node, names)
        ]

    def _in_order(self, tests: set[str]) -> list[str]:
        """File by file, since a file shares fixtures, those whose first test is shortest in front."""
        groups = defaultdict[str, list[str]](list)
        for test in sorted(tests, key=lambda test: self._seconds[test]):
            groups[test if "is_as_recorded[" in test else test.partition("::")[0]].append(test)
        return [test for group in groups.values() for test in group]


def _path_to(tree: ast.Module, line: int) -> list[ast.stmt]:
    """Statements that contain a line, the innermost last."""
    path: list[ast.stmt] = []
    inside = list(_statements_in(tree))
    while here := [node for node in inside if node.lineno <= line <= (node.end_lineno or node.lineno)]:
        path.append(here[0])
        inside = list(_statements_in(here[0]))
    return path


def _statements_in(node: ast.AST) -> Iterator[ast.stmt]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.stmt):
            yield child
        elif isinstance(child, (ast.ExceptHandler, ast.match_case)):
            yield from _statements_in(child)


def _own_lines(node: ast.stmt) -> range:
    """Lines of a statement without those of the statements in it."""
    first_inside = min((inner.lineno for inner in _statements_in(node)), default=(node.end_lineno or node.lineno) + 1)
    return range(node.lineno, max(first_inside, node.lineno + 1))


def _body_lines(node: ast.FunctionDef) -> range:
    return range(node.body[0].lineno, (node.end_lineno or node.lineno) + 1)


def _outside_of_functions(node: ast.AST, path: tuple[ast.stmt, ...]) -> Iterator[tuple[ast.stmt, ...]]:
    for child in _statements_in(node):
        if not isinstance(child, ast.FunctionDef):
            inner = list(_outside_of_functions(child, (*path, child)))
            yield from inner or [(*path, child)]


def _assigned_names(path: Sequence[ast.stmt]) -> set[str]:
    """Names that the innermost statement assigns to, and the class that it belongs to."""
    names = {node.name for node in path if isinstance(node, ast.ClassDef)}
    targets = getattr(path[-1], "targets", [getattr(path[-1], "target", None)]) if path else []
    return names | {node.id for target in targets if target for node in ast.walk(target) if isinstance(node, ast.Name)}


def _reads(tree: ast.AST, names: set[str]) -> bool:
    return any(
        (isinstance(node, ast.Name) and node.id in names) or (isinstance(node, ast.Attribute) and node.attr in names)
        for node in ast.walk(tree)
    )


def _reads_of_module(tree: ast.AST, module: str, names: set[str]) -> bool:
    """Whether a test reads one of the names from a module: imports it, or reads it as an attribute of the module."""
    aliases = {module}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            aliases |= {alias.asname for alias in node.names if alias.name == module and alias.asname}
            if (node.module or "").rpartition(".")[2] == module and any(alias.name in names for alias in node.names):
                return True
    return any(
        isinstance(node, ast.Attribute) and node.attr in names and getattr(node.value, "id", None) in aliases
        for node in ast.walk(tree)
    )
