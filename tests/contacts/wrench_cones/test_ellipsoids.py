"""The smallest ellipsoid around points, by the condition that is both necessary and enough."""

import numpy as np
import pytest
from scipy.optimize import nnls

from stridelab.contacts.wrench_cones.ellipsoids import smallest_around


@pytest.mark.parametrize("centred", [False, True])
@pytest.mark.parametrize("dimension", [2, 5])
def test_it_is_the_smallest_by_johns_condition(dimension: int, centred: bool) -> None:
    """(4.19a), (4.19c): weights of points on the boundary make the unit matrix, about the centre where that is free."""
    points = np.random.default_rng(dimension).normal(size=(40, dimension)) + 0.3
    result = smallest_around(points, centred=centred)
    u = np.linalg.solve(result.axes, (points - result.center).T).T
    assert np.linalg.norm(u, axis=1).max() == pytest.approx(1.0, abs=1e-6)
    near = u[np.linalg.norm(u, axis=1) > 1.0 - 1e-4]
    outer = np.einsum("ni,nj->nij", near, near).reshape(len(near), -1)
    conditions = outer.T if centred else np.vstack([outer.T, near.T])
    wanted = np.concatenate([np.eye(dimension).ravel(), np.zeros(len(conditions) - dimension**2)])
    assert nnls(conditions, wanted)[1] < 1e-3


def test_its_form_is_positive() -> None:
    """(4.19b)."""
    points = np.random.default_rng(0).normal(size=(30, 5))
    assert np.linalg.eigvalsh(np.linalg.inv(smallest_around(points).axes)).min() > 0.0
