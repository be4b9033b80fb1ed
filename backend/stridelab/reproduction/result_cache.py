"""What a result was computed by: a digest of a module, of all that it imports from here, and of the data they read.

A number that is kept under it stays as long as nothing that it depends on has changed, and no longer.

Results on disk, so that a long run goes on where it stopped: a JSON file per item, draws and digest of the code.
"""

import ast
import hashlib
import json
import os
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from stridelab.reproduction.claims import Claim, Reproduction
from stridelab.resources import models_dir

PACKAGE: Final = Path(__file__).parents[1]
DATA: Final = ("anthropometry.toml", "feasibility", "marker_sets", "reachability", "robots", "segment_tables")
"""What numbers are computed from, in ``models/``."""
DIGITS: Final = 16


def digest_of(module: str) -> str:
    """Of the source of ``module`` (dotted, of this package), of every module that it leads to, and of the data."""
    sources = hashlib.sha256(_of_data().encode())
    for name in sorted(led_to(module)):
        sources.update(name.encode() + b"\0" + _source(name))
    return sources.hexdigest()[:DIGITS]


def led_to(module: str) -> frozenset[str]:
    """``module`` and all modules of this package that its imports lead to, wherever in a file they stand."""
    found: set[str] = set()
    ahead = [module]
    while ahead:
        name = ahead.pop()
        if name not in found:
            found.add(name)
            ahead += _imports(name)
    return frozenset(found)


@cache
def _imports(module: str) -> tuple[str, ...]:
    """Modules of this package that one imports by name, or takes a name from."""
    names = []
    for node in ast.walk(ast.parse(_source(module))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return tuple(dict.fromkeys(name for name in names if _path(name) is not None))


@cache
def _source(module: str) -> bytes:
    path = _path(module)
    if path is None:
        raise ModuleNotFoundError(f"{module} is no module of {PACKAGE.name}")
    return path.read_bytes()


def _path(module: str) -> Path | None:
    first, *rest = module.split(".")
    if first != PACKAGE.name:
        return None
    place = PACKAGE.joinpath(*rest)
    candidates = (place.with_name(f"{place.name}.py"), place / "__init__.py")
    return next((path for path in candidates if path.is_file()), None)


@cache
def _of_data() -> str:
    read = hashlib.sha256()
    for name in DATA:
        place = models_dir() / name
        for path in [place] if place.is_file() else sorted(p for p in place.rglob("*") if p.is_file()):
            read.update(path.relative_to(models_dir()).as_posix().encode() + b"\0" + path.read_bytes())
    return read.hexdigest()


@dataclass(frozen=True)
class Kept:
    """A folder of results; ``digest`` is ``code_digest.digest_of`` the module that computes them."""

    folder: Path

    def load(self, name: str, seeds: int, digest: str) -> Reproduction | None:
        """What was kept, with the tables that were; None where there is nothing of this code and so many draws."""
        path = self._path(name, seeds, digest)
        if not path.is_file():
            return None
        return _read(json.loads(path.read_text(encoding="utf-8")))

    def save(self, name: str, seeds: int, digest: str, found: Reproduction, printed: tuple[str, ...]) -> None:
        """Keep a result with its ``printed`` tables, in the place of what other code found; whole or not at all."""
        path = self._path(name, seeds, digest)
        self.folder.mkdir(parents=True, exist_ok=True)
        part = path.with_name(f".part-{os.getpid()}-{path.name}")
        try:
            part.write_text(json.dumps(_written(found, printed)), encoding="utf-8")
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
        for other in self.folder.glob(f"{name}-{seeds}-*.json"):
            if other != path:
                other.unlink(missing_ok=True)

    def _path(self, name: str, seeds: int, digest: str) -> Path:
        return self.folder / f"{name}-{seeds}-{digest}.json"


def _written(found: Reproduction, printed: tuple[str, ...]) -> dict[str, Any]:
    return {
        "claims": [asdict(claim) for claim in found.claims],
        "note": found.note,
        "tables": {
            name: {column: values.tolist() for column, values in found.tables[name].items()} for name in printed
        },
        "drawing": found.drawing,
        "references": list(found.references),
    }


def _read(told: dict[str, Any]) -> Reproduction:
    return Reproduction(
        claims=tuple(Claim(**claim) for claim in told["claims"]),
        note=told["note"],
        tables={
            name: {column: np.array(values) for column, values in columns.items()}
            for name, columns in told["tables"].items()
        },
        drawing=told["drawing"],
        references=tuple(told["references"]),
    )
