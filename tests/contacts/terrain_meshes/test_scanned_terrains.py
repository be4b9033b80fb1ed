"""Scans that are generated here: heights, edges and slopes against the truth; what is no surface."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from stridelab.contacts.terrain_meshes.reading import read_terrain_mesh
from stridelab.contacts.terrain_meshes.segmenting import cloud_shapes, mesh_shapes, segment_terrain
from stridelab.contacts.terrain_meshes.surfaces import standing_surfaces
from stridelab.conventions import Points
from support.terrain_scans import flight_rectangles, scan_bar, scan_rectangles

RISE_M, RUN_M, WIDTH_M = 0.16, 0.29, 1.0


def segment_cloud(points_m: Points) -> dict[str, Any]:
    return segment_terrain(cloud_shapes(points_m))


def turn_about_z(points_m: Points, turn_rad: float) -> Points:
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    return np.asarray(points_m @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))


def boxes_by_height(read: dict[str, Any]) -> list[dict[str, Any]]:
    boxes = [one for one in read["terrain"] if one["name"].startswith("surface")]
    return sorted(boxes, key=lambda one: float(one["center_m"][2] + 0.5 * one["size_m"][2]))


@pytest.mark.parametrize(("noise_m", "spacing_m"), [(0.001, 0.01), (0.005, 0.01), (0.002, 0.02), (0.005, 0.03)])
def test_a_noisy_flight_keeps_its_treads(noise_m: float, spacing_m: float) -> None:
    rng = np.random.default_rng(31)
    level, risers = flight_rectangles(RISE_M, RUN_M, 5, WIDTH_M, 1.0)
    points_m = turn_about_z(scan_rectangles(rng, [*level, *risers], spacing_m, noise_m), 0.5)
    outliers_m = rng.uniform(points_m.min(axis=0), points_m.max(axis=0) + 0.3, (len(points_m) // 100, 3))
    read = segment_cloud(np.concatenate([points_m, outliers_m]))
    boxes = boxes_by_height(read)
    assert len(boxes) == 6
    for k, box in enumerate(boxes):
        assert box["center_m"][2] + 0.5 * box["size_m"][2] == pytest.approx(k * RISE_M, abs=0.3 * noise_m + 3e-4)
        depth_m = 1.0 if k in (0, 5) else RUN_M
        assert sorted(box["size_m"][:2]) == pytest.approx(sorted([depth_m, WIDTH_M]), abs=2.0 * spacing_m + 0.02)
    (stairs,) = read["stairs"]
    assert (stairs["rise_m"], stairs["run_m"]) == (
        pytest.approx(RISE_M, abs=0.001),
        pytest.approx(RUN_M, abs=0.01),
    )
    assert stairs["heading_rad"] == pytest.approx(0.5, abs=np.deg2rad(1.0))
    assert len(stairs["treads"]) == 5
    assert stairs["start_m"] == pytest.approx([0.0, 0.0, 0.0], abs=0.02)


def test_a_mesh_with_a_millimetre_of_noise_keeps_its_treads(tmp_path: Path) -> None:
    """Triangles of 2 cm point in all directions then; planes that begin with one of them have no surface."""
    heights = [0.0] * 40 + [0.15] * 15 + [0.3] * 15 + [0.45] * 40
    rng = np.random.default_rng(2)
    nx, ny = len(heights), 50
    x, y = np.meshgrid(0.02 * np.arange(nx), 0.02 * np.arange(ny), indexing="ij")
    vertices = np.column_stack([x.ravel(), y.ravel(), np.repeat(heights, ny)]) + rng.normal(0.0, 1e-3, (nx * ny, 3))
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(nx - 1), np.arange(ny - 1), indexing="ij"))
    at = i * ny + j
    faces = np.concatenate([np.column_stack([at, at + ny, at + ny + 1]), np.column_stack([at, at + ny + 1, at + 1])])
    trimesh.Trimesh(vertices, faces, process=False).export(tmp_path / "scan.ply")
    surfaces = standing_surfaces(read_terrain_mesh(tmp_path / "scan.ply"))
    tops = sorted(one["center_m"][2] + 0.5 * one["size_m"][2] for one in surfaces)
    assert tops == pytest.approx([0.0, 0.15, 0.3, 0.45], abs=5e-4)
    assert min(min(one["size_m"][:2]) for one in surfaces) == pytest.approx(0.28, abs=0.02)


@pytest.mark.parametrize("slope_deg", [5.0, 15.0, 30.0])
def test_a_scanned_ramp_meets_its_floor(slope_deg: float) -> None:
    a = np.deg2rad(slope_deg)
    ramp = ((0.0, -0.5, 0.0), (2.0 * np.cos(a), 0.0, 2.0 * np.sin(a)), (0.0, 1.0, 0.0))
    floor = ((-1.0, -0.5, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    read = segment_cloud(scan_rectangles(np.random.default_rng(4), [floor, ramp], 0.015, 0.002))
    level, tilted = sorted(read["terrain"], key=lambda one: float(one["center_m"][0]))
    blurred_m = 0.02 + 0.006 / np.sin(a)  # three times the noise, seen along the ramp
    assert level["size_m"][:2] == pytest.approx([1.0, 1.0], abs=blurred_m)
    assert tilted["size_m"][:2] == pytest.approx([2.0, 1.0], abs=blurred_m)
    w, _, y, _ = tilted["orientation_wxyz"]
    assert -2.0 * np.arctan2(y, w) == pytest.approx(a, abs=np.deg2rad(0.1))


def test_round_and_steep_ground_hold_no_foot() -> None:
    rng = np.random.default_rng(8)
    ball = rng.normal(size=(60_000, 3))
    ball *= 0.8 / np.linalg.norm(ball, axis=1, keepdims=True)
    a = np.deg2rad(42.0)
    steep = ((1.0, 0.0, 0.0), (np.cos(a), 0.0, np.sin(a)), (0.0, 1.0, 0.0))
    points_m = np.concatenate([ball, scan_rectangles(rng, [steep], 0.02)])
    assert segment_cloud(points_m + rng.normal(0.0, 1e-3, points_m.shape))["terrain"] == []


def test_a_gap_of_the_scan_is_bridged_and_a_hole_is_not() -> None:
    """8 cm without points are surface, as a sole of 20 cm bridges them, unless ground is seen below."""
    rng = np.random.default_rng(3)
    floor = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    points_m = scan_rectangles(rng, [floor], 0.015, 0.001)
    gap = np.linalg.norm(points_m[:, :2] - 0.5, axis=1) < 0.04
    (whole,) = segment_cloud(points_m[~gap])["terrain"]
    assert whole["size_m"][:2] == pytest.approx([1.0, 1.0], abs=0.02)
    below = points_m[gap] - np.array([0.0, 0.0, 0.5])
    parts = segment_cloud(np.concatenate([points_m[~gap], below]))["terrain"]
    assert max(min(one["size_m"][:2]) for one in parts) < 0.5


def test_rails_are_read_and_posts_are_none() -> None:
    rng = np.random.default_rng(12)
    level, risers = flight_rectangles(RISE_M, RUN_M, 5, WIDTH_M, 1.0)
    slope = 4.0 * RISE_M
    ends = ((0.0, 0.45, 0.9), (4.0 * RUN_M, 0.45, 0.9 + slope))
    posts = [((x, 0.45, x * RISE_M / RUN_M), (x, 0.45, 0.88 + x * RISE_M / RUN_M)) for x in (0.05, 1.1)]
    points_m = np.concatenate(
        [
            scan_rectangles(rng, [*level, *risers], 0.015, 0.003),
            scan_bar(rng, ends, 0.022, 0.015, 0.003),
            *(scan_bar(rng, post, 0.02, 0.015, 0.003) for post in posts),
        ]
    )
    read = segment_cloud(points_m)
    (rail,) = [one for one in read["terrain"] if one["kind"] == "rail"]
    assert rail["from_m"] == pytest.approx(ends[0], abs=0.04)
    assert rail["to_m"] == pytest.approx(ends[1], abs=0.04)
    assert rail["radius_m"] == pytest.approx(0.022, abs=0.003)
    assert [one["rails"] for one in read["stairs"]] == [[rail["name"]]]


@pytest.mark.parametrize(("sides", "x_m", "thick_m"), [(1, 0.5, 0.04), (2, 0.55, 0.1)])
def test_a_wall_is_an_obstacle_seen_from_one_side_or_both(sides: int, x_m: float, thick_m: float) -> None:
    floor = ((-1.0, -1.0, 0.0), (3.0, 0.0, 0.0), (0.0, 2.0, 0.0))
    faces = [((0.5, -0.6, 0.0), (0.0, 1.2, 0.0), (0.0, 0.0, 1.5)), ((0.6, -0.6, 0.0), (0.0, 1.2, 0.0), (0.0, 0.0, 1.5))]
    read = segment_cloud(scan_rectangles(np.random.default_rng(6), [floor, *faces[:sides]], 0.02, 0.001))
    (wall,) = [one for one in read["terrain"] if one["name"].startswith("obstacle")]
    assert not any("are no obstacles" in remark for remark in read["remarks"])
    error_m = 0.07 if sides == 1 else 0.04  # the lowest 3 cm of a single face are the floor's
    assert sorted(wall["size_m"]) == pytest.approx([thick_m, 1.2, 1.5], abs=error_m)
    assert wall["center_m"] == pytest.approx([x_m, 0.0, 0.75], abs=0.5 * error_m)


@pytest.mark.parametrize("turn_rad", [0.0, -0.3])
def test_risers_of_a_clean_flight_are_no_walls(turn_rad: float, tmp_path: Path) -> None:
    """Fronts of neighbouring boxes of a flight enclose a tread, on which feet stand."""
    move = trimesh.transformations.translation_matrix
    parts = [trimesh.creation.box((1.2, 1.2, 0.1), move((-0.6, 0.0, -0.05)))]
    for k in range(5):
        depth_m, z = (1.4 if k == 4 else RUN_M), RISE_M * (k + 1)
        parts.append(trimesh.creation.box((depth_m, 1.2, z), move((k * RUN_M + 0.5 * depth_m, 0.0, 0.5 * z))))
    mesh = trimesh.util.concatenate(parts)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(turn_rad, [0, 0, 1]))
    mesh.export(tmp_path / "flight.stl")
    read = segment_terrain(mesh_shapes(read_terrain_mesh(tmp_path / "flight.stl")))
    assert sorted(one["name"] for one in read["terrain"]) == [f"surface {k + 1}" for k in range(6)]
    (stairs,) = read["stairs"]
    assert (stairs["rise_m"], stairs["run_m"]) == pytest.approx((RISE_M, RUN_M), abs=1e-4)


def test_treads_of_a_spiral_are_one_surface_each(tmp_path: Path) -> None:
    """Wedges of 30 degrees that overlap by 4 degrees: the lower one is free where the upper one does not cover it."""
    parts = []
    for k in range(8):
        a0, a1 = np.deg2rad(30.0 * k - 4.0), np.deg2rad(30.0 * (k + 1))
        angles = np.linspace(a0, a1, 8)
        ring = np.concatenate(
            [
                1.3 * np.column_stack([np.cos(angles), np.sin(angles)]),
                0.3 * np.column_stack([np.cos(angles), np.sin(angles)])[::-1],
            ]
        )
        faces = [face for m in range(7) for face in ((m, m + 1, 14 - m), (m, 14 - m, 15 - m))]
        corners = np.column_stack([ring, np.full(len(ring), 0.17 * (k + 1))])
        turned = [(c, b, a) for a, b, c in faces]
        parts.append(trimesh.Trimesh(corners, turned, process=False))
    trimesh.util.concatenate(parts).export(tmp_path / "spiral.stl")
    read = segment_terrain(mesh_shapes(read_terrain_mesh(tmp_path / "spiral.stl")))
    tops = sorted(one["center_m"][2] + 0.5 * one["size_m"][2] for one in read["terrain"])
    assert tops == pytest.approx([0.17 * (k + 1) for k in range(8)], abs=1e-3)
    assert min(min(one["size_m"][:2]) for one in read["terrain"]) > 0.12
    assert read["stairs"] == []
