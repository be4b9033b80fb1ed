"""The log-density in CasADi against numpy, its derivatives against finite differences."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stridelab.centroidal.nlp.stage_functions import likelihood_functions
from stridelab.dynamics.spatial import Placement
from support.robots.sequences import MIXTURES

RNG = np.random.default_rng(7)
PLACES = [
    Placement(RNG.normal(size=3), Rotation.from_rotvec(RNG.normal(size=3)).as_matrix()) for _ in range(20)
]  # fmt: skip


def near(mixture_name: str, place: Placement, rng: np.random.Generator) -> np.ndarray:
    """A world point among the mixture's components, or far outside all of them."""
    mixture = MIXTURES[mixture_name]
    local = mixture.means_m[rng.integers(len(mixture.weights))] + rng.normal(size=3) * rng.choice([0.05, 0.5, 3.0])
    return place.act(local[None])[0]


@pytest.mark.parametrize("name", MIXTURES)
def test_equals_numpy_to_ten_digits_wherever_the_contact_is(name: str) -> None:
    """The log-density of (4.13)."""
    functions, rng = likelihood_functions(MIXTURES[name]), np.random.default_rng(1)
    for place in PLACES:
        c = near(name, place, rng)
        value = float(functions.value(c, place.position_m, place.rotation.ravel(order="F")))
        expected = -MIXTURES[name].log_density(place.inverse().act(c[None]))[0]
        assert value == pytest.approx(expected, abs=1e-10, rel=1e-12)


@pytest.mark.parametrize("name", MIXTURES)
def test_gradient_and_second_derivative_against_finite_differences(name: str) -> None:
    functions, rng, e = likelihood_functions(MIXTURES[name]), np.random.default_rng(2), 1e-5
    for place in PLACES:
        at = place.position_m, place.rotation.ravel(order="F")
        c = near(name, place, rng)
        slope, bend = np.empty(3), np.empty((3, 3))
        for i, d in enumerate(e * np.eye(3)):
            slope[i] = float(functions.value(c + d, *at) - functions.value(c - d, *at)) / (2 * e)
            bend[i] = (functions.gradient(c + d, *at) - functions.gradient(c - d, *at)).full().ravel() / (2 * e)
        assert functions.gradient(c, *at).full().ravel() == pytest.approx(slope, rel=1e-5, abs=1e-5)
        assert functions.curvature(c, *at, 1.0).full() == pytest.approx(bend, rel=1e-4, abs=1e-3)


@pytest.mark.parametrize("name", MIXTURES)
def test_the_majoriser_is_positive_definite_and_bounds_the_log_density_from_above(name: str) -> None:
    functions, rng = likelihood_functions(MIXTURES[name]), np.random.default_rng(3)
    for place in PLACES:
        at = place.position_m, place.rotation.ravel(order="F")
        c = near(name, place, rng)
        Q = functions.curvature(c, *at, 0.0).full()
        assert np.linalg.eigvalsh(Q).min() > 0.0
        for d in rng.normal(scale=0.2, size=(5, 3)):
            bound = float(functions.value(c, *at)) + d @ functions.gradient(c, *at).full().ravel() + d @ Q @ d / 2
            assert float(functions.value(c + d, *at)) <= bound + 1e-9
