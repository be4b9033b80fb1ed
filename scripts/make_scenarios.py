"""Write models/scenarios: the scenarios that every installation brings with it, from their builders.

Usage: make_scenarios.py [FOLDER]
"""

import json
import re
import sys
from pathlib import Path
from typing import Any

from experiments.bundled_scenarios import BUNDLED
from stridelab.machine.models_folder import models_dir

NUMBERS = re.compile(r"\[\s+([-+\d.e,\s]+?)\s+\]")
"""A list of numbers that was spread over lines."""


def text(scenario: dict[str, Any]) -> str:
    """JSON with every vector on one line."""
    spread = json.dumps(scenario, indent=2, ensure_ascii=False, allow_nan=False)
    return NUMBERS.sub(lambda match: "[" + re.sub(r"\s+", " ", match[1]) + "]", spread) + "\n"


def make_scenarios(folder: Path) -> None:
    """One file per builder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, build in BUNDLED.items():
        (folder / f"{name}.json").write_text(text(build()), encoding="utf-8")


if __name__ == "__main__":
    make_scenarios(Path(sys.argv[1]) if len(sys.argv) > 1 else models_dir() / "scenarios")
