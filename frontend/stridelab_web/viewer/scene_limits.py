"""Limits on the number of open scenes: in total, as memory allows, and per user.

A scene of TALOS with its densities holds 8 to 11 MB of the viewer process, one of a scenario 1 to 4 MB, each with one
thread and four open files (docs/viewer.md).
"""

import os
import resource
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

SCENE_MB: Final = 12
"""Memory counted per scene: that of the largest measured scene, with the buffers of a connected browser."""
MEMORY_SHARE: Final = 0.1
"""Share of the memory that scenes may take."""
MIN_SCENES, MAX_SCENES = 8, 200
USER_SCENES: Final = 16
FILES_PER_SCENE: Final = 6
"""Four of its server, and two watchers on average."""
FILES_WANTED: Final = 4096
OTHER_FILES: Final = 100
_GROUPS: Final = Path("/sys/fs/cgroup")
_OWN: Final = Path("/proc/self/cgroup")


@dataclass(frozen=True)
class SceneLimits:
    """Scenes that may be open in all, and those of one user; ``per_user`` 0 is no limit of its own."""

    total: int
    per_user: int = 0


class ScenesInUse(Exception):
    """Raised if the limit ``of`` a user or of the total is reached and all scenes concerned are watched."""

    def __init__(self, of: Literal["user", "total"], limit: int) -> None:
        self.status, self.code = (429, "scene-limit") if of == "user" else (503, "scenes-full")
        if of == "user":
            detail = (
                f"You have {limit} 3D views open in browsers, and that is the limit for one user "
                "(STRIDELAB_USER_SCENES). Close one of those tabs, then load this page again."
            )
        else:
            detail = (
                f"All {limit} 3D scenes that this service may hold are open in browsers (STRIDELAB_VIEWER_SCENES). "
                "Close a tab with a 3D view, or wait until another user has closed one, then load this page again."
            )
        super().__init__(detail)


def limits_of(environment: Mapping[str, str]) -> SceneLimits:
    """The limits of ``STRIDELAB_VIEWER_SCENES`` and ``STRIDELAB_USER_SCENES``, else the defaults.

    Raises ``ValueError`` for text that is no whole number, a total below 1, or a limit below 0.
    """
    total = int(environment.get("STRIDELAB_VIEWER_SCENES") or scenes_that_fit(memory_bytes(), open_files()))
    per_user = int(environment.get("STRIDELAB_USER_SCENES") or USER_SCENES)
    if total < 1 or per_user < 0:
        raise ValueError("STRIDELAB_VIEWER_SCENES must be at least 1, and STRIDELAB_USER_SCENES at least 0")
    return SceneLimits(total, per_user)


def scenes_that_fit(memory: float, files: int) -> int:
    """Number of scenes for ``memory`` bytes and ``files`` open files, within fixed bounds."""
    by_memory = int(MEMORY_SHARE * memory / (SCENE_MB << 20))
    by_files = (files - OTHER_FILES) // FILES_PER_SCENE
    return max(MIN_SCENES, min(MAX_SCENES, by_memory, by_files))


def memory_bytes(groups: Path = _GROUPS, own: Path = _OWN) -> int:
    """Memory that this process may use: that of the machine, or the strictest limit of its control groups."""
    machine = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return min([machine, *_group_limits(groups, own)])


def open_files() -> int:
    """Number of files that this process may have open; raises its soft limit towards ``FILES_WANTED`` first."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    ceiling = FILES_WANTED if hard == resource.RLIM_INFINITY else min(hard, FILES_WANTED)
    if soft == resource.RLIM_INFINITY or soft >= ceiling:
        return FILES_WANTED if soft == resource.RLIM_INFINITY else soft
    resource.setrlimit(resource.RLIMIT_NOFILE, (ceiling, hard))
    return ceiling


def _group_limits(groups: Path, own: Path) -> Iterator[int]:
    """``memory.max`` of the process's group and of those above it; of version 1, ``memory.limit_in_bytes``."""
    for line in _read_text(own).splitlines():
        _, _, rest = line.partition(":")
        controllers, _, name = rest.partition(":")
        parts = [part for part in name.split("/") if part not in {"", ".."}]
        for depth in range(len(parts) + 1):
            if not controllers:
                text = _read_text(groups.joinpath(*parts[:depth]) / "memory.max")
            elif "memory" in controllers.split(","):
                text = _read_text((groups / "memory").joinpath(*parts[:depth]) / "memory.limit_in_bytes")
            else:
                continue
            if text.strip().isdecimal():
                yield int(text)


def _read_text(file: Path) -> str:
    try:
        return file.read_text(encoding="ascii")
    except (OSError, UnicodeDecodeError):
        return ""
