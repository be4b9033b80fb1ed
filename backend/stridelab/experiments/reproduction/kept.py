"""Results on disk, so that a long run goes on where it stopped: a JSON file per item, draws and digest of the code."""

import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stridelab.experiments.reproduction.item import Claim, Reproduction


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
