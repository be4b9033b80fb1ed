import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stridelab.recordings.gap_filling import rebuild_markers, rigid_motion

SHAPE = np.array([[0.0, 0.0, 0.0], [0.3, 0.02, 0.0], [0.1, 0.08, 0.05], [0.2, -0.05, 0.03]])
finite = st.floats(-3, 3)
vectors = st.tuples(finite, finite, finite).map(np.array)


def moved(shape, rotation_vectors, shifts):
    R = Rotation.from_rotvec(rotation_vectors).as_matrix()
    return R, np.einsum("nij,kj->nki", R, shape) + np.asarray(shifts)[:, None]


@settings(max_examples=40, deadline=None)
@given(vectors, vectors)
def test_a_rigid_motion_is_recovered(rotation_vector, shift):
    R, points = moved(SHAPE, [rotation_vector, -rotation_vector], [shift, 2 * shift])
    fitted_R, fitted_t = rigid_motion(SHAPE, points)
    np.testing.assert_allclose(fitted_R, R, atol=1e-9)
    np.testing.assert_allclose(fitted_t, [shift, 2 * shift], atol=1e-9)


def test_a_mirrored_cluster_still_gets_a_rotation():
    R, _ = rigid_motion(SHAPE, (SHAPE * [1, 1, -1])[None])
    assert np.linalg.det(R[0]) == pytest.approx(1.0)


def test_three_visible_markers_are_enough_and_two_are_not():
    _, points = moved(SHAPE, [[0.1, 0.2, 0.3]] * 2, [[1.0, 2.0, 3.0]] * 2)
    points[0, 3] = np.nan
    points[1, 2:] = np.nan
    R, t = rigid_motion(SHAPE, points)
    np.testing.assert_allclose(t[0], [1.0, 2.0, 3.0], atol=1e-9)
    assert np.isnan(R[1]).all()
    assert np.isnan(t[1]).all()


def test_markers_on_a_line_do_not_determine_the_rotation():
    line = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.3, 1e-4, 0.0]])
    R, _ = rigid_motion(line, line[None])
    assert np.isnan(R).all()


def shank(n=4):
    names = ("l_knee_lateral", "l_fibula_head", "l_tibial_tuberosity", "l_ankle_lateral", "l_ankle_medial")
    shape = np.array([[0.0, 0.0, 0.4], [-0.02, 0.01, 0.35], [0.05, -0.04, 0.34], [0.0, 0.0, 0.0], [0.01, -0.08, 0.01]])
    _, points = moved(shape, np.linspace(0, 1, 3 * n).reshape(n, 3), np.linspace(0, 2, 3 * n).reshape(n, 3))
    return {name: shape[None, i] for i, name in enumerate(names)}, {name: points[:, i] for i, name in enumerate(names)}


def test_a_marker_of_the_static_trial_alone_is_rebuilt_exactly():
    static, walk = shank()
    truth = walk.pop("l_ankle_medial")
    complete, changed = rebuild_markers(walk, static)
    assert changed == {"l_ankle_medial"}
    np.testing.assert_allclose(complete["l_ankle_medial"], truth, atol=1e-9)


def test_a_gap_is_filled_and_visible_samples_are_unchanged():
    _, walk = shank()
    truth = walk["l_ankle_lateral"].copy()
    walk["l_ankle_lateral"] = truth.copy()
    walk["l_ankle_lateral"][1:3] = np.nan
    complete, changed = rebuild_markers(walk, walk)
    assert changed == {"l_ankle_lateral"}
    np.testing.assert_allclose(complete["l_ankle_lateral"], truth, atol=1e-9)
    np.testing.assert_array_equal(complete["l_ankle_lateral"][[0, 3]], truth[[0, 3]])


def test_nothing_is_invented_where_the_neighbours_are_hidden_too():
    static, walk = shank()
    walk["l_ankle_lateral"] = np.full_like(walk["l_ankle_lateral"], np.nan)
    walk["l_fibula_head"] = walk["l_ankle_lateral"].copy()
    walk["l_tibial_tuberosity"] = walk["l_ankle_lateral"].copy()
    complete, changed = rebuild_markers(walk, static)
    assert changed == frozenset()
    assert np.isnan(complete["l_ankle_lateral"]).all()
