"""Limit of open files and connections of this process."""

import resource
from typing import Final

MAX_OPEN_FILES: Final = 65_536


def raise_limit() -> int:
    """Raise the soft limit of open files as far as the system allows, at most to ``MAX_OPEN_FILES``; returns it."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MAX_OPEN_FILES if hard == resource.RLIM_INFINITY else min(hard, MAX_OPEN_FILES)
    if soft == resource.RLIM_INFINITY or soft >= wanted:
        return MAX_OPEN_FILES if soft == resource.RLIM_INFINITY else soft
    resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
    return wanted
