"""Rays that span the friction cone from inside."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stridelab.centroidal.point_forces import pyramid_rays


@given(friction=st.floats(0.01, 2.0), lengths=st.lists(st.floats(0.0, 10.0), min_size=3, max_size=16))
def test_every_sum_of_rays_lies_in_the_exact_cone(friction: float, lengths: list[float]) -> None:
    f = pyramid_rays(friction, len(lengths)) @ np.array(lengths)
    assert np.hypot(f[0], f[1]) <= friction * f[2] * (1 + 1e-12) + 1e-12


def test_the_rays_lie_on_the_cone_and_push_by_one() -> None:
    V = pyramid_rays(0.4, 8)
    assert np.hypot(V[0], V[1]) == pytest.approx(0.4)
    assert V[2] == pytest.approx(1.0)
