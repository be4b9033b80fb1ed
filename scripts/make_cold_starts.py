#!/usr/bin/env python
"""Writes what docs/theory/cold-starts.md says: ``make_cold_starts.py [DRAWN HASTY PLACES]``, all it names as it comes.

The oracle is that of the tests.
"""

import json
import sys
from pathlib import Path

from experiments.cold_starts import (
    compare_with_oracle,
    moved_problems,
    random_problems,
    shortened_problems,
    summary_by_kind,
)

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.oracles.feasibility import motion_exists

numbers = [int(a) for a in sys.argv[1:4]] or [1000, 300, 12]
rows = []
for kind, problems in (
    ("drawn", random_problems(numbers[0])),
    ("hasty", shortened_problems(numbers[1])),
    ("moved", moved_problems(numbers[2])),
):
    for name, problem in problems:
        rows.append(compare_with_oracle(kind, name, problem, motion_exists))
        if not rows[-1].agrees_with_oracle:
            sys.stderr.write(f"{rows[-1]}\n")
sys.stdout.write(json.dumps(summary_by_kind(rows), indent=1) + "\n")
