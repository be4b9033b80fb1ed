"""Imports go down the floors only."""

import ast
from pathlib import Path

import pytest

from support.floors import BACKEND, FRONTEND, GROUND, NUMERIC, ROBOT_WING, WINGS, room_of

ALLOWED: dict[str, set[str]] = {room: set() for room in GROUND}
for wing in (WINGS, ROBOT_WING):
    for floor, room in enumerate(wing):
        ALLOWED[room] = GROUND | set(wing[: floor + 1])
ALLOWED["experiments"] = NUMERIC
ALLOWED["schemas"] = {"schemas"}
ALLOWED["client"] = {"schemas", "client"}
ALLOWED["service"] = NUMERIC | {"schemas", "client", "service"}
ALLOWED["cli"] = NUMERIC | {"schemas", "client", "service", "cli"}

WEB = {
    "fastapi",
    "starlette",
    "uvicorn",
    "viser",
    "sqlalchemy",
    "procrastinate",
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
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names += [node.module] if node.module != "stridelab" else [f"stridelab.{a.name}" for a in node.names]
    return names


@pytest.mark.parametrize("path", sorted(BACKEND.rglob("*.py")), ids=lambda p: str(p.relative_to(BACKEND)))
def test_imports_of_the_backend_go_down_the_floors(path: Path) -> None:
    room = room_of(path)
    if room == "__init__":
        return
    allowed = ALLOWED[room]
    for name in imports(path):
        top, _, rest = name.partition(".")
        target = rest.partition(".")[0]
        if top == "stridelab" and target and target != "__version__":
            assert ("cli" if target.startswith("cli") else target) in allowed, f"{room} must not import {name}"
        if top == "stridelab_web":
            assert path == BACKEND / "service" / "front.py", "only service/front.py mounts the pages"
        if room in NUMERIC:
            assert top not in WEB, f"{room} is numeric and must not import {name}"
        if room in {"schemas", "client"}:
            assert top not in NUMERICS, f"{room} knows no numerics, but imports {name}"


@pytest.mark.parametrize("path", sorted(FRONTEND.rglob("*.py")), ids=lambda p: str(p.relative_to(FRONTEND)))
def test_the_frontend_knows_the_backend_by_http_only(path: Path) -> None:
    for name in imports(path):
        top, _, rest = name.partition(".")
        if top == "stridelab":
            assert rest.partition(".")[0] in {"client", "schemas", "__version__"}, (
                f"the frontend must not import {name}"
            )


def test_every_room_has_a_floor() -> None:
    rooms = {room_of(path) for path in BACKEND.rglob("*.py")} - {"__init__"}
    assert rooms <= set(ALLOWED)
