"""Files whose up axis is any signed axis: stated, or found where the points are clear; else a remark."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from stridelab.contacts.terrain_meshes.reading import UP_AXES, UpAxis
from stridelab.contacts.terrain_meshes.up_axis import find_up_axis
from stridelab.conventions import Points
from stridelab.pipelines.scenarios.read_terrain import read_terrain
from support.terrain_scans import Rectangle
from support.terrain_shapes import FROM_Z_UP, l_stairs, ramp_beside_wall, room_with_table, scan_shape, see_from

RISE_M = 0.16


def save_points(folder: Path, points_m: Points) -> Path:
    file = folder / "terrain.xyz"
    np.savetxt(file, points_m, fmt="%.4f")
    return file


def rises_of(read: Any) -> list[float]:
    return [flight.rise_m for flight in read.stairs]


def names_axis(read: Any, axis: str) -> bool:
    return any(f"with {axis} up" in remark for remark in read.remarks)


@pytest.mark.parametrize("axis", UP_AXES)
def test_axes_are_turned_to_z_up(axis: UpAxis) -> None:
    R = UP_AXES[axis]
    up = np.zeros(3)
    up["xyz".index(axis[1])] = -1.0 if axis[0] == "-" else 1.0
    assert np.allclose(R @ up, [0.0, 0.0, 1.0])
    assert np.allclose(R @ R.T, np.eye(3))
    assert np.linalg.det(R) == pytest.approx(1.0)


@pytest.mark.parametrize("axis", ["-y", "+x"])
def test_stairs_of_a_cloud_tell_which_axis_points_up(axis: UpAxis, tmp_path: Path) -> None:
    points_m = scan_shape(np.random.default_rng(5), l_stairs())
    file = save_points(tmp_path, points_m @ FROM_Z_UP[axis].T)
    found, stated = read_terrain(file), read_terrain(file, up=axis)
    for read in (found, stated):
        assert rises_of(read) == pytest.approx([RISE_M, RISE_M], abs=2e-3)
    assert names_axis(found, axis)
    assert not names_axis(stated, axis)


@pytest.mark.parametrize("height_m", [1.0, 3.0, 6.0])
@pytest.mark.parametrize("shape", [room_with_table, l_stairs, ramp_beside_wall], ids=lambda shape: shape.__name__)
def test_an_upper_floor_about_the_origin_is_no_view_of_a_camera(
    shape: Callable[[], list[Rectangle]], height_m: float
) -> None:
    """With z up, and at such a height, all points lie in the view of a camera at the origin that looks up."""
    points_m = scan_shape(np.random.default_rng(3), shape())
    middle_m = np.append(points_m[:, :2].mean(axis=0), -height_m)
    assert find_up_axis(points_m - middle_m, "+z").axis == "+z"


def test_the_view_of_a_depth_camera_has_minus_y_up(tmp_path: Path) -> None:
    """Ground 1.4 m below the camera, and a wall behind it, which is larger."""
    turned = scan_shape(np.random.default_rng(11), ramp_beside_wall()) * (-1.0, -1.0, 1.0)
    seen = see_from(turned, (-0.8, -4.2, 1.4))
    read = read_terrain(save_points(tmp_path, seen))
    assert names_axis(read, "-y")
    floor, *_ = sorted(read.terrain, key=lambda one: one.center_m[2] if one.kind == "box" else np.inf)
    assert floor.kind == "box"
    assert floor.center_m[2] + 0.5 * floor.size_m[2] == pytest.approx(-1.4, abs=0.01)


def test_an_axis_that_is_not_clear_stays_and_is_named(tmp_path: Path) -> None:
    """A floor and a wall that is larger: which of the two is the ground is not in the points."""
    file = save_points(tmp_path, scan_shape(np.random.default_rng(3), ramp_beside_wall()))
    read = read_terrain(file)
    assert names_axis(read, "+z")
    assert [one.name for one in read.terrain if one.name.startswith("surface")] == ["surface 1", "surface 2"]


def test_a_room_with_its_format_s_axis_has_no_remark_on_it(tmp_path: Path) -> None:
    read = read_terrain(save_points(tmp_path, scan_shape(np.random.default_rng(5), room_with_table())))
    assert not any(" up" in remark for remark in read.remarks)


@pytest.mark.parametrize("axis", ["-y", "-x", "-z"])
def test_a_clean_mesh_is_read_with_any_stated_axis(axis: UpAxis, tmp_path: Path) -> None:
    parts = [
        trimesh.creation.box((0.3, 1.0, RISE_M * (k + 1)), trimesh.transformations.translation_matrix(middle))
        for k in range(4)
        for middle in [(0.3 * k, 0.0, 0.5 * RISE_M * (k + 1))]
    ]
    mesh = trimesh.util.concatenate(parts)
    turned = np.eye(4)
    turned[:3, :3] = FROM_Z_UP[axis]
    mesh.apply_transform(turned)
    mesh.export(tmp_path / "stairs.stl")
    read = read_terrain(tmp_path / "stairs.stl", up=axis)
    assert rises_of(read) == pytest.approx([RISE_M], abs=1e-4)
