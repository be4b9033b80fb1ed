"""Gaps of the force over which its acceleration is interpolated, and those over which it is not."""

import numpy as np
import pytest

from stridelab.conventions import Mask
from stridelab.estimation.smoother.measurements import Walk, short_gaps

WEIGHT_N = 700.0
RATE_HZ = 100.0


def walk_of(vertical_n: np.ndarray, seen: Mask) -> Walk:
    n = len(vertical_n)
    force = np.column_stack([np.zeros((n, 2)), vertical_n])
    still = np.zeros(3)
    return Walk(np.eye(3), np.zeros((n, 3)), force, np.zeros((n, 3)), seen, RATE_HZ, still, still)


def bridged_of(vertical_n: np.ndarray, first: int, stop: int) -> list[int]:
    seen = np.ones(len(vertical_n), bool)
    seen[first:stop] = False
    return np.flatnonzero(short_gaps(walk_of(vertical_n, seen), WEIGHT_N)).tolist()


def test_a_gap_of_a_fifth_of_a_second_is_bridged_from_the_last_sample_before_to_the_first_behind() -> None:
    force = np.full(80, WEIGHT_N)
    assert bridged_of(force, 30, 50) == list(range(29, 50))
    assert bridged_of(force, 30, 51) == []


@pytest.mark.parametrize(("first", "stop"), [(0, 10), (70, 80)])
def test_a_gap_at_an_end_has_one_side_only(first: int, stop: int) -> None:
    assert bridged_of(np.full(80, WEIGHT_N), first, stop) == []


def test_a_flight_between_two_contacts_is_bridged_and_a_contact_between_two_flights_is_not() -> None:
    flight = np.full(80, 1000.0)
    flight[25:30] = [400.0, 250.0, 130.0, 60.0, 25.0]
    flight[40:43] = [25.0, 150.0, 500.0]
    assert bridged_of(flight, 30, 40) == list(range(29, 40))
    contact = np.zeros(80)
    contact[30:45] = 1500.0
    assert bridged_of(contact, 30, 45) == []


def test_where_the_force_changes_fast_at_both_ends_it_is_not_known_there() -> None:
    coarse = np.full(80, 1500.0)
    coarse[28:30] = [900.0, 500.0]
    coarse[40:42] = [400.0, 1100.0]
    assert bridged_of(coarse, 30, 40) == []
    coarse[28:30] = [600.0, 500.0]
    assert bridged_of(coarse, 30, 40) == list(range(29, 40))
