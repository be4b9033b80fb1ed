"""Meshes of the viewer are closed where they should be and as large as they say."""

from collections import Counter

import numpy as np
import pytest

from stridelab_web.viewer import meshes as shapes


def volume_m3(vertices: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = (vertices[faces[:, k]].astype(float) for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def open_edges(faces: np.ndarray) -> int:
    edges = Counter(tuple(sorted(edge)) for face in faces for edge in zip(face, np.roll(face, -1), strict=True))
    return sum(count == 1 for count in edges.values())


def test_cylinder_reaches_from_zero_to_one() -> None:
    vertices, faces = shapes.cylinder(0.1)
    assert vertices[:, 2].min() == 0
    assert vertices[:, 2].max() == 1
    assert np.linalg.norm(vertices[:, :2], axis=1) == pytest.approx(0.1)
    assert open_edges(faces) == 2 * shapes.SIDES


def test_cone_is_closed_points_up_and_faces_outwards() -> None:
    vertices, faces = shapes.cone(0.3, 0.5)
    assert open_edges(faces) == 0
    assert vertices[vertices[:, 2].argmax()] == pytest.approx([0, 0, 0])
    base = 0.5 * shapes.SIDES * np.sin(2 * np.pi / shapes.SIDES) * 0.3**2
    assert volume_m3(vertices, faces) == pytest.approx(base * 0.5 / 3, rel=1e-5)


def test_tube_keeps_its_distance_from_any_path() -> None:
    t = np.linspace(0, 1, 50)
    helix = np.column_stack([0.3 * np.cos(6 * t), 0.3 * np.sin(6 * t), 2 * t])
    for path in (helix, np.column_stack([0 * t, 0 * t, t]), np.zeros((4, 3))):
        vertices, faces = shapes.tube(path, 0.01)
        rings = vertices.reshape(len(path), -1, 3)
        assert np.linalg.norm(rings - path[:, None], axis=2) == pytest.approx(0.01, rel=1e-4)
        assert faces.max() < len(vertices)


def test_ball_is_round_closed_and_faces_outwards() -> None:
    vertices, faces = shapes.ball(1.0)
    assert np.linalg.norm(vertices, axis=1) == pytest.approx(1.0, abs=1e-6)
    assert open_edges(faces) == 0
    assert 0.9 * 4 / 3 * np.pi < volume_m3(vertices, faces) < 4 / 3 * np.pi


def test_the_two_halves_of_a_ball_face_outwards_and_are_equal() -> None:
    dark, light = shapes.sphere_halves(0.05)
    assert np.linalg.norm(np.concatenate([dark[0], light[0]]), axis=1) == pytest.approx(0.05)
    # each octant is its share of the ball, seen from the middle
    assert volume_m3(*dark) == pytest.approx(volume_m3(*light))
    assert volume_m3(*dark) == pytest.approx(2 / 3 * np.pi * 0.05**3, rel=0.03)
    for (vertices, faces), sign in ((dark, 1), (light, -1)):
        assert (np.sign(vertices[faces].mean(axis=1)).prod(axis=1) == sign).all()


def test_meshes_put_together_keep_their_triangles() -> None:
    meshes = [shapes.cone(0.1, 0.2), shapes.cone(0.2, 0.3)]
    vertices, faces = shapes.merge_meshes(meshes)
    assert volume_m3(vertices, faces) == pytest.approx(sum(volume_m3(*mesh) for mesh in meshes))


def test_a_path_is_drawn_through_few_of_its_points_and_stays_near_all() -> None:
    angle = np.linspace(0, 2 * np.pi, 500)
    path = np.column_stack([np.cos(angle), np.sin(angle), 0.1 * angle])
    simplified = shapes.simplify_path(path, 1e-3)
    assert (simplified[0], simplified[-1]) == (0, 499)
    assert len(simplified) < 150
    between = np.column_stack([np.interp(np.arange(500), simplified, path[simplified, k]) for k in range(3)])
    # a straight piece is as near to the arc at the same share of its length
    assert np.linalg.norm(between - path, axis=1).max() < 1.5e-3
    assert shapes.simplify_path(path[:1].repeat(5, axis=0), 1e-3).tolist() == [0, 4]
    assert shapes.simplify_path(np.array([[0, 0, 0], [2, 0, 0], [1, 0, 0]]), 1e-3).tolist() == [0, 1, 2]
