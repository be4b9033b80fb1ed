#!/usr/bin/env python
"""Writes what docs/theory/wrench-cones.md says of random contact sets: ``make_cone_validation.py [SETS POINTS]``."""

import json
import sys

from stridelab.reproduction.studies.cone_validation import check_cones, check_summary

sets, points = map(int, sys.argv[1:3] or ("500", "100"))
sys.stdout.write(json.dumps(dict(check_summary(check_cones(sets, points))), indent=1) + "\n")
