"""Boxes and shares of a density, against the normal distribution and against counting."""

import numpy as np
import pytest
from scipy.stats import chi2, norm

from stridelab.centroidal.reach_box import reach_box, usual_share
from stridelab.reachability.gaussian_mixture import Mixture
from support.robots.sequences import MIXTURES

SD_M = np.array([0.1, 0.2, 0.05])
ONE = Mixture(np.ones(1), np.array([[0.1, -0.2, 0.8]]), np.diag(SD_M**2)[None])


def test_the_box_of_a_normal_density_has_its_quantiles() -> None:
    box = reach_box(ONE, 0.99)
    assert box.low_m == pytest.approx(ONE.means_m[0] - norm.ppf(0.995) * SD_M, abs=1e-9)
    assert box.high_m == pytest.approx(ONE.means_m[0] + norm.ppf(0.995) * SD_M, abs=1e-9)


def test_the_box_of_a_mixture_holds_the_share_that_it_promises() -> None:
    mixture = MIXTURES["right_hand"]
    box, samples = reach_box(mixture, 0.9), mixture.sample(40_000, np.random.default_rng(5))
    for axis in range(3):
        assert (samples[:, axis] < box.low_m[axis]).mean() == pytest.approx(0.05, abs=0.006)
        assert (samples[:, axis] > box.high_m[axis]).mean() == pytest.approx(0.05, abs=0.006)


def test_the_share_of_a_normal_density_is_that_of_chi_square() -> None:
    points = ONE.means_m + np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.1, 0.4, 0.0], [2.0, 0.0, 0.0]])
    distances = (((points - ONE.means_m) / SD_M) ** 2).sum(axis=1)
    assert usual_share(ONE, points) == pytest.approx(chi2.sf(distances, 3), abs=0.02)
    assert usual_share(ONE, points)[-1] == 0.0
