"""Errors of the estimators on the tracks of real walks with errors of default size, as a table on standard output.

make_real_tracks.py GAIT ROWS [SEEDS] [compared]   GAIT: folder of recordings; ROWS: file of finished walks, from which
a later run continues; SEEDS draws of the errors for each walk and case (default 8); compared: the clocks are compared
before, as in recordings, for all estimators
"""

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np

from experiments.real_tracks import ESTIMATORS, Markers, TrackErrors, compare_clocks, draw_inputs, exact_walk
from stridelab.errors import StridelabError
from stridelab.reproduction.chapter2.table_real_walks import GROUPS
from stridelab.reproduction.common.recorded_walks import recordings_in

MARKERS: Final[Sequence[Markers]] = ("white", "filtered")
CASES: Final = tuple(
    TrackErrors(markers=markers, whole=whole, rolls=rolls)
    for rolls in (False, True)
    for whole in (True, False)
    for markers in MARKERS
)


def main() -> None:
    """Score what is missing, and print the table."""
    gait, rows = Path(sys.argv[1]), Path(sys.argv[2])
    seeds = next((int(one) for one in sys.argv[3:] if one.isdigit()), 8)
    compared = "compared" in sys.argv[3:]
    lines = [json.loads(line) for line in rows.read_text().splitlines()] if rows.exists() else []
    finished = {line["walk"] for line in lines}
    with rows.open("a") as out:
        for path in (path for pattern in GROUPS.values() for path in recordings_in(gait, pattern)):
            if path.name not in finished:
                lines += [{"walk": path.name, **row} for row in _score_walk(path, seeds, compared)]
                out.writelines(json.dumps(line) + "\n" for line in lines if line["walk"] == path.name)
                out.flush()
    header = ["markers", "force", "errors", "n", *ESTIMATORS, "smoother / thesis, complementary", "band"]
    table = ["| " + " | ".join(header) + " |", "| --- " * len(header) + "|"]
    table += [_table_row(case, [line for line in lines if asdict(case).items() <= line.items()]) for case in CASES]
    sys.stdout.write("\n".join(table) + "\n")


def _score_walk(path: Path, seeds: int, compared: bool) -> Iterator[dict[str, object]]:
    """Mean squares of the horizontal error and the coverage of the smoother's band; None where one refuses."""
    walk = exact_walk(path)
    for number, case in enumerate(CASES):
        for seed in range(seeds):
            rng = np.random.default_rng([seed, number, *path.name.encode()])
            geometric, wrench, mass_kg = draw_inputs(walk, case, rng)
            squares_m2: dict[str, float] = {}
            covered = None
            try:
                wrench = compare_clocks(geometric, wrench, mass_kg) if compared else wrench
                for name, estimator in ESTIMATORS.items():
                    estimate = estimator.estimate(geometric, wrench, mass_kg)
                    error = (estimate.com_m - walk.com_m[np.searchsorted(walk.time_s, estimate.time_s - 1e-9)])[:, :2]
                    squares_m2[name] = float(np.mean(error**2, axis=0).sum())
                    covered = np.mean(np.abs(error) < 1.96 * estimate.sd_m[:, :2], axis=0).tolist()
            except StridelabError as refusal:
                yield {**asdict(case), "seed": seed, "refused": refusal.code}
                continue
            yield {**asdict(case), "seed": seed, "squares_m2": squares_m2, "covered": covered}


def _table_row(case: TrackErrors, lines: Sequence[Mapping[str, Any]]) -> str:
    scored = [line for line in lines if "squares_m2" in line]
    rms_mm = {name: 1e3 * np.sqrt(np.mean([line["squares_m2"][name] for line in scored])) for name in ESTIMATORS}
    covered = 100.0 * np.mean([line["covered"] for line in scored], axis=0)
    errors = "and of rolling feet, segments that turn" if case.rolls else "default"
    cells = [
        case.markers,
        "whole walk" if case.whole else "plates",
        errors,
        f"{len(scored)} of {len(lines)}",
        *(f"{value:.1f}" for value in rms_mm.values()),
        f"{rms_mm['smoother'] / rms_mm['thesis']:.2f}, {rms_mm['smoother'] / rms_mm['complementary']:.2f}",
        " / ".join(f"{value:.0f}" for value in covered),
    ]
    return "| " + " | ".join(cells) + " |"


if __name__ == "__main__":
    main()
