"""Imports go down the floors only, and nowhere in a circle."""

import ast
import re
from collections.abc import Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from support.docs.book import (
    BACKEND,
    FRONTEND,
    GROUND,
    NUMERIC,
    ROBOT_WING,
    ROOT,
    SCIENCE,
    STUDIES,
    WINGS,
    each_of,
    room_of,
    syntax_tree,
)

ALLOWED: dict[str, set[str]] = {room: set() for room in GROUND} | {"machine": {"machine", "errors"}}
for wing in (WINGS, ROBOT_WING):
    for floor, room in enumerate(wing):
        ALLOWED[room] = GROUND | set(wing[: floor + 1])
for floor, room in enumerate(STUDIES):
    ALLOWED[room] = SCIENCE | set(STUDIES[: floor + 1])
ALLOWED["schemas"] = {"schemas"}
ALLOWED["translations"] = {"schemas", "translations"}
ALLOWED["client"] = {"schemas", "client"}
ALLOWED["pipelines"] = NUMERIC | {"schemas", "translations", "pipelines"}
ALLOWED["service"] = NUMERIC | {"schemas", "client", "pipelines", "service"}
ALLOWED["cli"] = NUMERIC | {"schemas", "client", "pipelines", "service", "cli"}
ALLOWED["library"] = ALLOWED["service"] | {"library"}

WEB = {
    "fastapi",
    "starlette",
    "uvicorn",
    "viser",
    "sqlalchemy",
    "psycopg",
    "httpx",
    "typer",
    "rich",
    "plotly",
}
NUMERICS = {"numpy", "scipy", "pinocchio", "ezc3d", "casadi", "sklearn", "skimage"}


def imports(path: Path) -> list[str]:
    """Dotted names of all modules a file imports, wherever in the file the import stands."""
    names: list[str] = []
    for node in ast.walk(syntax_tree(path)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names += [node.module] if node.module != "stridelab" else [f"stridelab.{a.name}" for a in node.names]
    return names


@each_of(sorted(BACKEND.rglob("*.py")))
def test_imports_of_the_backend_go_down_the_floors(path: Path) -> None:
    room = room_of(path)
    if room == "__init__":
        return
    allowed = ALLOWED[room]
    for name in imports(path):
        top, _, rest = name.partition(".")
        target = rest.partition(".")[0]
        if top == "stridelab" and target and target != "__version__":
            assert target in allowed, f"{room} must not import {name}"
        if top == "stridelab_web":
            assert path == BACKEND / "service" / "web_mount.py", "only service/web_mount.py mounts the pages"
        if room in NUMERIC:
            assert top not in WEB, f"{room} is numeric and must not import {name}"
        if room in {"schemas", "client"}:
            assert top not in NUMERICS, f"{room} knows no numerics, but imports {name}"


@each_of(sorted(FRONTEND.rglob("*.py")))
def test_the_frontend_knows_the_backend_by_http_only(path: Path) -> None:
    for name in imports(path):
        top, _, rest = name.partition(".")
        if top == "stridelab":
            assert rest.partition(".")[0] in {"client", "schemas", "translations", "machine", "__version__"}, (
                f"the frontend must not import {name}"
            )


def test_every_room_has_a_floor() -> None:
    rooms = {room_of(path) for path in BACKEND.rglob("*.py")} - {"__init__"}
    assert rooms <= set(ALLOWED)


def imported_modules(package: Path) -> dict[str, set[str]]:
    """Modules of ``package`` by name, each with those that it imports, wherever in the file the import stands.

    Imports for type checkers alone do not count. A package's ``__init__`` goes by the package's name.
    """
    paths = {}
    for path in package.rglob("*.py"):
        parts = path.relative_to(package.parent).with_suffix("").parts
        paths[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return {name: _targets(syntax_tree(path), paths) - {name} for name, path in paths.items()}


def _targets(tree: ast.AST, known: Mapping[str, Path]) -> set[str]:
    targets: set[str] = set()
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        if isinstance(node, ast.Import):
            targets |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            inner = {f"{node.module}.{alias.name}" for alias in node.names}
            targets |= {name if name in known else node.module for name in inner}
        else:
            targets |= _targets(node, known)
    return targets & set(known)


def circle(modules: Mapping[str, set[str]]) -> list[str]:
    """Modules that import each other in a circle, the first one again at the end; none is best."""
    try:
        TopologicalSorter(modules).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


@pytest.mark.parametrize("package", [BACKEND, FRONTEND], ids=lambda path: path.name)
def test_no_modules_import_each_other_in_a_circle(package: Path) -> None:
    """Also not inside functions, where a circle would wait for a call."""
    assert circle(imported_modules(package)) == []


@pytest.mark.parametrize(
    ("grip", "members"),
    [
        ("import wheel.hub\n", {"wheel.hub", "wheel.spoke", "wheel.rim"}),
        ("if TYPE_CHECKING:\n    import wheel.hub\n", set()),
    ],
    ids=["import", "for type checkers"],
)
def test_a_circle_of_imports_is_detected(tmp_path: Path, grip: str, members: set[str]) -> None:
    package = tmp_path / "wheel"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "hub.py").write_text("from wheel import spoke\n")
    (package / "spoke.py").write_text("def turn():\n    from wheel.rim import GRIP\n")
    (package / "rim.py").write_text(f"{grip}GRIP = 1\n")
    assert set(circle(imported_modules(package))) == members


def test_contributing_lists_every_floor() -> None:
    text = " ".join((ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").split())
    for wing in (WINGS, ROBOT_WING):
        assert re.search(r"\b" + ", ".join(wing), text), f"CONTRIBUTING.md does not list {', '.join(wing)}"
