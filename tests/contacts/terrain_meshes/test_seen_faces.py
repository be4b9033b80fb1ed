"""Walls, soffits and what has no faces are obstacles of scans; doors and floors beside them stay free."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from stridelab.contacts.terrain_meshes.reading import read_terrain_mesh
from stridelab.contacts.terrain_meshes.segmenting import cloud_shapes, mesh_shapes, segment_terrain
from stridelab.contacts.terrain_meshes.shapes import lie_in_boxes
from stridelab.conventions import Mask, Points
from support.terrain_scans import Rectangle, scan_rectangles
from support.terrain_shapes import box_faces, room_with_table, scan_shape


def solids_of(read: dict[str, Any]) -> list[dict[str, Any]]:
    return [one for one in read["terrain"] if one["kind"] == "box"]


def are_blocked(read: dict[str, Any], points_m: list[tuple[float, float, float]]) -> Mask:
    places: Points = np.array(points_m)
    return lie_in_boxes(solids_of(read), places, 0.01)


def test_walls_of_a_room_block_and_its_door_does_not() -> None:
    read = segment_terrain(cloud_shapes(scan_shape(np.random.default_rng(5), room_with_table())))
    heights_m = (0.3, 0.9, 1.5)
    walls = [(x, 3.0, z) for x in (0.4, 2.0, 3.6) for z in heights_m] + [
        (4.0, y, z) for y in (0.5, 2.6) for z in heights_m
    ]
    door = [(4.0, y, z) for y in (1.35, 1.65, 1.95) for z in heights_m]
    assert are_blocked(read, walls).all()
    assert not are_blocked(read, door).any()
    assert not any("are no obstacles" in remark for remark in read["remarks"])


def test_the_soffit_of_an_open_mesh_is_an_obstacle_without_headroom_below(tmp_path: Path) -> None:
    """A floor of 3 by 2 m, and above its last metre one face that looks down, 1.3 m high."""
    corners = np.array(
        [(0, 0, 0), (3, 0, 0), (3, 2, 0), (0, 2, 0), (2, 0, 1.3), (3, 0, 1.3), (3, 2, 1.3), (2, 2, 1.3)], float
    )
    faces = [(0, 1, 2), (0, 2, 3), (4, 6, 5), (4, 7, 6)]
    trimesh.Trimesh(corners, faces, process=False).export(tmp_path / "soffit.stl")
    read = segment_terrain(mesh_shapes(read_terrain_mesh(tmp_path / "soffit.stl")))
    assert are_blocked(read, [(2.2, 0.5, 1.3), (2.8, 1.5, 1.3)]).all()
    (floor,) = [one for one in read["terrain"] if one["name"].startswith("surface")]
    assert floor["center_m"][0] + 0.5 * floor["size_m"][0] < 2.1


@pytest.mark.parametrize("thick_m", [0.04, 0.1, 0.2])
def test_the_underside_of_a_ramp_is_no_obstacle_to_those_who_walk_up(thick_m: float, tmp_path: Path) -> None:
    """A slab of 3 m from the floor up to a platform, 12 degrees steep."""
    slope_rad = np.deg2rad(12.0)
    slab = trimesh.creation.box((3.0, 1.2, thick_m))
    slab.apply_transform(trimesh.transformations.rotation_matrix(-slope_rad, (0, 1, 0)))
    along, normal = np.array([np.cos(slope_rad), 0.0, np.sin(slope_rad)]), [-np.sin(slope_rad), 0.0, np.cos(slope_rad)]
    slab.apply_translation(1.5 * along - 0.5 * thick_m * np.array(normal))
    floor, platform = trimesh.creation.box((1.0, 1.2, 0.3)), trimesh.creation.box((1.2, 1.2, 0.2))
    floor.apply_translation((-0.5, 0.0, -0.15))
    platform.apply_translation(3.0 * along + (0.6, 0.0, -0.1))
    trimesh.util.concatenate([floor, slab, platform]).export(tmp_path / "ramp.stl")
    read = segment_terrain(mesh_shapes(read_terrain_mesh(tmp_path / "ramp.stl")))
    assert [one["name"] for one in read["terrain"]] == ["surface 1", "surface 2", "surface 3"]


def test_a_column_is_an_obstacle() -> None:
    rng = np.random.default_rng(9)
    floor: Rectangle = ((-1.5, -1.5, 0.0), (3.0, 0.0, 0.0), (0.0, 3.0, 0.0))
    turn, z = rng.uniform(0.0, 2.0 * np.pi, 4000), rng.uniform(0.0, 2.0, 4000)
    column = np.column_stack([0.2 * np.cos(turn), 0.2 * np.sin(turn), z])
    ground = scan_rectangles(rng, [floor], 0.02, 0.002)
    ground = ground[np.linalg.norm(ground[:, :2], axis=1) > 0.2]
    read = segment_terrain(cloud_shapes(np.concatenate([ground, column + rng.normal(0.0, 0.002, column.shape)])))
    around = [(0.19 * np.cos(a), 0.19 * np.sin(a), z) for a in (0.0, 1.6, 3.1, 4.7) for z in (0.4, 1.0, 1.6)]
    assert are_blocked(read, around).all()
    assert not are_blocked(read, [(0.4, 0.0, 1.0), (0.0, -0.4, 0.5)]).any()


def test_a_box_on_the_floor_has_no_lip_of_obstacles() -> None:
    read = segment_terrain(
        cloud_shapes(scan_rectangles(np.random.default_rng(2), box_faces((0.0, 1.2), (0.0, 1.0), 0.3), 0.02, 0.002))
    )
    tops = [one["center_m"][2] + 0.5 * one["size_m"][2] for one in solids_of(read)]
    assert max(tops) < 0.305


def test_a_hole_in_a_scan_is_closed_up_to_30_cm_unless_something_is_seen_below() -> None:
    rng = np.random.default_rng(3)
    floor: Rectangle = ((0.0, 0.0, 1.0), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0))
    points_m = scan_rectangles(rng, [floor], 0.02, 0.001)
    away_m = np.linalg.norm(points_m[:, :2] - 1.0, axis=1)
    for radius_m, below, count in ((0.12, False, 1), (0.12, True, 4), (0.2, False, 4)):
        seen = points_m[away_m > radius_m]
        if below:
            seen = np.concatenate([seen, points_m[away_m < 0.05] - (0.0, 0.0, 0.5)])
        read = segment_terrain(cloud_shapes(seen))
        high = [one for one in solids_of(read) if one["center_m"][2] + 0.5 * one["size_m"][2] > 0.9]
        assert len(high) == count, (radius_m, below)
