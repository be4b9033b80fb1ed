"""A person beside a group and before beside after, by hand."""

import math

import numpy as np
import pytest
from scipy.stats import t as student
from scipy.stats import ttest_ind

from stridelab.measures.measure import Measure
from stridelab.pipelines.gait_report.comparison import (
    change_between,
    compare_with_people,
    single_case_interval,
    welch_interval,
    z_interval,
)


def person(**means: float) -> list[Measure]:
    """One step of a person."""
    return recording(**{name: [mean] for name, mean in means.items()})


def recording(**values: list[float]) -> list[Measure]:
    return [Measure(name, value, None, "m") for name, given in values.items() for value in given]


def test_z_scores_have_people_as_units() -> None:
    group = [person(step_length=mean) for mean in (0.60, 0.70, 0.80)]
    (value,) = compare_with_people(person(step_length=0.55, cadence=100.0), group)
    assert (value.name, value.n_people) == ("step_length", 3)
    assert value.mean == pytest.approx(0.70)
    assert value.between_sd == pytest.approx(0.10)
    assert value.z == pytest.approx((0.55 - 0.70) / 0.10)


def test_one_person_gives_a_mean_without_z() -> None:
    (value,) = compare_with_people(person(step_length=0.55), [person(step_length=0.6), person(cadence=100.0)])
    assert (value.n_people, value.between_sd, value.z) == (1, None, None)


def test_a_group_without_scatter_gives_no_z() -> None:
    (value,) = compare_with_people(person(step_length=0.55), [person(step_length=0.6), person(step_length=0.6)])
    assert (value.between_sd, value.z) == (0.0, None)


def test_the_interval_is_that_of_welch() -> None:
    before, after = [1.0, 1.2, 1.1, 1.4], [1.5, 1.9, 1.4]
    interval = welch_interval(before, after)
    assert interval == pytest.approx(ttest_ind(after, before, equal_var=False).confidence_interval(0.95))


def test_a_single_case_is_tested_against_the_scatter_of_the_people() -> None:
    """Its interval touches zero where the t of Crawford and Howell, (x - m) / (s sqrt(1 + 1/n)), is Student's."""
    group = [1.0, 1.3, 1.1, 1.5, 1.2]
    quantile = float(student.ppf(0.975, 4))
    edge = float(np.mean(group)) + quantile * float(np.std(group, ddof=1)) * math.sqrt(1.2)
    interval = single_case_interval(edge, group)
    assert interval is not None
    assert interval[0] == pytest.approx(0.0, abs=1e-12)
    assert single_case_interval(1.0, [1.0]) is None
    assert single_case_interval(1.0, [1.0, 1.0]) is None


def test_the_interval_of_z_holds_the_score_among_all_people() -> None:
    """Of 400 groups of eight drawn from a population in which the person's score is -1.5, 95 % of the intervals do."""
    rng = np.random.default_rng(1)
    held = 0
    for _ in range(400):
        group = rng.normal(size=8)
        low, high = z_interval(float((-1.5 - group.mean()) / group.std(ddof=1)), 8)
        held += low <= -1.5 <= high
    assert 0.92 * 400 <= held <= 0.98 * 400


def clusters(rng: np.random.Generator, count: int, between: float, mean: float = 0.0) -> list[list[Measure]]:
    """Recordings of two to six steps whose levels differ by a deviation of ``between``; the steps differ by 1."""
    return [
        recording(step_length=(mean + rng.normal(0.0, between) + rng.normal(size=rng.integers(2, 7))).tolist())
        for _ in range(count)
    ]


@pytest.mark.parametrize("between", [0.0, 0.5, 2.0])
def test_the_interval_of_a_change_holds_the_true_change(between: float) -> None:
    rng = np.random.default_rng(2)
    held = 0
    for _ in range(150):
        (change,) = change_between(clusters(rng, 3, between), clusters(rng, 4, between, mean=1.0))
        assert change.ci95 is not None
        assert change.after - change.before == pytest.approx(change.change)
        held += change.ci95[0] <= 1.0 <= change.ci95[1]
    assert held >= 0.90 * 150


def test_a_person_of_the_group_is_unlike_it_in_five_percent() -> None:
    rng = np.random.default_rng(3)
    held = 0
    for _ in range(150):
        *people, own = clusters(rng, 9, 1.0)
        (value,) = compare_with_people(own, people)
        assert value.ci95 is not None
        held += value.ci95[0] <= 0.0 <= value.ci95[1]
    assert 0.90 * 150 <= held <= 0.985 * 150


def test_repeated_steps_narrow_the_interval_of_a_change() -> None:
    """Two recordings each: their means alone leave Student's quantile of few degrees of freedom."""
    rng = np.random.default_rng(4)
    narrower = 0
    for _ in range(60):
        before, after = clusters(rng, 2, 0.3), clusters(rng, 2, 0.3)
        (change,) = change_between(before, after)
        welch = welch_interval(
            *[[float(np.mean([m.value for m in one])) for one in group] for group in (before, after)]
        )
        assert change.ci95 is not None
        assert welch is not None
        narrower += change.ci95[1] - change.ci95[0] < welch[1] - welch[0]
    assert narrower > 40


def test_without_repeated_steps_the_means_are_compared() -> None:
    before, after = [1.0, 1.2, 1.1, 1.4], [1.5, 1.9, 1.4]
    (change,) = change_between([person(cadence=one) for one in before], [person(cadence=one) for one in after])
    assert change.ci95 == pytest.approx(welch_interval(before, after))
    (value,) = compare_with_people(person(cadence=2.0), [person(cadence=one) for one in before])
    assert value.ci95 == pytest.approx(single_case_interval(2.0, before))
    assert value.difference == pytest.approx(2.0 - 1.175)


@pytest.mark.parametrize(("before", "after"), [([1.0], [1.0, 2.0]), ([1.0, 2.0], [1.0]), ([1.0, 1.0], [2.0, 2.0])])
def test_without_two_recordings_each_there_is_no_interval(before: list[float], after: list[float]) -> None:
    assert welch_interval(before, after) is None


def test_a_recording_counts_once_in_a_change_however_many_steps_it_has() -> None:
    before = [recording(step_length=[0.5, 0.5, 0.5, 0.5]), recording(step_length=[0.7])]
    (change,) = change_between(before, [recording(step_length=[0.8, 0.9], cadence=[100.0])])
    assert (change.n_before, change.n_after, change.ci95) == (2, 1, None)
    assert change.before == pytest.approx(0.6)
    assert math.isclose(change.change, 0.85 - 0.6)
