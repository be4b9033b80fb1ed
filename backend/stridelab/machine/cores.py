"""Number of processor cores that the processes of this program may use.

    cores = min(affinity, quota of the control groups), divided among the jobs of a worker

``os.cpu_count`` is not used where a better source exists: a container, a systemd unit or a cluster allocation
provides fewer cores than the machine has.
"""

import math
import os
from pathlib import Path
from typing import Final

SINGLE_THREADED: Final = {
    f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "NUMEXPR", "VECLIB", "BLIS")
} | {"JE_ARROW_MALLOC_CONF": "background_thread:false"}
"""Environment in which libraries start no thread at import: a process with threads is neither forked safely nor
confined. The last is Arrow's allocator."""
_GROUPS: Final = Path("/sys/fs/cgroup")
_OWN: Final = Path("/proc/self/cgroup")
_V1_FOLDERS: Final = ("cpu", "cpu,cpuacct")
_limit: int | None = None


def usable_cores(groups: Path = _GROUPS, own: Path = _OWN) -> int:
    """Cores that this process and what it starts may use together: at least one.

    The smallest of the processor affinity, the quota of its control groups (``cpu.max``, or ``cpu.cfs_quota_us`` of
    version 1; whole cores, rounded down) and the limit of ``limit_cores``.
    """
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    limit = math.inf if _limit is None else _limit
    return max(1, math.floor(min(available, _cgroup_quota_cores(groups, own), limit)))


def default_slots() -> int:
    """Default number of concurrent jobs of a worker: all usable cores but one."""
    return max(1, usable_cores() - 1)


def cores_per_slot(slots: int) -> int:
    """Number of cores that each of ``slots`` concurrent jobs may use: at least one."""
    return max(1, usable_cores() // slots)


def limit_cores(cores: int | None) -> None:
    """Limit this process and its forked children to ``cores`` cores; None removes the limit."""
    global _limit
    _limit = cores


def _cgroup_quota_cores(groups: Path, own: Path) -> float:
    """Cores (with a fraction) that the strictest of the process's control groups allows; infinite without a quota."""
    quotas = [math.inf]
    for line in _file_lines(own):
        _, _, rest = line.partition(":")
        controllers, _, name = rest.partition(":")
        if not controllers:
            quotas += [_quota_over_period(*_file_words(folder / "cpu.max")) for folder in _with_parents(groups, name)]
        elif "cpu" in controllers.split(","):
            quotas += [
                _quota_over_period(
                    *_file_words(folder / "cpu.cfs_quota_us"), *_file_words(folder / "cpu.cfs_period_us")
                )
                for hierarchy in _V1_FOLDERS
                for folder in _with_parents(groups / hierarchy, name)
            ]
    return min(quotas)


def _with_parents(hierarchy: Path, name: str) -> list[Path]:
    """Folder of a control group and of all its parents."""
    parts = [part for part in name.split("/") if part not in {"", ".."}]
    return [hierarchy.joinpath(*parts[:depth]) for depth in range(len(parts) + 1)]


def _quota_over_period(*words: str) -> float:
    """``quota / period``; infinite without a quota (``max``, -1, or no file)."""
    try:
        quota, period = (int(word) for word in words)
    except ValueError:
        return math.inf
    return quota / period if quota > 0 and period > 0 else math.inf


def _file_words(file: Path) -> list[str]:
    return [word for line in _file_lines(file) for word in line.split()]


def _file_lines(file: Path) -> list[str]:
    try:
        return file.read_text(encoding="ascii").splitlines()
    except (OSError, UnicodeDecodeError):
        return []
