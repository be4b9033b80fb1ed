"""The compose files as docker compose reads them: merged, with the defaults of their variables."""

import re
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).parents[3]
LAB = ROOT / "docker-compose.yml"
OBSERVED = ROOT / "compose.observability.yml"
OURS = "stridelab:latest"
_VARIABLE = re.compile(r"\$\{([A-Z_]+)(?::-([^}]*))?\}")


def compose(*files: Path) -> dict[str, Any]:
    """All files in one; a part that two of them define would have to be merged, and none is."""
    merged: dict[str, Any] = {}
    for file in files:
        text = _VARIABLE.sub(lambda found: found[2] or "", file.read_text(encoding="utf-8"))
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
