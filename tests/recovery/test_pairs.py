"""A sample of the 20 000 schedules of two jobs, two workers and one fault (``scripts/chaos --pairs all``)."""

from itertools import product
from pathlib import Path

from support.faults.commit_proxy import FAULTS
from support.faults.commit_schedules import SIGNALS, run_all
from support.faults.pair_schedules import COMMITS, DELAYS_S, KINDS, LATER_S, NUMBERS, PairSchedule, run_numbered_pair
from support.service.database import TestDatabases

SAMPLE = 6


def test_the_numbers_are_all_combinations_and_neighbours_differ() -> None:
    every = [PairSchedule.of_number(number) for number in range(NUMBERS)]
    assert NUMBERS == 20_000 == len(set(every))
    for values in zip(*((s.kinds, s.commit, s.fault, s.signal, s.delay_s, s.later_s) for s in every[:60]), strict=True):
        assert len(set(values)) > 1
    assert {s.commit for s in every[:60]} == set(COMMITS)
    assert {(s.kinds, s.fault, s.signal) for s in every[:2000]} == set(product(KINDS, FAULTS, SIGNALS))
    assert {(s.delay_s, s.later_s) for s in every[:200]} == set(product(DELAYS_S, LATER_S))


def test_two_jobs_end_once_whatever_one_commit_meets(postgres: TestDatabases, tmp_path: Path) -> None:
    said: list[str] = []
    failed = run_all(range(SAMPLE), postgres, tmp_path, at_once=SAMPLE, say=said.append, run_one=run_numbered_pair)
    assert not failed, "\n".join(said)
    assert sum("struck" in line for line in said) >= SAMPLE // 2, said
