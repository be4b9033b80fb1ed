"""A person beside a group and before beside after, by hand."""

import math

import pytest
from scipy.stats import ttest_ind

from stridelab.measures.measure import Measure
from stridelab.pipelines.gait_report.comparison import change_between, compare_with_people, welch_interval
from stridelab.schemas.measures import GaitMeasuresSummary, MeasureValue
from support.fakes.measures import summary


def person(**means: float) -> GaitMeasuresSummary:
    values = [
        MeasureValue(name=name, unit="m", side=side, n=3, mean=mean, between_sd=None, error_sd=None, ci95=None)
        for name, mean in means.items()
        for side in (None, "left")
    ]
    return summary().model_copy(update={"measures": values})


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


@pytest.mark.parametrize(("before", "after"), [([1.0], [1.0, 2.0]), ([1.0, 2.0], [1.0]), ([1.0, 1.0], [2.0, 2.0])])
def test_without_two_recordings_each_there_is_no_interval(before: list[float], after: list[float]) -> None:
    assert welch_interval(before, after) is None


def test_a_recording_counts_once_in_a_change_however_many_steps_it_has() -> None:
    before = [recording(step_length=[0.5, 0.5, 0.5, 0.5]), recording(step_length=[0.7])]
    (change,) = change_between(before, [recording(step_length=[0.8, 0.9], cadence=[100.0])])
    assert (change.n_before, change.n_after, change.ci95) == (2, 1, None)
    assert change.before == pytest.approx(0.6)
    assert math.isclose(change.change, 0.85 - 0.6)
