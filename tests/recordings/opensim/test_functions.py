"""Functions of OpenSim models against polynomials, lines, and their own points."""

from xml.etree.ElementTree import fromstring

import numpy as np
import pytest

from stridelab.recordings.opensim.functions import BrokenModelError, parse_function

X = np.array([-1.0, -0.3, 0.2, 0.9, 1.5, 2.2])
INSIDE = np.linspace(-1.0, 2.2, 41)


def points(tag: str, x: np.ndarray, y: np.ndarray) -> str:
    return f"<{tag}><x>{' '.join(map(repr, x.tolist()))}</x><y>{' '.join(map(repr, y.tolist()))}</y></{tag}>"


@pytest.mark.parametrize("tag", ["SimmSpline", "NaturalCubicSpline", "natCubicSpline"])
def test_the_spline_is_exact_for_every_cubic(tag: str) -> None:
    cubic = np.poly1d([0.3, -0.7, 0.2, 1.1])
    function = parse_function(fromstring(points(tag, X, cubic(X))))
    np.testing.assert_allclose(function([INSIDE]), cubic(INSIDE), atol=1e-12)


def test_the_spline_meets_its_points_and_goes_on_straight() -> None:
    y = np.array([0.0, 0.4, -0.2, 0.1, 0.5, 0.3])
    function = parse_function(fromstring(points("SimmSpline", X, y)))
    np.testing.assert_allclose(function([X]), y, atol=1e-12)
    for end, away in ((X[0], -1.0), (X[-1], 1.0)):
        near, far, farther = (function([np.array([end + away * d])])[0] for d in (0.0, 1.0, 2.0))
        slope = (function([np.array([end])])[0] - function([np.array([end - away * 1e-6])])[0]) / 1e-6
        assert far - near == pytest.approx(slope, abs=1e-5)
        assert farther - far == pytest.approx(far - near, abs=1e-12)


@pytest.mark.parametrize("n", [2, 3])
def test_a_spline_of_few_points_is_a_line_through_them(n: int) -> None:
    function = parse_function(fromstring(points("SimmSpline", X[:n], 2.0 * X[:n] + 1.0)))
    np.testing.assert_allclose(function([INSIDE]), 2.0 * INSIDE + 1.0, atol=1e-12)


TWICE_1_5 = (
    "<MultiplierFunction><function><Constant><value>2</value></Constant></function><scale>1.5</scale>"
    "</MultiplierFunction>"
)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("<Constant><value>0.7</value></Constant>", 0.7 + 0 * INSIDE),
        ("<LinearFunction><coefficients>-2 0.5</coefficients></LinearFunction>", 0.5 - 2 * INSIDE),
        ("<PolynomialFunction><coefficients>1 0 2 3</coefficients></PolynomialFunction>", INSIDE**3 + 2 * INSIDE + 3),
        (TWICE_1_5, 3.0 + 0 * INSIDE),
        (points("PiecewiseLinearFunction", X, np.abs(X - 0.2)), np.abs(INSIDE - 0.2)),
    ],
)
def test_the_value_of_each_function(text: str, value: np.ndarray) -> None:
    np.testing.assert_allclose(parse_function(fromstring(text))([INSIDE]), value, atol=1e-12)


def test_a_linear_function_of_two_coordinates() -> None:
    function = parse_function(fromstring("<LinearFunction><coefficients>2 3 1</coefficients></LinearFunction>"))
    np.testing.assert_allclose(function([np.array([1.0]), np.array([10.0])]), 33.0)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("<Sine/>", "Sine is not read"),
        ("<SimmSpline><x>0 1 1</x><y>0 1 2</y></SimmSpline>", "do not increase"),
        ("<SimmSpline><x>0 1 2</x><y>0 1</y></SimmSpline>", "differ in number"),
        ("<SimmSpline><x>0 nan</x><y>0 1</y></SimmSpline>", "not finite"),
        ("<Constant><value>much</value></Constant>", "'much'"),
        ("<Constant><value>1 2</value></Constant>", "2 numbers"),
        ("<LinearFunction><coefficients>1</coefficients></LinearFunction>", "fewer than two"),
        ("<MultiplierFunction/>", "no function"),
    ],
)
def test_a_broken_function_is_refused_with_the_reason(text: str, why: str) -> None:
    with pytest.raises(BrokenModelError, match=why):
        parse_function(fromstring(text))
