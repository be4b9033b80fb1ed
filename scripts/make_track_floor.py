"""The least error on the tracks of real walks with errors of default size, as a table on standard output.

make_track_floor.py GAIT [CLOCK]   GAIT: folder of recordings; the covariance of a walk is that of the other people.
CLOCK: shared (default), moments or exact, see ``experiments.track_floor``
"""

import sys
from pathlib import Path
from typing import get_args

import numpy as np

from experiments.real_tracks import ExactWalk, exact_walk
from experiments.track_floor import Clock, acceleration_covariance, least_error
from make_real_tracks import CASES
from stridelab.reproduction.chapter2.table_real_walks import GROUPS
from stridelab.reproduction.common.recorded_walks import recordings_in


def main() -> None:
    """Print the horizontal RMS error of every case, and the standard deviation of the latency."""
    clock = next((one for one in get_args(Clock) if one in sys.argv[2:]), "shared")
    paths = [path for pattern in GROUPS.values() for path in recordings_in(Path(sys.argv[1]), pattern)]
    walks = {path: exact_walk(path) for path in paths}
    covariances = {path: acceleration_covariance(_of_others(walks, path), len(walks[path].time_s)) for path in paths}
    header = ("markers", "force", "errors", "least error", "along", "lateral", "latency, ms")
    sys.stdout.write(f"| {' | '.join(header)} |\n" + "| --- " * len(header) + "|\n")
    for case in CASES:
        floors = [least_error(walks[path], case, covariances[path], clock) for path in paths]
        along, lateral = 1e3 * np.sqrt(np.mean([floor.square_m2 for floor in floors], axis=0))
        known_ms = 1e3 * np.sqrt(np.mean([floor.clock_sd_s**2 for floor in floors]))
        force, errors = "whole walk" if case.whole else "plates", "rolling" if case.rolls else "default"
        values = " | ".join(f"{value:.1f}" for value in (np.hypot(along, lateral), along, lateral, known_ms))
        sys.stdout.write(f"| {case.markers} | {force} | {errors} | {values} |\n")
        sys.stdout.flush()


def _of_others(walks: dict[Path, ExactWalk], path: Path) -> list[ExactWalk]:
    """Walks of other people, whose folders are others."""
    return [walk for other, walk in walks.items() if other.parent != path.parent]


if __name__ == "__main__":
    main()
