"""Cache of reproduction results on disk: one JSON file per item, number of draws and digest of code and recordings.

The digest covers the module of an item, all modules of this package that it imports, the data files, and the
recordings from which an item on people is computed. A cached result is valid as long as none of these change.
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

from stridelab.machine.models_folder import models_dir
from stridelab.reproduction.claims import Claim, Reproduction

PACKAGE: Final = Path(__file__).parents[1]
DATA: Final = ("anthropometry.toml", "feasibility", "marker_sets", "reachability", "robots", "segment_tables")
"""Entries of ``models/`` that results depend on."""
DIGITS: Final = 16


def digest_of(module: str) -> str:
    """Digest of the source of ``module`` (dotted name), of its transitive imports in this package, and of the data."""
    sources = hashlib.sha256(_data_digest().encode())
    for name in sorted(transitive_imports(module)):
        sources.update(name.encode() + b"\0" + _module_source(name))
    return sources.hexdigest()[:DIGITS]


def digest_of_recordings(gait: Path) -> str:
    """Digest of the names, sizes and times of change of all files below a folder, links followed."""
    files = hashlib.sha256()
    for folder, _, names in sorted(os.walk(gait, followlinks=True)):
        for name in sorted(names):
            path = Path(folder, name)
            if path.is_file():
                stat = path.stat()
                files.update(f"{path.relative_to(gait).as_posix()}\0{stat.st_size}\0{stat.st_mtime_ns}\n".encode())
    return files.hexdigest()[:DIGITS]


def transitive_imports(module: str) -> frozenset[str]:
    """``module`` and its transitive imports in this package, including imports inside functions."""
    visited: set[str] = set()
    pending = [module]
    while pending:
        name = pending.pop()
        if name not in visited:
            visited.add(name)
            pending += _direct_imports(name)
    return frozenset(visited)


@cache
def _direct_imports(module: str) -> tuple[str, ...]:
    """Modules of this package that ``module`` imports directly."""
    names = []
    for node in ast.walk(ast.parse(_module_source(module))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return tuple(dict.fromkeys(name for name in names if _module_path(name) is not None))


@cache
def _module_source(module: str) -> bytes:
    path = _module_path(module)
    if path is None:
        raise ModuleNotFoundError(f"{module} is not a module of {PACKAGE.name}")
    return path.read_bytes()


def _module_path(module: str) -> Path | None:
    first, *rest = module.split(".")
    if first != PACKAGE.name:
        return None
    place = PACKAGE.joinpath(*rest)
    candidates = (place.with_name(f"{place.name}.py"), place / "__init__.py")
    return next((path for path in candidates if path.is_file()), None)


@cache
def _data_digest() -> str:
    digest = hashlib.sha256()
    for name in DATA:
        place = models_dir() / name
        for path in [place] if place.is_file() else sorted(p for p in place.rglob("*") if p.is_file()):
            digest.update(path.relative_to(models_dir()).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


@dataclass(frozen=True)
class ResultCache:
    """Folder of cached results; ``digest`` is ``digest_of`` the module that computes them."""

    folder: Path

    def load_result(self, name: str, seeds: range, digest: str) -> Reproduction | None:
        """The cached result with its saved tables; None if there is none for this number of draws and digest."""
        path = self._result_path(name, seeds, digest)
        if not path.is_file():
            return None
        return _parse_result(json.loads(path.read_text(encoding="utf-8")))

    def save_result(self, name: str, seeds: range, digest: str, result: Reproduction, printed: tuple[str, ...]) -> None:
        """Save a result with its ``printed`` tables atomically, and delete results with other digests."""
        path = self._result_path(name, seeds, digest)
        self.folder.mkdir(parents=True, exist_ok=True)
        part = path.with_name(f".part-{os.getpid()}-{path.name}")
        try:
            part.write_text(json.dumps(_result_document(result, printed)), encoding="utf-8")
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
        for other in self.folder.glob(f"{name}-{_draws(seeds)}-*.json"):
            if other != path:
                other.unlink(missing_ok=True)

    def _result_path(self, name: str, seeds: range, digest: str) -> Path:
        return self.folder / f"{name}-{_draws(seeds)}-{digest}.json"


def _draws(seeds: range) -> str:
    """Number of draws, and the first seed unless it is 0."""
    return f"{len(seeds)}" if seeds[0] == 0 else f"{len(seeds)}from{seeds[0]}"


def _result_document(result: Reproduction, printed: tuple[str, ...]) -> dict[str, Any]:
    return {
        "claims": [asdict(claim) for claim in result.claims],
        "note": result.note,
        "tables": {
            name: {column: values.tolist() for column, values in result.tables[name].items()} for name in printed
        },
        "drawing": result.drawing,
        "references": list(result.references),
    }


def _parse_result(document: dict[str, Any]) -> Reproduction:
    return Reproduction(
        claims=tuple(
            Claim(**claim | {"interval": claim["interval"] and tuple(claim["interval"])})
            for claim in document["claims"]
        ),
        note=document["note"],
        tables={
            name: {column: np.array(values) for column, values in columns.items()}
            for name, columns in document["tables"].items()
        },
        drawing=document["drawing"],
        references=tuple(document["references"]),
    )
