"""Pictures of claims: places of number, interval and range, from numbers and from the texts of the book."""

import math

import pytest

from stridelab_web.charts.claim_bars import ClaimBar, draw_claim, read_claim

TEXTS = ("1", "holds if")


def drawn(
    ours: float, holds: tuple[float | None, float | None], interval: tuple[float, float] | None = None
) -> ClaimBar:
    bar = draw_claim(ours, holds, interval, TEXTS)
    assert bar is not None
    return bar


def test_number_range_and_interval_share_one_scale() -> None:
    bar = drawn(2.0, (1.0, 3.0), (1.5, 2.5))
    assert (bar.ours_x, bar.range_x + bar.range_width / 2) == pytest.approx((50.0, 50.0))
    assert bar.interval_x == pytest.approx(bar.range_x + bar.range_width / 4, abs=0.02)
    assert bar.interval_width == pytest.approx(bar.range_width / 2, abs=0.02)


def test_an_open_side_reaches_the_edge() -> None:
    at_most, at_least = drawn(3.0, (None, 2.0), None), drawn(3.0, (2.0, None), None)
    assert at_most.range_x == 0.0
    assert at_most.range_width < at_most.ours_x, "a number above its bound lies outside of the range"
    assert at_least.range_x + at_least.range_width == pytest.approx(100.0)
    assert at_least.range_x < at_least.ours_x


def test_a_single_value_is_seen() -> None:
    bar = drawn(7.0, (7.0, 7.0), None)
    assert bar.range_width > 1.0
    assert bar.range_x < bar.ours_x < bar.range_x + bar.range_width


def test_what_has_no_range_or_no_number_is_not_drawn() -> None:
    assert draw_claim(1.0, (None, None), None, TEXTS) is None
    assert draw_claim(math.nan, (0.0, None), None, TEXTS) is None
    assert read_claim("as the thesis says", "1", "simulated, n = 1") is None
    assert read_claim("≤ 2 mm (our aim)", "1 s", "simulated, n = 1") is None, "length against time"


def test_texts_of_the_book_are_read_in_their_units() -> None:
    bar = read_claim("≤ 0.4 s (thesis)", "200 ms", "simulated, n = 3; 95 % from 100 ms to 0.3 s")
    assert bar is not None
    same = drawn(0.2, (None, 0.4), (0.1, 0.3))
    assert (bar.ours_x, bar.range_width, bar.interval_x) == (same.ours_x, same.range_width, same.interval_x)
    assert bar.text == "200 ms; 95 % from 100 ms to 0.3 s; holds if ≤ 0.4 s (thesis)"


def test_an_interval_of_the_share_of_cases_is_not_that_of_the_number() -> None:
    bar = read_claim(
        "≤ 2 ms (our aim)", "1.31 ms", "simulated, n = 50; 50 of 50 in the range, 95 % from 0.929 to 1 of all"
    )
    assert bar is not None
    assert bar.interval_x is None
