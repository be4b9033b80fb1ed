"""A density goes with its contact: a sole's turns with it, a hand's only with the trunk."""

import numpy as np
from scipy.stats import multivariate_normal

from stridelab.dynamics.spatial import Placement
from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.proxy.effector_proxy import Proxy

MEAN = np.array([0.1, -0.2, 0.8])
COVARIANCE = np.diag([0.2, 0.1, 0.05]) ** 2
MIXTURE = Mixture(np.ones(1), MEAN[None], COVARIANCE[None])
LEANING = Placement.from_wxyz((1.0, 2.0, 3.0), (np.cos(0.2), 0.0, np.sin(0.2), 0.0))
"""A contact that is pitched by 0.4 rad, as a rail beside stairs."""


def yawed(angle_rad: float) -> np.ndarray:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def expected(com_m: np.ndarray, R: np.ndarray) -> np.ndarray:
    """The normal density in the world: its mean and axes carried there."""
    return np.asarray(multivariate_normal(LEANING.position_m + R @ MEAN, R @ COVARIANCE @ R.T).logpdf(com_m))


def test_in_the_contact_frame_the_heading_does_not_matter() -> None:
    com_m = LEANING.position_m + np.random.default_rng(0).normal(0.0, 0.5, (50, 3))
    for heading_rad in (0.0, 1.3):
        got = Proxy(MIXTURE).log_density(com_m, LEANING, heading_rad)
        assert np.allclose(got, expected(com_m, LEANING.rotation), atol=1e-10)


def test_in_the_heading_frame_the_contact_s_orientation_does_not_matter() -> None:
    com_m = LEANING.position_m + np.random.default_rng(1).normal(0.0, 0.5, (50, 3))
    for heading_rad in (0.0, -0.7, 3.0):
        got = Proxy(MIXTURE, "heading").log_density(com_m, LEANING, heading_rad)
        assert np.allclose(got, expected(com_m, yawed(heading_rad)), atol=1e-10)
