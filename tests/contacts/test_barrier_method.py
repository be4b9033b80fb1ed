"""Newton's method on paths that are known in closed form, and the slopes of all its problems by differences."""

from collections.abc import Callable
from itertools import count

import numpy as np
import pytest
from scipy.optimize import approx_fprime

from stridelab.contacts.barrier_method import WEIGHT_RATIO, Derivatives, Value, follow_central_path
from stridelab.contacts.wrench_cones.ellipsoids import _CircumscribedProblem, _InscribedProblem
from stridelab.contacts.wrench_cones.wrench_feasibility import _MarginProblem
from stridelab.reproduction.studies.random_contact_sets import random_contacts, random_wrench


def value(x: np.ndarray, weight: float) -> float:
    """Least ``x_1 + ... + x_n``, all above zero: the path is ``x_i = 1 / w``."""
    return np.inf if x.min() <= 0.0 else float(weight * x.sum() - np.log(x).sum())


class Counted:
    """Its slopes, and how often they were evaluated."""

    def __init__(self) -> None:
        self.calls = 0

    def __call__(self, x: np.ndarray, weight: float) -> tuple[np.ndarray, np.ndarray]:
        self.calls += 1
        return weight - 1.0 / x, np.diag(1.0 / x**2)


def test_a_path_that_is_linear_in_the_inverse_weight_is_predicted_exactly() -> None:
    """Per weight one look whether the point is centred, which it always is, and two for the tangent."""
    slopes = Counted()
    result = follow_central_path(np.ones(3), value, slopes, WEIGHT_RATIO**5)
    np.testing.assert_allclose(result, 1.0 / WEIGHT_RATIO**5, rtol=1e-9)
    assert slopes.calls == 5 * 3 + 1


def test_the_last_weight_is_reached_and_not_passed() -> None:
    request: list[float] = []

    def slopes(x: np.ndarray, weight: float) -> tuple[np.ndarray, np.ndarray]:
        request.append(weight)
        return Counted()(x, weight)

    np.testing.assert_allclose(follow_central_path(np.full(2, 0.5), value, slopes, 100.0, 2.0), 0.01, rtol=1e-4)
    assert [w for w in dict.fromkeys(request) if w not in {4.0, 24.0, 144.0}] == [2.0, 12.0, 72.0, 100.0]


@pytest.mark.parametrize("start", [1e-6, 0.3, 1.9, 500.0])
def test_a_start_off_the_path_is_led_to_it(start: float) -> None:
    """From afar a full step leaves the domain, or does not descend: it is halved."""
    slopes = Counted()
    np.testing.assert_allclose(follow_central_path(np.array([start, 1.0]), value, slopes, 1.0), 1.0, rtol=1e-4)
    assert slopes.calls <= 40


def test_the_rounding_of_the_value_does_not_hide_its_descent_near_the_centre() -> None:
    """Every value is a little larger than the one before, by more than what is left to gain."""
    errors = count()
    result = follow_central_path(np.array([1.2]), lambda x, w: value(x, w) + 0.1 * next(errors), Counted(), 1.0)
    np.testing.assert_allclose(result, 1.0, rtol=1e-4)


def test_a_step_ahead_stays_off_the_edge() -> None:
    """A path that is not linear, ``0 < x < 1``: w = 1 / x - 1 / (1 - x), from beyond its centre at the first weight."""

    def between(x: np.ndarray, weight: float) -> float:
        inside = 0.0 < x[0] < 1.0
        return float(weight * x[0] - np.log(x[0]) - np.log(1.0 - x[0])) if inside else np.inf

    def slopes(x: np.ndarray, weight: float) -> tuple[np.ndarray, np.ndarray]:
        assert 0.0 < x[0] < 1.0
        return weight - 1.0 / x + 1.0 / (1.0 - x), np.diag(1.0 / x**2 + 1.0 / (1.0 - x) ** 2)

    (x,) = follow_central_path(np.array([0.9]), between, slopes, 1e6)
    assert 1.0 / x - 1.0 / (1.0 - x) == pytest.approx(1e6, rel=1e-4)


def inside() -> tuple[Value, Derivatives, np.ndarray]:
    normals = np.random.default_rng(0).normal(size=(12, 3))
    made = _InscribedProblem(normals, np.linspace(1.0, 2.0, 12))
    return made.barrier_value, made.barrier_derivatives, made.feasible_start()


def around(centred: bool) -> tuple[Value, Derivatives, np.ndarray]:
    made = _CircumscribedProblem(np.random.default_rng(1).normal(size=(9, 3)) + 0.2, centred)
    return made.barrier_value, made.barrier_derivatives, made.feasible_start()


def margin() -> tuple[Value, Derivatives, np.ndarray]:
    rng = np.random.default_rng(2)
    contacts = random_contacts(rng, 3)
    made = _MarginProblem(contacts, random_wrench(rng, contacts))
    return made.barrier_value, made.barrier_derivatives, made.feasible_start()


@pytest.mark.parametrize(
    "made", [inside, lambda: around(False), lambda: around(True), margin], ids=["inside", "around", "centred", "margin"]
)
def test_slopes_are_those_of_the_value(made: Callable[[], tuple[Value, Derivatives, np.ndarray]]) -> None:
    """Gradient and Hessian by differences, off the start in all directions."""
    value_of, slopes, start = made()
    rng = np.random.default_rng(3)
    for weight in (0.5, 20.0):
        x = start + 0.02 * rng.normal(size=start.shape)
        assert np.isfinite(value_of(x, weight))
        gradient, hessian = slopes(x, weight)
        size = np.abs(gradient).max()
        by_value = approx_fprime(x, lambda y, w=weight: value_of(y, w), 1e-7)
        np.testing.assert_allclose(gradient, by_value, atol=1e-4 * size)
        by_gradient = approx_fprime(x, lambda y, w=weight: slopes(y, w)[0], 1e-7)
        np.testing.assert_allclose(hessian, by_gradient, atol=1e-4 * np.abs(hessian).max())
