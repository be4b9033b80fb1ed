#!/usr/bin/env python
"""Writes what docs/theory/cold-starts.md says: ``make_cold_starts.py [DRAWN HASTY PLACES]``, all it names as it comes.

The oracle is that of the tests.
"""

import json
import sys
from pathlib import Path

from stridelab.studies.cold_starts import attempt, drawn, hasty, moved, summary

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.oracles.conic_feasibility import exists

numbers = [int(a) for a in sys.argv[1:4]] or [1000, 300, 12]
found = []
for kind, problems in (("drawn", drawn(numbers[0])), ("hasty", hasty(numbers[1])), ("moved", moved(numbers[2]))):
    for name, problem in problems:
        found.append(attempt(kind, name, problem, exists))
        if not found[-1].agrees:
            sys.stderr.write(f"{found[-1]}\n")
sys.stdout.write(json.dumps(summary(found), indent=1) + "\n")
