"""Functions of coordinates in OpenSim models: the displacement along an axis of a joint, or a coupled coordinate."""

from collections.abc import Callable, Sequence
from typing import Final
from xml.etree.ElementTree import Element

import numpy as np
from scipy.linalg import solve_banded

from stridelab.conventions import Points, Series

Function = Callable[[Sequence[Series]], Series]
"""Value per sample of the values of its arguments."""

MAX_POINTS: Final = 10_000
_LARGEST: Final = 1e6


class BrokenModelError(ValueError):
    """A part of a model that cannot be used; the message completes a sentence for users."""


def parse_function(element: Element) -> Function:
    """Function of an XML element.

    Raises ``BrokenModelError`` for a class that is not read, and for parameters that are no numbers.
    """
    match element.tag:
        case "Constant":
            value = numbers_in(element.findtext("value", "0"), 1)[0]
            return lambda q: np.full_like(q[0], value) if q else np.array([value])
        case "LinearFunction":
            a = numbers_in(element.findtext("coefficients", "1 0"))
            if a.size < 2:
                raise BrokenModelError("a LinearFunction has fewer than two coefficients")
            return lambda q: np.asarray(sum(k * x for k, x in zip(a[:-1], q, strict=False)) + a[-1])
        case "PolynomialFunction":
            powers = numbers_in(element.findtext("coefficients", "0"))
            return lambda q: np.asarray(np.polyval(powers, q[0]))
        case "MultiplierFunction":
            scaled, scale = inner_function(element, "function"), numbers_in(element.findtext("scale", "1"), 1)[0]
            if scaled is None:
                raise BrokenModelError("a MultiplierFunction has no function")
            return lambda q: scale * scaled(q)
        case "PiecewiseLinearFunction":
            return _piecewise(element, _slopes)
        case "SimmSpline" | "NaturalCubicSpline" | "natCubicSpline":
            return _piecewise(element, spline_coefficients)
    raise BrokenModelError(f"the function {element.tag[:40]} is not read")


def inner_function(element: Element, tag: str) -> Function | None:
    """Function inside the child ``tag``; None without the child or without a function in it."""
    outer = element.find(tag)
    return None if outer is None or len(outer) == 0 else parse_function(outer[0])


def numbers_in(text: str | None, count: int | None = None) -> Series:
    """Numbers in a text, separated by blanks. Raises ``BrokenModelError`` unless there are ``count``, all finite."""
    cells = (text or "").split()
    try:
        values = np.array([float(cell) for cell in cells], dtype=np.float64)
    except ValueError as error:
        raise BrokenModelError(f"it has {(text or '').strip()[:40]!r} in the place of numbers") from error
    if (count is not None and len(values) != count) or len(values) > MAX_POINTS:
        raise BrokenModelError(f"it has {len(values)} numbers in the place of {count or MAX_POINTS}")
    if not (np.abs(values) < _LARGEST).all():
        raise BrokenModelError("it has a number that is not finite, or implausibly large")
    return values


def spline_coefficients(x: Series, y: Series) -> Points:
    """First, second and third order coefficients at each knot of the cubic spline of SIMM.

    The third derivative at each end is that of the cubic through the four points there (Forsythe, Malcolm and Moler,
    1977); with three points it is zero in place of that.
    """
    n, h = len(x), np.diff(x)
    slope = np.diff(y) / h
    if n == 2:
        return np.array([[slope[0], 0.0, 0.0]] * 2)
    bands, right = np.zeros((3, n)), np.zeros(n)
    right[1:-1] = np.diff(slope)
    bands[1, 1:-1] = 2.0 * (h[:-1] + h[1:])
    bands[1, 0], bands[1, -1] = -h[0], -h[-1]
    bands[0, 1:] = bands[2, :-1] = h
    if n > 3:
        start = right[2] / (x[3] - x[1]) - right[1] / (x[2] - x[0])
        end = right[-2] / (x[-1] - x[-3]) - right[-3] / (x[-2] - x[-4])
        right[0] = start * h[0] ** 2 / (x[3] - x[0])
        right[-1] = -end * h[-1] ** 2 / (x[-1] - x[-4])
    c = solve_banded((1, 1), bands, right)
    first = slope - h * (c[1:] + 2.0 * c[:-1])
    first = np.append(first, slope[-1] + h[-1] * (c[-2] + 2.0 * c[-1]))
    third = np.diff(c) / h
    return np.column_stack([first, 3.0 * c, np.append(third, third[-1])])


def _piecewise(element: Element, coefficients: Callable[[Series, Series], np.ndarray]) -> Function:
    """Piecewise polynomial through the points of an element; outside them the line with the slope at the end."""
    x, y = numbers_in(element.findtext("x")), numbers_in(element.findtext("y"))
    if len(x) != len(y) or len(x) < 2 or not (np.diff(x) > 1e-12).all():
        raise BrokenModelError(f"the points of a {element.tag} do not increase, or x and y differ in number")
    powers = coefficients(x, y)
    last = len(x) - 1

    def evaluate(q: Sequence[Series]) -> Series:
        k = np.clip(np.searchsorted(x, q[0], side="right") - 1, 0, last - 1)
        k[q[0] > x[last]] = last
        outside = (q[0] < x[0]) | (q[0] > x[last])
        d = q[0] - x[k]
        higher = sum(powers[k, j] * d ** (j + 1) for j in range(1, powers.shape[1]))
        return np.asarray(y[k] + powers[k, 0] * d + np.where(outside, 0.0, higher))

    return evaluate


def _slopes(x: Series, y: Series) -> np.ndarray:
    slope = np.diff(y) / np.diff(x)
    return np.append(slope, slope[-1])[:, None]
