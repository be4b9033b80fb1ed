#!/usr/bin/env python
"""Writes what docs/theory/centroidal-variations.md says of random variations: ``make_centroidal_variations.py [N]``.

Every variation that did not converge is named with its reason as it comes.
"""

import json
import sys

from experiments.centroidal_variations import (
    Outcome,
    count_faults,
    outcome_summary,
    random_variations,
    solve_variations,
)


def tell(outcome: Outcome) -> None:
    """Report the variations that did not converge."""
    if outcome.ending != "converged":
        sys.stderr.write(f"{outcome.ending}: {outcome.variation}: {outcome.reason}\n")


number = int(sys.argv[1]) if len(sys.argv) > 1 else 300
solutions = solve_variations(random_variations(number), tell)
sys.stdout.write(json.dumps({**outcome_summary(solutions), "refusals": dict(count_faults(solutions))}, indent=1) + "\n")
