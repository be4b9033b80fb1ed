"""Robots of installed packages: what is listed, what a name means, and what an archive of one holds."""

import zipfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

import pytest

from stridelab.errors import InvalidInput
from stridelab.robots.data_files import PREFIXES_VARIABLE
from stridelab.robots.proposal.archive import unpack_robot
from stridelab.robots.proposal.description import read_xml
from stridelab.robots.proposal.packages import (
    InstalledPackage,
    find_description,
    find_package,
    installed_packages,
    pack_description,
)
from support.robots.humanoid import Humanoid


@pytest.fixture
def prefix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A prefix of ROS packages; what is put into its folder ``share`` is installed."""
    monkeypatch.setenv(PREFIXES_VARIABLE, str(tmp_path / "prefix"))
    installed_packages.cache_clear()
    yield tmp_path / "prefix" / "share"
    installed_packages.cache_clear()


def install(share: Path, package: str, files: dict[str, str]) -> None:
    (share / package).mkdir(parents=True)
    (share / package / "package.xml").write_text(f"<package><name>{package}</name><version>1.2.3</version></package>")
    for name, content in files.items():
        path = share / package / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)


def packed_names(package: InstalledPackage, wanted: str, target: Path) -> set[str]:
    pack_description(package, find_description(package, wanted), target)
    with zipfile.ZipFile(target) as archive:
        return set(archive.namelist())


def with_meshes(*filenames: str) -> str:
    meshes = "".join(f'<visual><geometry><mesh filename="{name}"/></geometry></visual>' for name in filenames)
    return Humanoid().urdf().replace("</link>", f"{meshes}</link>", 1)


def test_descriptions_with_the_joints_of_two_legs_are_listed(prefix: Path) -> None:
    humanoid, mjcf = Humanoid().urdf(), Humanoid().mjcf()
    arm = '<robot name="arm">' + '<joint type="revolute" name="a"/>' * 7 + "</robot>"
    files = {"urdf/small.urdf": humanoid, "mjcf/small.xml": mjcf, "arm.urdf": arm, "launch.xml": "<launch/>"}
    install(prefix, "small_description", files)
    install(prefix, "arms", {"arm.urdf": arm})
    packages = installed_packages()
    assert "arms" not in packages
    assert packages["small-description"].version == "1.2.3"
    assert [str(path) for path in packages["small-description"].shortest_paths] == ["mjcf/small.xml", "urdf/small.urdf"]


def test_a_name_means_an_installed_description_or_names_the_nearest(prefix: Path) -> None:
    install(prefix, "small_description", {"a/small.urdf": Humanoid().urdf(), "b/tall.urdf": Humanoid().urdf()})
    install(prefix, "other", {"c/small.urdf": Humanoid().urdf()})
    package = find_package("Small.Description")
    for wanted in ("small", "small.urdf", "a/small", "a/small.urdf"):
        assert find_description(package, wanted).name == "small.urdf"
    for wanted in ("../other/c/small.urdf", "/etc/passwd", str(prefix / "small_description" / "a" / "small.urdf")):
        with pytest.raises(InvalidInput) as refused:
            find_description(package, wanted)
        assert refused.value.code == "robot-description-missing"
    with pytest.raises(InvalidInput) as refused:
        find_description(package, "smal")
    assert refused.value.faults[0].where == "a/small.urdf"
    with pytest.raises(InvalidInput) as refused:
        find_description(package, "")
    assert refused.value.code == "robot-several-descriptions"
    assert [fault.where for fault in refused.value.faults] == ["a/small.urdf", "b/tall.urdf"]
    for name in ("smal-description", "../small_description"):
        with pytest.raises(InvalidInput, match="the nearest is small-description") as refused:
            find_package(name)
        assert refused.value.code == "robot-package-unknown"


def test_an_archive_holds_the_meshes_that_the_description_means(prefix: Path, tmp_path: Path) -> None:
    meshes = [f"{robot}/meshes/{name}.stl" for robot in ("one", "two") for name in ("foot", "hand")]
    robots = {
        "one/one.urdf": with_meshes(
            "package://many/one/meshes/foot.stl", "meshes/hand.stl", "package://parts/head.dae"
        ),
        "two/two.urdf": with_meshes("foot.stl", "../../../../secret.stl", "package://parts/../../../secret.stl"),
    }
    install(prefix, "many", robots | dict.fromkeys(meshes, "solid"))
    install(prefix, "parts", {"head.dae": "<COLLADA/>", "parts.urdf": Humanoid().urdf()})
    (prefix.parent / "secret.stl").write_text("solid")
    package = find_package("many")
    one = packed_names(package, "one", tmp_path / "one.zip")
    assert one == {"many/one/one.urdf", "many/one/meshes/foot.stl", "many/one/meshes/hand.stl", "parts/head.dae"}
    assert packed_names(package, "two", tmp_path / "two.zip") == {"many/two/two.urdf", "many/two/meshes/foot.stl"}
    again = tmp_path / "again.zip"
    packed_names(package, "one", again)
    assert again.read_bytes() == (tmp_path / "one.zip").read_bytes()


def test_an_mjcf_file_is_packed_with_what_it_includes(prefix: Path, tmp_path: Path) -> None:
    model = Humanoid().mjcf().replace("<worldbody>", '<include file="parts/assets.xml"/><worldbody>', 1)
    assets = '<mujoco><compiler meshdir="stl"/><asset><mesh file="foot.stl"/></asset></mujoco>'
    files = {"small.xml": model, "parts/assets.xml": assets, "parts/stl/foot.stl": "solid", "other/foot.stl": "solid"}
    install(prefix, "small", files)
    names = packed_names(find_package("small"), "small.xml", tmp_path / "small.zip")
    assert names == {"small/small.xml", "small/parts/assets.xml", "small/parts/stl/foot.stl"}
    (tmp_path / "unpacked").mkdir()
    unpacked = unpack_robot(tmp_path / "small.zip", "small.zip", tmp_path / "unpacked", "small/small.xml")
    assert unpacked.find_mesh("foot.stl") is not None


def test_every_mesh_of_an_installed_robot_is_packed(tmp_path: Path) -> None:
    package = find_package("example_robot_data")
    inside = find_description(package, "romeo_description/urdf/romeo")
    names = {PurePosixPath(name).name for name in packed_names(package, "romeo.urdf", tmp_path / "romeo.zip")}
    meshes = read_xml(package.files[inside], "romeo").iter("mesh")
    assert {PurePosixPath(mesh.attrib["filename"]).name for mesh in meshes} | {"romeo.urdf"} == names
