"""The short form of ``make chaos``."""

import random

from support.faults.chaos import run


def test_jobs_under_random_kills_finish_exactly_once() -> None:
    random.seed(3)
    report = run(20, 3, work_s=0.1, pause_s=(1.5, 4.0), limit_s=240.0)
    assert report.startswith("20 jobs under 3 kills")
