"""How numbers read on the pages."""

from datetime import datetime, timedelta, timezone

import pytest

from stridelab.schemas.methods import METHODS
from stridelab.service.jobs.kinds.registry import KINDS
from stridelab_web import words
from stridelab_web.comparison_plots import STYLES
from stridelab_web.words import fixed, moment


@pytest.mark.parametrize(
    ("value", "text"), [(1.236, "1.24"), (-0.001, "0.00"), (-0.006, "-0.01"), (0.0, "0.00"), (None, "–")]
)
def test_fixed_digits_and_no_negative_zero(value: float | None, text: str) -> None:
    assert fixed(value) == text


def test_every_estimator_has_a_name_and_a_line_of_its_own() -> None:
    assert set(METHODS) == set(words._METHODS)
    assert set(METHODS) <= set(STYLES)


def test_every_kind_of_job_has_a_name() -> None:
    assert set(words.KINDS) == set(KINDS)


def test_a_time_says_that_it_is_utc_whatever_its_own_zone() -> None:
    there = timezone(timedelta(hours=-5))
    assert moment(datetime(2026, 11, 22, 23, 30, tzinfo=there)) == "2026-11-23 04:30 UTC"
