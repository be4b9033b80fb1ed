"""Location of the data files of ``models/``: in the checkout, or inside the installed package."""

from functools import cache
from pathlib import Path


@cache
def models_dir() -> Path:
    """Folder ``models/`` (segment tables, marker sets, scenarios)."""
    package = Path(__file__).resolve().parent
    for candidate in (package / "models", package.parent.parent / "models"):
        if candidate.is_dir():
            return candidate
    raise FileNotFoundError(f"no models folder beside {package}; the installation is incomplete")
