"""A sample of the 20 000 schedules of two jobs, two workers and one fault (``scripts/chaos --pairs all``)."""

from functools import partial
from itertools import product
from pathlib import Path

from support.faults.commits import FAULTS, SIGNALS, run_all
from support.faults.pair_schedules import COMMITS, DELAYS_S, KINDS, LATER_S, NUMBERS, PairSchedule, run_numbered_pair
from support.service.database import TestDatabases
from support.service.processes import WorkerForks

SAMPLE = 6
ALWAYS = (("stop-half-way", "stop-half-way"), 2, "cut after", "SIGKILL", 6.0, 0.7)
"""Schedule 17."""


def test_the_numbers_are_all_combinations_and_a_range_is_a_sample() -> None:
    every = [PairSchedule.of_number(number) for number in range(NUMBERS)]
    assert NUMBERS == 20_000 == len(set(every))
    first = every[:200]
    assert {s.commit for s in first} == set(COMMITS)
    assert {(s.fault, s.signal) for s in first} == set(product(FAULTS, SIGNALS))
    assert {s.kinds for s in first} == set(KINDS)
    assert {(s.delay_s, s.later_s) for s in first} == set(product(DELAYS_S, LATER_S))
    assert every[17] == PairSchedule(*ALWAYS), "a number means the same for ever"


def test_two_jobs_end_once_whatever_one_commit_meets(postgres: TestDatabases, tmp_path: Path) -> None:
    said: list[str] = []
    with WorkerForks() as forks:
        run_one = partial(run_numbered_pair, forks=forks)
        failed = run_all(range(SAMPLE), postgres, tmp_path, at_once=SAMPLE, say=said.append, run_one=run_one)
    assert not failed, "\n".join(said)
    assert sum("struck" in line for line in said) >= SAMPLE // 2, said
