"""Charts put values where their axes say, and leave out what is not known."""

import numpy as np
import pytest

from stridelab_web.charts.svg import Chart, axis_ticks, range_of


@pytest.mark.parametrize(
    ("span", "texts"),
    [
        ((0.0, 1.0), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]),
        ((-0.3, 0.3), ["-0.2", "0.0", "0.2"]),
        ((940.0, 1060.0), ["950", "1000", "1050"]),
        ((0.0901, 0.0999), ["0.092", "0.094", "0.096", "0.098"]),
    ],
)
def test_ticks_are_round_and_inside(span: tuple[float, float], texts: list[str]) -> None:
    ticks = axis_ticks(span, 5 if len(texts) > 3 else 4)
    assert [text for _, text in ticks] == texts
    assert all(span[0] <= value <= span[1] for value, _ in ticks)
    assert [float(text) for _, text in ticks] == pytest.approx([value for value, _ in ticks], abs=1e-12)


def test_values_stand_between_the_ticks_of_their_size() -> None:
    canvas = Chart((0.0, 2.0), (-1.0, 1.0), "t [s]", "z [mm]")
    canvas.add_mark(0.5, 0.5, "a", text="half")
    chart = canvas.with_caption("a mark")
    px = {tick.text: tick.px for tick in chart.x_ticks}
    py = {tick.text: tick.px for tick in chart.y_ticks}
    (mark,) = chart.marks
    assert mark.x == pytest.approx(px["0.5"], abs=0.11)
    assert py["0.0"] > mark.y > chart.top, "upwards is up"
    assert mark.y == pytest.approx(py["0.5"], abs=0.11)


def test_at_true_scale_a_circle_is_as_high_as_it_is_wide() -> None:
    canvas = Chart((0.0, 2.0), (0.0, 0.5), "ahead [m]", "up [m]", 800.0, true_scale=True)
    canvas.add_circle(1.0, 0.25, 0.25, "rim")
    (circle,) = canvas.with_caption("a circle").circles
    assert circle.radius == pytest.approx(canvas.y_px(0.0) - canvas.y_px(0.25), abs=0.06)
    assert circle.radius == pytest.approx(canvas.x_px(0.25) - canvas.x_px(0.0), abs=0.06)


def test_a_line_is_interrupted_where_a_value_is_missing() -> None:
    canvas = Chart((0.0, 5.0), (0.0, 1.0), "t [s]", "y")
    y = np.array([0.1, 0.2, np.nan, 0.4, 0.5, np.nan])
    canvas.add_curve(np.arange(6.0), y, "main")
    canvas.add_mark(float("nan"), 0.5, "a")
    canvas.add_vertical_line(1.0, float("nan"), 1.0, "error")
    chart = canvas.with_caption("two pieces")
    assert [len(curve.points.split()) for curve in chart.curves] == [2, 2]
    assert not chart.marks
    assert not chart.whiskers


def test_intervals_end_where_the_axis_ends() -> None:
    canvas = Chart((1.0, 2.0), (0.0, 1.0), "t [s]", "y")
    canvas.add_shade(1.5, 3.0, "double", "both feet")
    canvas.add_shade(2.5, 3.0, "double", "outside")
    chart = canvas.with_caption("one interval")
    (shade,) = chart.shades
    assert shade.x + shade.width == pytest.approx(chart.right, abs=0.1)
    assert shade.x == pytest.approx((chart.left + chart.right) / 2, abs=0.1)


def test_a_span_holds_everything_known_and_is_never_empty() -> None:
    assert range_of(np.array([np.nan])) == (0.0, 1.0)
    low, high = range_of(np.array([2.0, 2.0]), min_width=0.5)
    assert (low, high) == pytest.approx((1.75, 2.25))
    low, high = range_of(np.array([0.0, 10.0]), np.array([np.nan, -1.0]), share=0.1)
    assert (low, high) == pytest.approx((-2.1, 11.1))
