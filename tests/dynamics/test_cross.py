"""The product of two single vectors is numpy's."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from stridelab.dynamics.spatial import cross

vector = arrays(float, 3, elements=st.floats(-1e6, 1e6))


@given(a=vector, b=vector)
def test_the_cross_product_is_that_of_numpy(a: np.ndarray, b: np.ndarray) -> None:
    np.testing.assert_array_equal(cross(a, b), np.cross(a, b))
