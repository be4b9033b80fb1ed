"""Geometry of faces and rails against hand-made numbers and a general solver."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation as ScipyRotation

from stridelab.contacts.terrain import (
    Box,
    Rail,
    Terrain,
    contact_area,
    depth_in_box_m,
    face_towards,
    is_vertical,
    vertical_span_m,
)
from stridelab.dynamics.spatial import Placement

coordinate = st.floats(-1.0, 1.0)
vectors = st.tuples(coordinate, coordinate, coordinate).map(np.array)
sizes = st.tuples(*[st.floats(0.1, 2.0)] * 3).map(np.array)
rotations = vectors.map(lambda v: ScipyRotation.from_rotvec(np.pi * v).as_matrix())


@settings(deadline=None)
@given(vectors, rotations, sizes)
def test_the_upper_face_looks_up_and_lies_on_the_box(
    center: np.ndarray, rotation: np.ndarray, size: np.ndarray
) -> None:
    box = Box("box", Placement(center, rotation), size)
    face = contact_area(box)
    assert face.normal[2] >= np.abs(rotation[2]).max() - 1e-12
    np.testing.assert_allclose(face.frame.T @ face.frame, np.eye(3), atol=1e-12)
    assert np.linalg.det(face.frame) == pytest.approx(1.0)
    corners = face.center_m + np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * face.half_m @ face.frame[:, :2].T
    np.testing.assert_allclose(depth_in_box_m(box, corners), 0.0, atol=1e-9)
    assert depth_in_box_m(box, center[np.newaxis])[0] == pytest.approx(size.min() / 2)


@settings(deadline=None)
@given(vectors, vectors, vectors)
def test_distance_to_a_face_is_that_to_its_nearest_point(
    center: np.ndarray, turn: np.ndarray, point: np.ndarray
) -> None:
    box = Box("box", Placement(center, ScipyRotation.from_rotvec(turn).as_matrix()), np.array([0.6, 0.4, 0.2]))
    face = contact_area(box)
    bounds = [(-half, half) for half in face.half_m]
    truth = minimize(
        lambda xy: np.sum((face.center_m + face.frame[:, :2] @ xy - point) ** 2), np.zeros(2), bounds=bounds
    )
    result = face.locate(point[np.newaxis]).distance_m[0]
    assert result == pytest.approx(np.sqrt(truth.fun), abs=1e-5)


def test_heights_and_edges_on_a_face() -> None:
    face = contact_area(Box("tread", Placement.from_wxyz([1.0, 0.0, 0.05]), np.array([0.3, 1.2, 0.1])))
    place = face.locate(np.array([[1.0, 0.0, 0.1], [1.1, 0.0, 0.12], [0.8, 0.0, 0.0]]))
    np.testing.assert_allclose(place.height_m, [0.0, 0.02, -0.1], atol=1e-12)
    np.testing.assert_allclose(place.edge_m, [0.15, 0.05, -0.05], atol=1e-12)
    np.testing.assert_allclose(place.aside_m, [0.0, 0.0, 0.05], atol=1e-12)


def test_the_normal_of_a_rail_lies_in_its_vertical_plane() -> None:
    rail = Rail("rail", np.array([0.0, 1.0, 0.0]), np.array([2.0, 1.0, 1.0]), 0.02)
    top = contact_area(rail)
    a = np.arctan(0.5)
    np.testing.assert_allclose(top.normal, [-np.sin(a), 0.0, np.cos(a)], atol=1e-12)
    np.testing.assert_allclose(top.frame[:, 0], [np.cos(a), 0.0, np.sin(a)], atol=1e-12)
    place = top.locate(np.array([[1.0, 1.0, 0.5] + 0.02 * top.normal, rail.to_m + 0.05 * top.frame[:, 0]]))
    np.testing.assert_allclose(place.distance_m[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(place.edge_m, [np.hypot(2, 1) / 2, -0.05], atol=1e-12)


def test_a_vertical_rail_is_known() -> None:
    post = Rail("post", np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.02)
    assert is_vertical(post)
    np.testing.assert_allclose(contact_area(post).normal, [1.0, 0.0, 0.0])
    assert not is_vertical(Rail("rail", np.zeros(3), np.array([0.1, 0.0, 1.0]), 0.02))


def test_a_terrain_knows_its_boxes_and_rails() -> None:
    box = Box("box", Placement.identity(), np.ones(3))
    rail = Rail("rail", np.zeros(3), np.ones(3), 0.02)
    terrain = Terrain.from_surfaces([rail, box])
    assert (terrain.boxes, terrain.rails) == ((box,), (rail,))


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_every_face_of_a_box_looks_outwards(axis: int, sign: float) -> None:
    box = Box("crate", Placement.from_wxyz([1.0, 2.0, 3.0], [0.9, 0.1, -0.3, 0.2]), np.array([0.4, 0.6, 0.8]))
    normal = sign * box.placement.rotation[:, axis]
    face = face_towards(box, normal + 0.2 * box.placement.rotation[:, axis - 1])
    np.testing.assert_allclose(face.normal, normal, atol=1e-12)
    np.testing.assert_allclose(face.center_m, box.placement.position_m + box.size_m[axis] / 2 * normal, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(face.frame), 1.0)
    corners = face.center_m + face.frame[:, :2] @ face.half_m
    np.testing.assert_allclose(depth_in_box_m(box, corners[np.newaxis]), 0.0, atol=1e-12)


@settings(deadline=None)
@given(
    st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1),
    st.floats(-0.6, 0.6),
    st.floats(-0.6, 0.6),
)
def test_vertical_lines_enter_and_leave_a_box_on_its_faces(q: tuple[float, ...], x: float, y: float) -> None:
    """Just inside the span points are inside, just outside they are not; where there is none, no height is inside."""
    box = Box("crate", Placement.from_wxyz([0.0, 0.0, 0.0], list(q)), np.array([0.4, 0.6, 0.8]))
    low, top = (float(ends[0]) for ends in vertical_span_m(box, np.array([[x, y, 5.0]])))
    heights = np.linspace(-1.0, 1.0, 41) if np.isnan(low) else np.array([low, top, (low + top) / 2])
    depth = depth_in_box_m(box, np.column_stack([np.full_like(heights, x), np.full_like(heights, y), heights]))
    if np.isnan(low):
        assert depth.max() < 1e-9
    else:
        np.testing.assert_allclose(depth[:2], 0.0, atol=1e-9)
        assert depth[2] >= -1e-9
