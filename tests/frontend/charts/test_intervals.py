"""Bars and ticks are where the seconds say."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stridelab.schemas.recordings import PlateInfo
from stridelab_web.charts import intervals


def test_bars_are_percent_of_the_duration_and_cut_at_its_ends() -> None:
    first, second = intervals.interval_bars([(-0.5, 1.0), (3.0, 9.0)], 4.0)
    assert (first.x, first.width) == (0.0, 25.0)
    assert (second.x, second.width) == (75.0, 25.0)
    assert intervals.interval_bars([(5.0, 6.0)], 4.0) == ()
    assert intervals.interval_bars([(0.0, 1.0)], 0.0) == ()


def test_a_plate_that_was_never_loaded_says_so() -> None:
    plate = PlateInfo(index=3, type=1, corners_m=[], loaded_s=[])
    assert intervals.plate_bars(plate, 2.0).text == "Plate 3 loaded: never"


@given(st.floats(0.01, 5000))
def test_ticks_are_few_even_round_and_inside(duration_s: float) -> None:
    ticks = intervals.time_ticks(duration_s)
    assert 2 <= len(ticks) <= intervals.MAX_TICKS + 1
    assert ticks[0].x == 0
    assert all(0 <= tick.x <= 100.001 for tick in ticks)
    steps = [b.x - a.x for a, b in itertools.pairwise(ticks)]
    assert max(steps) - min(steps) < 0.01
    seconds = float(ticks[1].text.removesuffix(" s"))
    assert 100 * seconds / duration_s == pytest.approx(ticks[1].x, abs=0.01)
    assert f"{seconds:e}"[0] in "125"
