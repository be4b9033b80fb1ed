"""Archives and descriptions that no one should send: each is refused by name, and nothing is written outside."""

import io
import stat
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from stridelab.errors import StridelabError
from stridelab.robots.proposal import archive as archives
from stridelab.robots.proposal.propose import rebuild_description
from support.robots.humanoid import Humanoid, archive, box_stl

GOOD = Humanoid(arms=False).urdf()
MESHED = Humanoid(arms=False, mesh_feet="package://x/meshes/foot.stl").urdf()


def with_link_file() -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as target:
        link = zipfile.ZipInfo("robot.urdf")
        link.external_attr = (stat.S_IFLNK | 0o777) << 16
        target.writestr(link, "/etc/passwd")
    return packed.getvalue()


def named_twice() -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as target:
        target.writestr("robot.urdf", GOOD)
        target.writestr("Robot.urdf", GOOD)
    return packed.getvalue().replace(b"Robot.urdf", b"robot.urdf")


def one(urdf: str) -> bytes:
    return archive({"robot.urdf": urdf})


BILLION = (
    '<?xml version="1.0"?><!DOCTYPE r [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;">]>'
    '<robot name="x"><link name="&b;"/></robot>'
)
EXTERNAL = '<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]><robot name="x"><link name="&x;"/></robot>'
JOINT = '<joint name="{}" type="fixed"><parent link="{}"/><child link="{}"/></joint>'
LINKS = '<link name="a"/><link name="b"/><link name="c"/>'
HOSTILE: dict[str, tuple[Callable[[], bytes], str]] = {
    "no zip": (lambda: b"PK\x03\x04 not a zip", "zip-damaged"),
    "half a zip": (lambda: one(GOOD)[:300], "zip-damaged"),
    "a path upwards": (lambda: archive({"../../robot.urdf": GOOD}), "zip-path"),
    "an absolute path": (lambda: archive({"/tmp/robot.urdf": GOOD}), "zip-path"),
    "a drive": (lambda: archive({"C:\\robot.urdf": GOOD}), "zip-path"),
    "a symbolic link": (with_link_file, "zip-path"),
    "the same name twice": (named_twice, "zip-name-twice"),
    "no description": (lambda: archive({"readme.txt": "hello"}), "robot-description-missing"),
    "two descriptions": (lambda: archive({"a.urdf": GOOD, "b.urdf": GOOD}), "robot-several-descriptions"),
    "entities": (lambda: one(BILLION), "robot-data-unreadable"),
    "an external entity": (lambda: one(EXTERNAL), "robot-data-unreadable"),
    "no XML": (lambda: one("<robot"), "robot-data-unreadable"),
    "binary": (lambda: one("\x00\x01"), "robot-data-unreadable"),
    "an empty MJCF": (lambda: one("<mujoco/>"), "robot-description-invalid"),
    "depth": (lambda: one("<robot>" * 100 + "</robot>" * 100), "robot-description-too-large"),
    "a cycle": (
        lambda: one(f"<robot>{LINKS}{JOINT.format('1', 'a', 'b')}{JOINT.format('2', 'b', 'a')}</robot>"),
        "robot-description-invalid",
    ),
    "two roots": (lambda: one(f"<robot>{LINKS}{JOINT.format('1', 'a', 'b')}</robot>"), "robot-description-invalid"),
    "two parents": (
        lambda: one(f"<robot>{LINKS}{JOINT.format('1', 'a', 'c')}{JOINT.format('2', 'b', 'c')}</robot>"),
        "robot-description-invalid",
    ),
    "markup in a name": (
        lambda: one(GOOD.replace('"left_knee"', '"&lt;script&gt;alert(1)&lt;/script&gt;"')),
        "robot-description-invalid",
    ),
    "a name of line breaks": (
        lambda: one(GOOD.replace('"left_knee"', '"left&#10;knee"')),
        "robot-description-invalid",
    ),
    "not a number": (lambda: one(GOOD.replace('mass value="8.0"', 'mass value="nan"')), "robot-description-invalid"),
    "infinity": (lambda: one(GOOD.replace('mass value="8.0"', 'mass value="1e400"')), "robot-description-invalid"),
    "no axis": (lambda: one(GOOD.replace('xyz="0.0 1.0 0.0"', 'xyz="0 0 0"')), "robot-description-invalid"),
    "degrees": (lambda: one(GOOD.replace('upper="2.3"', 'upper="130"')), "robot-description-invalid"),
    "included files that are deep": (
        lambda: archive(
            {
                f"p{i}.xml": "<mujoco>"
                + "<body>" * 30
                + f"<include file='p{i + 1}.xml'/>"
                + "</body>" * 30
                + "</mujoco>"
                for i in range(3)
            }
            | {"p3.xml": "<mujoco/>"}
        ),
        "robot-description-too-large",
    ),
    "included files that are large": (
        lambda: archive(
            {"a.xml": "<mujoco><include file='b.xml'/></mujoco>", "b.xml": f"<mujoco>{' ' * 7_999_990}</mujoco>"}
        ),
        "robot-description-too-large",
    ),
    "a missing mesh": (lambda: one(MESHED), "robot-description-invalid"),
    "a broken mesh": (
        lambda: archive({"robot.urdf": MESHED, "meshes/foot.stl": b"solid nothing"}),
        "robot-mesh-unreadable",
    ),
    "a cut mesh": (
        lambda: archive({"robot.urdf": MESHED, "meshes/foot.stl": box_stl((0.1, 0.05, 0.02))[:200]}),
        "robot-mesh-unreadable",
    ),
    "a mesh in millimetres": (
        lambda: archive({"robot.urdf": MESHED, "meshes/foot.stl": box_stl((100.0, 50.0, 20.0))}),
        "robot-mesh-unreadable",
    ),
}


@pytest.mark.parametrize(("make", "code"), HOSTILE.values(), ids=HOSTILE.keys())
def test_hostile_archives_are_refused_by_name(make: Callable[[], bytes], code: str, tmp_path: Path) -> None:
    inside = tmp_path / "a" / "b" / "c"
    inside.mkdir(parents=True)
    (inside / "upload").write_bytes(make())
    with pytest.raises(StridelabError) as refusal:
        rebuild_description(inside / "upload", "robot.zip", "small", inside / "robots")
    assert refusal.value.code == code
    assert refusal.value.faults
    assert [path.name for path in tmp_path.iterdir()] == ["a"]
    assert sorted(path.name for path in inside.iterdir()) == ["robots", "upload"]


@pytest.mark.parametrize(
    ("name", "hint"), [("urdf/robot.urdf.xacro", "xacro robot"), ("robot.sdf", "URDF"), ("robot.zip", "another zip")]
)
def test_what_to_do_with_an_archive_without_a_description_is_stated(name: str, hint: str, tmp_path: Path) -> None:
    (tmp_path / "upload").write_bytes(archive({name: GOOD, "meshes/foot.stl": box_stl((0.1, 0.05, 0.02))}))
    with pytest.raises(StridelabError, match=hint) as refusal:
        rebuild_description(tmp_path / "upload", "robot.zip", "small", tmp_path / "robots")
    assert refusal.value.code == "robot-description-missing"
    assert [fault.where for fault in refusal.value.faults] == [name]


def test_an_archive_that_grows_is_cut_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(archives, "MAX_FILE_BYTES", 200_000)
    (tmp_path / "upload").write_bytes(archive({"robot.urdf": GOOD, "meshes/zeros.stl": bytes(3_000_000)}))
    with pytest.raises(StridelabError) as refusal:
        rebuild_description(tmp_path / "upload", "robot.zip", "small", tmp_path / "robots")
    assert refusal.value.code == "zip-bomb"
    assert max(path.stat().st_size for path in tmp_path.rglob("*") if path.is_file()) < 300_000


def test_an_archive_of_too_many_files_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(archives, "MAX_ENTRIES", 20)
    (tmp_path / "upload").write_bytes(archive({f"{i}.stl": b"" for i in range(21)}))
    with pytest.raises(StridelabError) as refusal:
        rebuild_description(tmp_path / "upload", "robot.zip", "small", tmp_path / "robots")
    assert refusal.value.code == "zip-too-many-files"


def test_meshes_of_the_same_file_name_are_distinguished_by_their_folders(tmp_path: Path) -> None:
    urdf = MESHED.replace("package://x/meshes/foot.stl", "file:///home/someone/x/left/foot.stl")
    files = {"robot.urdf": urdf, "left/foot.stl": box_stl((0.1, 0.05, 0.02)), "right/foot.stl": b"broken"}
    (tmp_path / "upload").write_bytes(archive(files))
    rebuild_description(tmp_path / "upload", "robot.zip", "small", tmp_path / "robots")
    text = (tmp_path / "robots" / "small" / "robot.urdf").read_text(encoding="utf-8")
    assert "package://small/mesh-0000.stl" in text
    assert "/home/" not in text
