"""Rotations of many postures at once against scipy's, one by one."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stridelab.reachability.kinematics.rotations import rotate_about_axis, rotation_vectors

ANGLE = st.floats(-4.0, 4.0)


@given(seed=st.integers(0, 1000), angles=st.lists(ANGLE, min_size=1, max_size=5))
def test_turned_about_an_axis_of_its_own(seed: int, angles: list[float]) -> None:
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    R = Rotation.random(len(angles), rng=rng)
    expected = R * Rotation.from_rotvec(np.outer(angles, axis))
    np.testing.assert_allclose(
        rotate_about_axis(R.as_matrix(), axis, np.array(angles)), expected.as_matrix(), atol=1e-14
    )


def test_vectors_are_those_of_the_rotations_up_to_half_a_turn() -> None:
    vectors = np.array([[0.0, 0.0, 0.0], [0.3, -0.2, 0.9], [1e-9, 0.0, 0.0], [0.0, np.pi - 1e-7, 0.0]])
    np.testing.assert_allclose(rotation_vectors(Rotation.from_rotvec(vectors).as_matrix()), vectors, atol=1e-8)
    assert rotation_vectors(np.zeros((0, 3, 3))).shape == (0, 3)
