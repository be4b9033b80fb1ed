"""Files of clouds, height maps and scenes that are written here: what is read of them, and what is refused by name."""

import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from stridelab.contacts.terrain_meshes.clouds import has_faces, read_cloud
from stridelab.contacts.terrain_meshes.height_maps import read_ascii_grid, read_height_image
from stridelab.contacts.terrain_meshes.scenes import read_scene
from stridelab.contacts.terrain_meshes.segmenting import segment_terrain
from stridelab.errors import UnreadableFile
from stridelab.pipelines.scenarios.read_terrain import read_terrain

X, Y = (grid.ravel() for grid in np.meshgrid(0.05 * np.arange(20), 0.05 * np.arange(15)))
POINTS = np.column_stack([X, Y, 0.1 * (X > 0.49)])
PLY = "ply\nformat {kind} 1.0\nelement vertex {count}\n{fields}end_header\n"
PCD = (
    "# .PCD v0.7\nVERSION 0.7\nFIELDS intensity x y z\nSIZE 1 4 4 4\nTYPE U F F F\nCOUNT 1 1 1 1\nWIDTH {count}\n"
    "HEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA {kind}\n"
)


def text_of(points: np.ndarray, separator: str = " ", more: str = "") -> str:
    return "".join(separator.join(f"{value:.4f}" for value in row) + more + "\n" for row in points)


def cloud_files() -> dict[str, bytes]:
    """The same points in every format."""
    count = len(POINTS)
    doubles = "".join(f"property double {axis}\n" for axis in "xyz")
    floats = "property uchar red\n" + "".join(f"property float {axis}\n" for axis in "xyz")
    little = b"".join(struct.pack("<B3f", 7, *row) for row in POINTS)
    big = b"".join(struct.pack(">B3f", 7, *row) for row in POINTS)
    return {
        "text.ply": (PLY.format(kind="ascii", count=count, fields=doubles) + text_of(POINTS)).encode(),
        "little.ply": PLY.format(kind="binary_little_endian", count=count, fields=floats).encode() + little,
        "big.ply": PLY.format(kind="binary_big_endian", count=count, fields=floats).encode() + big,
        "plain.xyz": text_of(POINTS, more=" 12 200 3").encode(),
        "commented.xyz": b"# x y z\n" + text_of(POINTS).encode(),
        "counted.pts": f"{count}\n{text_of(POINTS)}".encode(),
        "named.csv": b"time;y;x;z\n" + "".join(f"0.5;{y:.4f};{x:.4f};{z:.4f}\n" for x, y, z in POINTS).encode(),
        "commas.csv": text_of(POINTS, ",").encode(),
        "text.pcd": PCD.format(count=count, kind="ascii").encode()
        + "".join(f"7 {x:.4f} {y:.4f} {z:.4f}\n" for x, y, z in POINTS).encode(),
        "binary.pcd": PCD.format(count=count, kind="binary").encode() + little,
    }


@pytest.mark.parametrize("name", sorted(cloud_files()))
def test_clouds_are_the_same_in_every_format(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(cloud_files()[name])
    assert read_cloud(tmp_path / name) == pytest.approx(POINTS, abs=1e-4)
    assert not has_faces(tmp_path / name)


def test_points_without_coordinates_are_left_out(tmp_path: Path) -> None:
    rows = np.concatenate([POINTS, np.full((50, 3), np.nan)])
    (tmp_path / "cloud.xyz").write_text(text_of(rows), encoding="utf-8")
    assert len(read_cloud(tmp_path / "cloud.xyz")) == len(POINTS)


def refused_files() -> dict[str, tuple[bytes, str]]:
    count = len(POINTS)
    floats = "".join(f"property float {axis}\n" for axis in "xyz")
    lone = PLY.format(kind="ascii", count=count, fields=floats)
    return {
        "empty.xyz": (b"", "no row of three numbers"),
        "letters.xyz": (b"a terrain of mine\n" * 300, "Line 1"),
        "broken.xyz": (text_of(POINTS).encode() + b"1 2 x\n", "damaged"),
        "few.xyz": (text_of(POINTS[:20]).encode(), "20 points with coordinates"),
        "millimetres.xyz": (text_of(5000.0 * POINTS).encode(), "in millimetres it would be 4.75 m wide"),
        "nan.xyz": (b"nan nan nan\n" * 200, "200 without"),
        "compressed.pcd": (PCD.format(count=count, kind="binary_compressed").encode() + bytes(99), "compressed"),
        "short.pcd": (PCD.format(count=count, kind="binary").encode() + bytes(130), "ends after 10 of 300 points"),
        "many.pcd": (PCD.format(count=10**12, kind="binary").encode(), "states 1000000000000 points"),
        "headless.pcd": (b"# nothing\n", "damaged"),
        "half.ply": (lone.encode() + text_of(POINTS[:50]).encode(), "50 points with coordinates"),
        "faces_first.ply": (lone.replace("vertex", "edge").encode(), "first element"),
        "short.asc": (b"ncols 3\nnrows 2\ncellsize 0.1\n1 2 3 4 5\n", "5 values"),
        "headless.asc": (b"1 2 3\n4 5 6\n", "does not state nrows"),
        "words.asc": (b"ncols 3\nnrows 2\ncellsize 0.1\n1 2 3 4 5 high\n", "no number"),
        "huge.asc": (b"ncols 99999\nnrows 99999\ncellsize 0.1\n1\n", "at most"),
        "letters.png": (b"no image", "An image needs"),
        "scene.usd": (b"#usda 1.0", "none of"),
        "robot.xml": (b"<robot name='a'/>", "document <robot>"),
        "nothing.xml": (b"<mujoco/>", "0 fixed shapes"),
        "many.xml": (
            (
                b"<mujoco><worldbody><replicate count='900'><replicate count='900'><geom type='box' size='1 1 1'/>"
                b"</replicate></replicate></worldbody></mujoco>"
            ),
            "replicates",
        ),
        "model.xml": (b"<mujoco><asset/><worldbody><attach model='x'/></worldbody></mujoco>", "<attach>"),
        "outside.xml": (
            (
                b"<mujoco><asset><mesh name='m' file='/etc/passwd.stl'/></asset><worldbody><geom type='mesh' mesh='m'/>"
                b"</worldbody></mujoco>"
            ),
            "not beside it",
        ),
    }


@pytest.mark.parametrize("name", sorted(refused_files()))
def test_files_are_refused_by_name(name: str, tmp_path: Path) -> None:
    content, reason = refused_files()[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(UnreadableFile) as refusal:
        read_terrain(tmp_path / name)
    assert refusal.value.code == "terrain-file-unreadable"
    assert reason in refusal.value.message
    assert refusal.value.faults[0].where == name


def test_an_ascii_grid_is_read_from_north_to_south(tmp_path: Path) -> None:
    rows = "\n".join(" ".join("-9999" if i == j == 0 else f"{0.1 * i:.1f}" for j in range(12)) for i in range(10))
    head = "ncols 12\nnrows 10\nxllcorner 100.0\nyllcorner 50.0\ncellsize 0.5\nNODATA_value -9999\n"
    (tmp_path / "grid.asc").write_text(head + rows, encoding="utf-8")
    points_m = read_ascii_grid(tmp_path / "grid.asc")
    assert len(points_m) == 119
    assert points_m[0] == pytest.approx([100.75, 54.75, 0.0])
    assert points_m[-1] == pytest.approx([105.75, 50.25, 0.9])


def test_a_height_map_of_stairs_has_its_treads(tmp_path: Path) -> None:
    """Four levels of 15 cm, cells of 2 cm, 1 mm for each step of grey of 16 bits, far from the origin of a map."""
    grey = np.zeros((50, 120), dtype=np.uint16)
    for k, start in enumerate((50, 65, 80)):
        grey[:, start:] = 150 * (k + 1)
    Image.fromarray(grey).save(tmp_path / "stairs.png")
    read = read_terrain(tmp_path / "stairs.png", cell_m=0.02, height_m=0.001)
    tops = sorted(one.center_m[2] + 0.5 * one.size_m[2] for one in read.terrain if one.kind == "box")
    assert tops == pytest.approx([0.0, 0.15, 0.3, 0.45], abs=1e-3)
    (stairs,) = read.stairs
    assert (stairs.rise_m, stairs.run_m, stairs.width_m) == (
        pytest.approx(0.15, abs=1e-3),
        pytest.approx(0.3, abs=0.02),
        pytest.approx(1.0, abs=0.03),
    )
    head = "ncols 120\nnrows 50\nxllcorner 480000\nyllcorner 5400000\ncellsize 0.02\n"
    text = head + "\n".join(" ".join(str(0.001 * value + 430.0) for value in row) for row in grey)
    (tmp_path / "map.asc").write_text(text, encoding="utf-8")
    far = read_terrain(tmp_path / "map.asc")
    assert len(far.terrain) == 4
    assert "relative to (480001, 5400000, 430) m" in " ".join(far.remarks)


@pytest.mark.parametrize(
    ("mode", "cell_m", "height_m", "reason"),
    [("RGB", 0.1, 0.01, "mode RGB"), ("L", None, 0.01, "edge of its cells"), ("L", 0.1, -1.0, "edge of its cells")],
)
def test_images_without_heights_are_refused(
    mode: str, cell_m: float | None, height_m: float | None, reason: str, tmp_path: Path
) -> None:
    Image.new(mode, (20, 20)).save(tmp_path / "image.png")
    with pytest.raises(UnreadableFile, match=reason):
        read_height_image(tmp_path / "image.png", cell_m=cell_m, height_m=height_m)


SCENE = """
<mujoco>
  <include file="robot/robot.xml"/>
  <option timestep="0.002"/>
  <asset>
    <texture name="grid" type="2d" file="grid.png"/>
    <material name="grid" texture="grid"/>
    <hfield name="rough" file="field.png" size="1 1 0.2 0.1"/>
    <mesh name="wedge" vertex="0 0 0  1 0 0  1 1 0  0 1 0  1 0 0.2  1 1 0.2"/>
    <mesh name="hull" file="robot/hull.stl"/>
  </asset>
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="plane" size="0 0 0.1" material="grid"/>
    <body name="stairs" pos="2 0 0" euler="0 0 90">
      <geom type="box" size="0.5 0.15 0.075" pos="0 0.15 0.075"/>
      <geom type="box" size="0.5 0.15 0.15" pos="0 0.45 0.15"/>
      <geom type="box" size="0.5 0.5 0.225" pos="0 1.1 0.225"/>
      <geom type="capsule" size="0.02" fromto="0.45 0 1.0  0.45 0.9 1.45"/>
      <geom type="cylinder" size="0.02" fromto="0.45 0.1 0.15  0.45 0.1 1.05"/>
    </body>
    <geom type="hfield" hfield="rough" pos="6 0 0.5"/>
    <geom type="mesh" mesh="wedge" pos="-3 0 0"/>
    <geom type="box" size="0.04 0.6 0.6" pos="0 3 0.6"/>
    <body name="trunk" pos="0 0 1"><freejoint/><geom type="mesh" mesh="hull"/></body>
  </worldbody>
</mujoco>
"""


def assert_is_scene(read: dict[str, Any]) -> None:
    (stairs,) = read["stairs"]
    assert (stairs["rise_m"], stairs["run_m"], stairs["width_m"]) == pytest.approx((0.15, 0.3, 1.0), abs=1e-4)
    assert stairs["start_m"] == pytest.approx([2.0, 0.0, 0.0], abs=1e-3)
    assert stairs["heading_rad"] == pytest.approx(np.pi, abs=1e-4) or stairs["heading_rad"] == pytest.approx(
        -np.pi, abs=1e-4
    )
    (rail,) = [one for one in read["terrain"] if one["kind"] == "rail"]
    assert (rail["radius_m"], stairs["rails"]) == (0.02, [rail["name"]])
    tilted = [one for one in read["terrain"] if one["kind"] == "box" and abs(one["orientation_wxyz"][2]) > 0.05]
    assert [sorted(one["size_m"])[1:] for one in tilted] == [pytest.approx([1.0, np.hypot(1.0, 0.2)], abs=1e-3)]
    obstacles = [one for one in read["terrain"] if one["name"].startswith("obstacle")]
    assert [sorted(one["size_m"]) for one in obstacles] == [
        pytest.approx([0.08, 1.2, 1.2]),
        pytest.approx([0.04, 0.04, 0.9]),
    ]
    assert any("trunk" in remark for remark in read["remarks"])


def test_a_scene_is_read_without_its_robot(tmp_path: Path) -> None:
    """From a folder with the file of its robot missing, and from a zip; meshes of the robot are not needed."""
    (tmp_path / "scene.xml").write_text(SCENE, encoding="utf-8")
    grey = np.zeros((40, 40), dtype=np.uint8)
    grey[:, 20:] = 255
    Image.fromarray(grey).save(tmp_path / "field.png")
    read = segment_terrain(read_scene(tmp_path / "scene.xml"))
    assert_is_scene(read)
    assert any("robot/robot.xml" in remark for remark in read["remarks"])
    with zipfile.ZipFile(tmp_path / "scene.zip", "w") as archive:
        for name in ("scene.xml", "field.png"):
            archive.write(tmp_path / name, f"terrain/{name}")
        archive.writestr("terrain/robot/robot.xml", "<mujoco><worldbody/></mujoco>")
    assert_is_scene(segment_terrain(read_scene(tmp_path / "scene.zip")))
    tops = {round(one["center_m"][2] + 0.5 * one["size_m"][2], 2) for one in read["terrain"] if one["kind"] == "box"}
    assert {0.0, 0.15, 0.3, 0.45, 0.5, 0.7} <= tops  # floor, treads, and both levels of the height field
