"""Meshes of terrains that are made here: the surfaces that are found, and the files that are refused."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.terrain_meshes.crossing import crossing_task
from stridelab.contacts.terrain_meshes.reading import UpAxis, read_terrain_mesh
from stridelab.contacts.terrain_meshes.surfaces import SHORTEST_EDGE_M, standing_surfaces
from stridelab.errors import InvalidInput, UnreadableFile

Extents = tuple[float, float, float]
RISE_M, DEPTH_M = 0.12, 0.3
STAIRS: Sequence[tuple[Extents, Extents]] = (
    ((2.0, 1.2, 0.1), (-0.5, 0.0, -0.05)),
    ((DEPTH_M, 1.2, RISE_M), (0.65, 0.0, 0.5 * RISE_M)),
    ((DEPTH_M, 1.2, 2 * RISE_M), (0.95, 0.0, RISE_M)),
    ((1.5, 1.2, 3 * RISE_M), (1.85, 0.0, 1.5 * RISE_M)),
)
"""Edges and middles of the boxes: a floor, two treads and a landing."""


def mesh_of_boxes(boxes: Sequence[tuple[Extents, Extents]]) -> trimesh.Trimesh:
    parts = [
        trimesh.creation.box(extents=size, transform=trimesh.transformations.translation_matrix(middle))
        for size, middle in boxes
    ]
    mesh = trimesh.util.concatenate(parts)
    assert isinstance(mesh, trimesh.Trimesh)
    return mesh


def surfaces_of_file(
    mesh: trimesh.Trimesh, file: Path, scale: float = 1.0, up: UpAxis | None = None
) -> list[dict[str, Any]]:
    """Surfaces in the file of a mesh, by their height."""
    mesh.export(file)
    surfaces = standing_surfaces(read_terrain_mesh(file, metres_per_unit=scale, up=up))
    return sorted(surfaces, key=lambda one: float(one["center_m"][2] + 0.5 * one["size_m"][2]))


def assert_is_stairs(surfaces: list[dict[str, Any]], turn_rad: float = 0.0) -> None:
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    assert len(surfaces) == len(STAIRS)
    for surface, (size, (x, y, z)) in zip(surfaces, STAIRS, strict=True):
        top_m = surface["center_m"][2] + 0.5 * surface["size_m"][2]
        assert surface["size_m"][:2] == pytest.approx(size[:2], abs=1e-5)
        assert surface["center_m"][:2] == pytest.approx([c * x - s * y, s * x + c * y], abs=1e-5)
        assert top_m == pytest.approx(z + 0.5 * size[2], abs=1e-5)
        assert surface["orientation_wxyz"] == pytest.approx(
            [np.cos(turn_rad / 2), 0, 0, np.sin(turn_rad / 2)], abs=1e-5
        )


@pytest.mark.parametrize("ending", ["stl", "ply", "obj"])
def test_stairs_keep_their_treads_to_a_hundredth_of_a_millimetre(ending: str, tmp_path: Path) -> None:
    assert_is_stairs(surfaces_of_file(mesh_of_boxes(STAIRS), tmp_path / f"stairs.{ending}"))


@pytest.mark.parametrize("turn_rad", [0.4, -0.7])
def test_turned_stairs(turn_rad: float, tmp_path: Path) -> None:
    mesh = mesh_of_boxes(STAIRS)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(turn_rad, [0, 0, 1]))
    assert_is_stairs(surfaces_of_file(mesh, tmp_path / "stairs.ply"), turn_rad)


def test_other_units_axes_and_insides(tmp_path: Path) -> None:
    """Millimetres as stated, y up as the standard of GLB says, and triangles that face inwards."""
    millimetres, y_up, inverted = (mesh_of_boxes(STAIRS) for _ in range(3))
    millimetres.apply_scale(1000.0)
    assert_is_stairs(surfaces_of_file(millimetres, tmp_path / "stairs.stl", 1e-3))
    y_up.apply_transform(trimesh.transformations.rotation_matrix(-0.5 * np.pi, [1, 0, 0]))
    assert_is_stairs(surfaces_of_file(y_up, tmp_path / "stairs.glb"))
    assert_is_stairs(surfaces_of_file(y_up, tmp_path / "y.stl", up="+y"))
    inverted.invert()
    assert_is_stairs(surfaces_of_file(inverted, tmp_path / "inverted.stl"))


def test_an_open_sheet_of_a_landing_is_two_rectangles(tmp_path: Path) -> None:
    """An L of 2 m by 2 m without a quarter, seen from above, in three triangulated squares."""
    corners = np.array([[x, y, 0.5] for x in (0, 1, 2) for y in (0, 1, 2)], float)
    squares = [(0, 3, 4, 1), (3, 6, 7, 4), (1, 4, 5, 2)]
    faces = [face for a, b, c, d in squares for face in ((a, b, c), (a, c, d))]
    surfaces = surfaces_of_file(trimesh.Trimesh(corners, faces, process=False), tmp_path / "landing.obj")
    assert sorted(sorted(one["size_m"][:2]) for one in surfaces) == [[1.0, 1.0], [1.0, 2.0]]


def test_the_floor_below_a_table_holds_nobody(tmp_path: Path) -> None:
    table: Sequence[tuple[Extents, Extents]] = (
        ((3.0, 1.0, 0.1), (0.0, 0.0, -0.05)),
        ((1.0, 1.0, 0.05), (0.0, 0.0, 0.7)),
    )
    floor_left, floor_right, top = surfaces_of_file(mesh_of_boxes(table), tmp_path / "table.stl")
    assert [one["size_m"][:2] for one in (floor_left, floor_right, top)] == [
        pytest.approx([1.0, 1.0], abs=0.03),
        pytest.approx([1.0, 1.0], abs=0.03),
        pytest.approx([1.0, 1.0]),
    ]
    assert {np.sign(one["center_m"][0]) for one in (floor_left, floor_right)} == {-1.0, 1.0}


@pytest.mark.parametrize(("slope_deg", "is_found"), [(12.0, True), (34.0, True), (36.0, False)])
def test_a_ramp_is_tilted_and_a_steep_one_is_none(slope_deg: float, is_found: bool, tmp_path: Path) -> None:
    slope = np.deg2rad(slope_deg)
    mesh = trimesh.creation.box(extents=(2.0, 1.0, 0.1))
    mesh.apply_transform(trimesh.transformations.rotation_matrix(-slope, [0, 1, 0]))
    surfaces = surfaces_of_file(mesh, tmp_path / "ramp.stl")
    assert len(surfaces) == is_found
    for surface in surfaces:
        assert surface["size_m"][:2] == pytest.approx([2.0, 1.0], abs=1e-5)
        assert surface["orientation_wxyz"] == pytest.approx([np.cos(slope / 2), 0, -np.sin(slope / 2), 0], abs=1e-5)


def test_rubble_and_a_ball_hold_no_foot(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    mesh = trimesh.util.concatenate(
        [
            trimesh.creation.icosphere(3, radius=1.0),
            *(trimesh.creation.box(extents=(0.09, 0.09, 0.09), transform=random_shift(rng)) for _ in range(200)),
        ]
    )
    assert surfaces_of_file(mesh, tmp_path / "rubble.ply") == []
    assert SHORTEST_EDGE_M > 0.09


def random_shift(rng: np.random.Generator) -> Any:
    return trimesh.transformations.translation_matrix(np.append(rng.uniform(-2, 2, 2), 3.0))


def test_a_million_metres_and_broken_files_are_refused(tmp_path: Path) -> None:
    files: dict[str, bytes] = {
        "letters.stl": b"no mesh at all",
        "empty.ply": b"",
        "half.stl": bytes(80) + (1000).to_bytes(4, "little") + bytes(200),
        "many.stl": bytes(80) + (2**32 - 1).to_bytes(4, "little") + bytes(50),
        "points.ply": b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
        b"end_header\n0 0 0\n",
        "nan.obj": b"v 0 0 0\nv 1 0 nan\nv 0 1 0\nf 1 2 3\n",
        "beyond.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n",
        "huge.obj": b"v 0 0 0\nv 1e6 0 0\nv 0 1e6 0\nf 1 2 3\n",
        "small.obj": b"v 0 0 0\nv 0.01 0 0\nv 0 0.01 0\nf 1 2 3\n",
        "scene.dae": b"<COLLADA/>",
    }
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(UnreadableFile) as refusal:
            read_terrain_mesh(tmp_path / name)
        assert refusal.value.code == "terrain-mesh-unreadable", name
        assert refusal.value.faults[0].where == name


def test_feet_stand_on_the_highest_surfaces_and_face_the_goal(tmp_path: Path) -> None:
    surfaces = surfaces_of_file(mesh_of_boxes(STAIRS), tmp_path / "stairs.stl")
    task = crossing_task(surfaces, (-0.5, 0.0), (2.2, 0.1), effector_shapes("talos"))
    start, goal = (task[end]["contacts"] for end in ("start", "goal"))
    assert [one["effector"] for one in start] == ["left_foot", "right_foot"]
    assert [one["position_m"][2] for one in (*start, *goal)] == pytest.approx([0.0, 0.0, 3 * RISE_M, 3 * RISE_M])
    assert start[0]["position_m"][1] > start[1]["position_m"][1]
    yaw = np.arctan2(0.1, 2.7)
    assert start[0]["orientation_wxyz"] == pytest.approx([np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)])
    for place, code in (((9.0, 0.0), "terrain-without-foothold"), ((-0.4, 0.0), "crossing-too-short")):
        with pytest.raises(InvalidInput) as refusal:
            crossing_task(surfaces, (-0.5, 0.0), place, effector_shapes("talos"))
        assert refusal.value.code == code
