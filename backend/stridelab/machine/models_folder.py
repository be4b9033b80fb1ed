"""Location of the data files of ``models/``: in the checkout, or inside the installed package.

Robots of users lie in further folders of the same layout (``robots``, ``reachability``), which a process adds.
"""

import os
from functools import cache
from pathlib import Path
from typing import Final

ROBOTS_VARIABLE: Final = "STRIDELAB_ROBOTS"
"""Environment variable with a folder of robots of one's own, for commands; ``stridelab add-robot`` writes it."""
_added_folders: list[Path] = []


@cache
def models_dir() -> Path:
    """Folder ``models/`` (segment tables, marker sets, scenarios)."""
    package = Path(__file__).resolve().parents[1]
    for candidate in (package / "models", package.parent.parent / "models"):
        if candidate.is_dir():
            return candidate
    raise FileNotFoundError(f"no models folder beside {package}; the installation is incomplete")


def add_models_folder(folder: Path) -> None:
    """Make the robots in ``folder`` known to this process; a bundled robot of the same name takes precedence."""
    if folder not in _added_folders:
        _added_folders.append(folder)


def robot_folders(bundled: Path) -> tuple[Path, ...]:
    """``bundled``, the folders added by ``add_models_folder``, and that of ``STRIDELAB_ROBOTS``."""
    own = os.environ.get(ROBOTS_VARIABLE)
    return (bundled, *_added_folders, *([Path(own)] if own else []))


def robot_file(bundled: Path, *parts: str) -> Path:
    """The file ``parts`` in the first of ``robot_folders`` that has it; its path in ``bundled`` if none has."""
    paths = [folder.joinpath(*parts) for folder in robot_folders(bundled)]
    return next((path for path in paths if path.exists()), paths[0])
