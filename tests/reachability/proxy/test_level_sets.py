"""Level sets enclose what they say, for densities whose level sets are known."""

import numpy as np
import pytest
from scipy.stats import chi2

from stridelab.errors import InvalidInput
from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.proxy.level_sets import LevelSet, level_sets


@pytest.fixture(scope="module")
def gaussian() -> Mixture:
    A = np.array([[0.10, 0.0, 0.0], [0.05, 0.06, 0.0], [-0.02, 0.03, 0.12]])
    return Mixture(np.ones(1), np.array([[0.3, -0.1, 0.8]]), (A @ A.T)[None])


@pytest.fixture(scope="module")
def sets(gaussian: Mixture) -> tuple[LevelSet, ...]:
    return level_sets(gaussian)


def test_level_sets_of_a_gaussian_are_the_known_ellipsoids(gaussian: Mixture, sets: tuple[LevelSet, ...]) -> None:
    """``(c - mu)^T S^-1 (c - mu) = q``, of which the mass inside is that of chi squared with three degrees."""
    S = gaussian.covariances_m2[0]
    for level_set in sets:
        radius = np.sqrt(chi2.ppf(level_set.mass, 3))
        d = level_set.vertices_m - gaussian.means_m[0]
        radii = np.sqrt(np.einsum("ia,ab,ib->i", d, np.linalg.inv(S), d))
        assert radii == pytest.approx(radius, rel=0.05)
        assert level_set.volume_m3 == pytest.approx(4 / 3 * np.pi * radius**3 * np.sqrt(np.linalg.det(S)), rel=0.04)


def test_surfaces_are_closed_and_small(sets: tuple[LevelSet, ...]) -> None:
    for level_set in sets:
        edges = np.sort(level_set.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        _, times = np.unique(edges, axis=0, return_counts=True)
        assert set(times) == {2}
        assert len(level_set.triangles) < 2500
        a, b, c = (level_set.vertices_m[level_set.triangles[:, i]] for i in range(3))
        enclosed = np.einsum("ij,ij->", a, np.cross(b, c)) / 6  # positive where triangles turn outwards
        assert enclosed == pytest.approx(level_set.volume_m3, rel=0.06)


def test_each_holds_its_share_of_other_draws() -> None:
    """A banana of three components, of which none is the density: draws of another seed are counted."""
    mu = np.array([[0.0, 0.0, 0.9], [0.25, 0.0, 0.75], [-0.25, 0.05, 0.75]])
    mixture = Mixture(np.array([0.5, 0.3, 0.2]), mu, np.tile(np.diag([0.1, 0.08, 0.05]) ** 2, (3, 1, 1)))
    draws_m = mixture.sample(20_000, np.random.default_rng(7))
    log_p = mixture.log_density(draws_m)
    surfaces = level_sets(mixture)
    assert [each.mass for each in surfaces] == [0.5, 0.8, 0.95]
    for each in surfaces:
        assert (log_p >= each.log_density).mean() == pytest.approx(each.mass, abs=0.012)
    assert sorted(each.volume_m3 for each in surfaces) == [each.volume_m3 for each in surfaces]


def test_two_clusters_apart_are_two_pieces() -> None:
    mu = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    mixture = Mixture(np.array([0.5, 0.5]), mu, np.tile(0.05**2 * np.eye(3), (2, 1, 1)))
    (level_set,) = level_sets(mixture, (0.8,))
    ball = 4 / 3 * np.pi * (0.05 * np.sqrt(chi2.ppf(0.8, 3))) ** 3
    assert level_set.volume_m3 == pytest.approx(2 * ball, rel=0.04)


@pytest.mark.parametrize("mass", [0.0, 1.0, -0.1, float("nan")])
def test_an_invalid_share_is_refused(gaussian: Mixture, mass: float) -> None:
    with pytest.raises(InvalidInput) as refused:
        level_sets(gaussian, (0.5, mass))
    assert refused.value.code == "mass-out-of-range"
