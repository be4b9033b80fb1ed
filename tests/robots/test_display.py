"""Display meshes against the files they come from, poses against forward kinematics, GLB against another reader."""

import io
import json
import struct
import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest
import trimesh
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from stridelab.errors import Unavailable
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.robots.visuals import (
    TOLERANCES_M,
    LinkMesh,
    decimate,
    glb,
    link_meshes,
    link_names,
    link_poses,
    merge_meshes,
    mesh_of,
    split_glb,
    srgb_to_linear,
)

SPACING_M = 0.003
"""Distance of neighbouring points where a surface is sampled, and so the error of distances to it."""


@pytest.fixture(scope="module")
def talos() -> Robot:
    return load_robot("talos")


@pytest.fixture(scope="module")
def meshes(talos: Robot) -> tuple[LinkMesh, ...]:
    return link_meshes(talos)


@pytest.fixture(scope="module")
def read_back(meshes: tuple[LinkMesh, ...]) -> trimesh.Scene:
    scene = trimesh.load(io.BytesIO(glb(meshes)), file_type="glb", process=False)
    assert isinstance(scene, trimesh.Scene)
    return scene


def original(robot: Robot, link: str) -> trimesh.Trimesh:
    """The visual mesh of one link as trimesh reads the file that the URDF names, scaled and placed as it says."""
    tree = ET.parse(robot.urdf)
    visual = tree.find(f"link[@name='{link}']/visual")
    assert visual is not None
    shape, origin = visual.find("geometry/mesh"), visual.find("origin")
    assert shape is not None
    path = robot.package_dirs[0] / shape.attrib["filename"].removeprefix("package://")
    mesh = trimesh.load_mesh(path)
    mesh.apply_scale([float(v) for v in shape.attrib.get("scale", "1 1 1").split()])
    if origin is not None:
        T = np.eye(4)
        T[:3, 3] = [float(v) for v in origin.attrib.get("xyz", "0 0 0").split()]
        T[:3, :3] = Rotation.from_euler(
            "xyz", [float(v) for v in origin.attrib.get("rpy", "0 0 0").split()]
        ).as_matrix()
        mesh.apply_transform(T)
    return mesh


def sampled(mesh: trimesh.Trimesh) -> np.ndarray:
    points, _ = trimesh.sample.sample_surface(mesh, int(2.0 * mesh.area / SPACING_M**2), seed=3)
    return points


def test_one_mesh_and_one_pose_per_moving_joint_named_after_the_link(
    talos: Robot, meshes: tuple[LinkMesh, ...]
) -> None:
    children = {
        joint.attrib["name"]: child.attrib["link"]
        for joint in ET.parse(talos.urdf).iterfind("joint")
        if (child := joint.find("child")) is not None
    }
    expected = ("base_link", *(children[joint] for joint in talos.joint_names))
    assert link_names(talos) == expected
    assert tuple(mesh.name for mesh in meshes) == expected


def test_poses_are_those_of_forward_kinematics(talos: Robot) -> None:
    """Oracle: the frames that the URDF gives the links, in a configuration where everything has moved."""
    rng = np.random.default_rng(4)
    q = talos.q_reference.copy()
    q[:3] = [0.4, -0.2, 1.3]
    q[3:7] = Rotation.from_euler("xyz", [0.3, -0.4, 2.9]).as_quat()
    q[7:] = rng.uniform(talos.model.lowerPositionLimit[7:], talos.model.upperPositionLimit[7:])
    data = talos.model.createData()
    pin.framesForwardKinematics(talos.model, data, q)
    for name, pose in zip(link_names(talos), link_poses(talos, q), strict=True):
        T_world_link = data.oMf[talos.model.getFrameId(name)]
        assert pose[:3] == pytest.approx(T_world_link.translation, abs=1e-12)
        assert Rotation.from_quat(pose[[4, 5, 6, 3]]).as_matrix() == pytest.approx(T_world_link.rotation, abs=1e-12)
        assert pose[3] >= 0.0
    assert link_poses(talos, q)[0, :3] == pytest.approx([0.4, -0.2, 1.3])


@pytest.mark.parametrize(
    ("link", "p99_mm", "worst_mm"),
    [
        ("base_link", 4.0, 6.0),
        ("leg_left_4_link", 4.0, 7.0),
        ("leg_right_6_link", 4.0, 13.0),
        ("leg_right_3_link", 4.0, 13.0),
        ("arm_left_2_link", 3.0, 4.0),
        ("torso_1_link", 3.0, 4.0),
    ],
)
def test_decimated_surfaces_stay_near_the_originals(talos: Robot, link: str, p99_mm: float, worst_mm: float) -> None:
    """From every vertex of the original to the surface and back; includes up to 2 mm of sampling."""
    mesh = original(talos, link)
    vertices_m, faces = decimate(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    there_mm = 1e3 * cKDTree(sampled(trimesh.Trimesh(vertices_m, faces, process=False))).query(mesh.vertices)[0]
    back_mm = 1e3 * cKDTree(sampled(mesh)).query(vertices_m)[0]
    assert np.percentile(there_mm, 99) < p99_mm
    assert there_mm.max() < worst_mm
    assert back_mm.max() < worst_mm
    assert len(faces) < len(mesh.faces)


@pytest.mark.parametrize("link", ["leg_left_4_link", "leg_right_6_link", "torso_2_link", "head_2_link"])
def test_the_outline_of_a_link_of_the_shown_robot_is_that_of_its_file(talos: Robot, link: str) -> None:
    """From three sides, on a grid of 4 mm: what one shows and the other does not is at most 8 mm from the outline."""
    source = original(talos, link)
    vertices_m, faces = decimate(np.asarray(source.vertices), np.asarray(source.faces), TOLERANCES_M[1])
    shown = trimesh.Trimesh(vertices_m, faces, process=False)
    low = source.bounds[0] - 0.05
    for axes in ([0, 1], [0, 2], [1, 2]):
        size = np.ceil((np.ptp(source.bounds, axis=0)[axes] + 0.1) / 0.004).astype(int)
        covered = []
        for mesh in (source, shown):
            cells = ((sampled(mesh) - low)[:, axes] / 0.004).astype(int)
            covered.append(np.zeros(size, dtype=bool))
            covered[-1][tuple(cells.T)] = True
        for one, other in (covered, covered[::-1]):
            away = distance_transform_edt(~other)[one]
            assert 4.0 * away.max() <= 8.0, axes
            assert (away > 0).mean() < 0.02, axes


def test_the_whole_robot_is_light_enough_to_be_sent_and_drawn(meshes: tuple[LinkMesh, ...]) -> None:
    """A scene has 40 000 triangles at most, and the robot is not alone in it."""
    assert 25_000 < sum(len(mesh.faces) for mesh in meshes) < 36_000
    assert len(glb(meshes)) < 900_000


def test_left_and_right_are_mirror_images_with_the_same_outside(meshes: tuple[LinkMesh, ...]) -> None:
    """The right leg's meshes are mirrored left ones: turned inside out, they would have a negative volume."""
    by_name = {mesh.name: trimesh.Trimesh(mesh.vertices_m, mesh.faces, process=False) for mesh in meshes}
    for number in range(1, 7):
        left, right = (by_name[f"leg_{side}_{number}_link"] for side in ("left", "right"))
        assert left.volume > 0.0
        assert right.volume == pytest.approx(left.volume, rel=1e-9)
        assert right.bounds[0] * [1, -1, 1] == pytest.approx(
            np.array([left.bounds[0, 0], left.bounds[1, 1], left.bounds[0, 2]])
        )


def test_head_and_grippers_belong_to_the_links_they_are_locked_on(talos: Robot, meshes: tuple[LinkMesh, ...]) -> None:
    by_name = {mesh.name: mesh for mesh in meshes}
    poses = dict(zip(link_names(talos), link_poses(talos, talos.q_reference), strict=True))
    top_m = max(
        (Rotation.from_quat(poses[name][[4, 5, 6, 3]]).apply(mesh.vertices_m) + poses[name][:3])[:, 2].max()
        for name, mesh in by_name.items()
    )
    assert top_m == pytest.approx(1.75 - 0.02, abs=0.06), "TALOS is 1.75 m tall; half-sitting takes a few centimetres"
    alone = original(talos, "arm_left_7_link")
    assert by_name["arm_left_7_link"].vertices_m[:, 2].min() < alone.bounds[0, 2] - 0.1, "the fingers hang below"


def test_colours_are_those_of_the_urdf(meshes: tuple[LinkMesh, ...]) -> None:
    by_name = {mesh.name: mesh for mesh in meshes}
    assert np.unique(by_name["base_link"].colours, axis=0).tolist() == [[229, 229, 229, 255]]
    assert np.unique(by_name["leg_left_1_link"].colours, axis=0).tolist() == [[51, 51, 51, 255]]
    hand = {tuple(colour) for colour in by_name["arm_left_7_link"].colours.tolist()}
    assert {(51, 51, 51, 255), (255, 128, 0, 255)} <= hand, "a grey wrist and orange fingers"


def test_a_reader_of_glb_finds_the_same_nodes_shapes_and_colours(
    meshes: tuple[LinkMesh, ...], read_back: trimesh.Scene
) -> None:
    assert sorted(read_back.graph.nodes_geometry) == sorted(mesh.name for mesh in meshes)
    for mesh in meshes:
        T_world_node, geometry = read_back.graph[mesh.name]
        read_mesh = read_back.geometry[geometry]
        assert (T_world_node == np.eye(4)).all()
        assert read_mesh.bounds[0] == pytest.approx(mesh.vertices_m.min(axis=0), abs=1e-6)
        assert read_mesh.bounds[1] == pytest.approx(mesh.vertices_m.max(axis=0), abs=1e-6)
        assert (read_mesh.faces == mesh.faces).all()
        assert (read_mesh.visual.vertex_attributes["color"] == srgb_to_linear(mesh.colours)).all()
        assert read_mesh.visual.material.metallicFactor == 0.0


def test_colours_of_a_screen_become_linear_light() -> None:
    """Mid-grey by the standard's table; every tone comes back within 7 of 255; the opacity is no colour."""
    tones = np.arange(256)
    light = srgb_to_linear(np.repeat(tones[:, None], 4, axis=1).astype(np.uint8))
    assert light[[0, 188, 255], 0].tolist() == [0, 128, 255]
    assert (light[:, 3] == tones).all()
    share = light[:, 0] / 255.0
    back = 255.0 * np.where(share <= 0.0031308, 12.92 * share, 1.055 * share ** (1 / 2.4) - 0.055)
    assert np.abs(back - tones).max() < 7.0


def test_the_glb_is_well_formed(meshes: tuple[LinkMesh, ...]) -> None:
    """Lengths and alignment as glTF 2.0 demands: a browser refuses what trimesh forgives."""
    data = glb(meshes)
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    n_json, kind = struct.unpack_from("<I4s", data, 12)
    document = json.loads(data[20 : 20 + n_json])
    n_binary, binary = struct.unpack_from("<I4s", data, 20 + n_json)
    assert (kind, binary, n_json % 4, n_binary % 4) == (b"JSON", b"BIN\0", 0, 0)
    assert 28 + n_json + n_binary == len(data)
    assert document["buffers"] == [{"byteLength": n_binary}]
    ends = [view["byteOffset"] + view["byteLength"] for view in document["bufferViews"]]
    assert [0, *ends[:-1]] == [view["byteOffset"] for view in document["bufferViews"]]
    assert ends[-1] == n_binary
    assert all(view["byteOffset"] % 4 == 0 for view in document["bufferViews"])


def test_a_link_without_a_shape_is_an_empty_node() -> None:
    nothing = merge_meshes("nothing", [])
    something = LinkMesh("thing", np.eye(3), np.array([[0, 1, 2]]), np.full((3, 4), 255, np.uint8))
    data = glb([nothing, something])
    n_json, _ = struct.unpack_from("<I4s", data, 12)
    assert json.loads(data[20 : 20 + n_json])["nodes"] == [{"name": "nothing"}, {"name": "thing", "mesh": 0}]


def test_merging_moves_the_triangles_along() -> None:
    part = LinkMesh("part", np.eye(3), np.array([[0, 1, 2]]), np.zeros((3, 4), np.uint8))
    both = merge_meshes("both", [part, part])
    assert both.faces.tolist() == [[0, 1, 2], [3, 4, 5]]
    assert (both.vertices_m == np.tile(np.eye(3), (2, 1))).all()


def test_decimation_flattens_a_plane_and_keeps_its_rim() -> None:
    grid = np.array([[x, y, 0.0] for x in range(11) for y in range(11)]) * 0.01
    quads = [(i * 11 + j, (i + 1) * 11 + j, (i + 1) * 11 + j + 1, i * 11 + j + 1) for i in range(10) for j in range(10)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    vertices, triangles = decimate(grid, faces)
    decimated = trimesh.Trimesh(vertices, triangles, process=False)
    assert len(triangles) < len(faces) / 2
    assert decimated.area == pytest.approx(0.01, rel=1e-6)
    assert decimated.bounds == pytest.approx(np.array([[0.0, 0.0, 0.0], [0.1, 0.1, 0.0]]))


@pytest.mark.parametrize(
    ("shape", "extent_m"),
    [
        ("Cylinder(0.1, 0.4)", (0.2, 0.2, 0.4)),
        ("Box(0.1, 0.2, 0.3)", (0.1, 0.2, 0.3)),
        ("Sphere(0.1)", (0.2, 0.2, 0.2)),
    ],
)
def test_simple_shapes_have_their_size(shape: str, extent_m: tuple[float, float, float]) -> None:
    import coal

    kind, sizes = shape.rstrip(")").split("(")
    geometry = getattr(coal, kind)(*(float(size) for size in sizes.split(",")))
    placed = pin.SE3(np.eye(3), np.array([1.0, 2.0, 3.0]))
    mesh = mesh_of(pin.GeometryObject("shape", 1, placed, geometry))
    assert mesh.vertices_m.max(axis=0) - mesh.vertices_m.min(axis=0) == pytest.approx(extent_m, rel=0.01)
    assert (mesh.vertices_m.max(axis=0) + mesh.vertices_m.min(axis=0)) / 2 == pytest.approx([1.0, 2.0, 3.0])


def test_a_shape_that_cannot_be_shown_is_reported() -> None:
    import coal

    plane = pin.GeometryObject("floor", 1, pin.SE3.Identity(), coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0))
    with pytest.raises(Unavailable, match="floor is a Halfspace"):
        mesh_of(plane)


def test_a_file_of_all_links_splits_into_the_files_of_each(meshes: tuple[LinkMesh, ...]) -> None:
    empty = LinkMesh("bare", np.zeros((0, 3)), np.zeros((0, 3), np.int64), np.zeros((0, 4), np.uint8))
    links = (*meshes, empty)
    assert split_glb(glb(links)) == {link.name: glb([link]) for link in links}


def test_a_cut_file_of_links_is_refused(meshes: tuple[LinkMesh, ...]) -> None:
    for damaged in (b"", b"glTF", glb(meshes[:2])[:-1]):
        with pytest.raises(ValueError, match="GLB"):
            split_glb(damaged)
