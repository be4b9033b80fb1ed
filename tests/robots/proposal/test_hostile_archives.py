"""Archives and descriptions that no one should send: each is refused by name, and nothing is written outside."""

import io
import stat
import struct
import tarfile
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


def with_link_folder() -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as target:
        link = zipfile.ZipInfo("meshes")
        link.external_attr = (stat.S_IFLNK | 0o777) << 16
        target.writestr(link, "/etc")
        target.writestr("robot.urdf", GOOD)
    return packed.getvalue()


def encrypted() -> bytes:
    """A zip whose entry claims to be encrypted."""
    packed = bytearray(one(GOOD))
    packed[6] |= 1
    packed[packed.rfind(b"PK\x01\x02") + 8] |= 1
    return bytes(packed)


def tar_archive() -> bytes:
    packed, content = io.BytesIO(), GOOD.encode()
    with tarfile.open(fileobj=packed, mode="w:gz") as target:
        member = tarfile.TarInfo("robot.urdf")
        member.size = len(content)
        target.addfile(member, io.BytesIO(content))
    return packed.getvalue()


def nan_stl() -> bytes:
    return bytes(80) + struct.pack("<I", 4) + struct.pack("<12fH", *[float("nan")] * 12, 0) * 4


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
XACRO = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="x">{}</robot>'
COLLADA = "<!DOCTYPE c [<!ENTITY a 'ha'><!ENTITY b '&a;&a;'>]><COLLADA>&b;</COLLADA>"
JOINT = '<joint name="{}" type="fixed"><parent link="{}"/><child link="{}"/></joint>'
LINKS = '<link name="a"/><link name="b"/><link name="c"/>'
HOSTILE: dict[str, tuple[Callable[[], bytes], str]] = {
    "an empty file": (lambda: b"", "zip-damaged"),
    "an empty zip": (lambda: archive({}), "robot-description-missing"),
    "a tar": (tar_archive, "zip-damaged"),
    "a zip with a password": (encrypted, "zip-damaged"),
    "a folder that is a link": (with_link_folder, "zip-path"),
    "a network folder": (lambda: archive({"\\\\host\\share\\robot.urdf": GOOD}), "zip-path"),
    "an unexpanded macro": (lambda: one(XACRO.format("<xacro:leg side='left'/>")), "robot-data-unreadable"),
    "an expression": (lambda: one(GOOD.replace('mass value="8.0"', 'mass value="${m}"')), "robot-data-unreadable"),
    "an entity outside": (
        lambda: one('<!DOCTYPE r [<!ENTITY % p SYSTEM "http://127.0.0.1/x"> %p;]><robot name="x"/>'),
        "robot-data-unreadable",
    ),
    "an unknown encoding": (
        lambda: one('<?xml version="1.0" encoding="utf-7"?><robot name="x"/>'),
        "robot-data-unreadable",
    ),
    "its own parent": (
        lambda: one(f"<robot>{LINKS}{JOINT.format('1', 'a', 'b')}{JOINT.format('2', 'c', 'c')}</robot>"),
        "robot-description-invalid",
    ),
    "a name that is written backwards": (
        lambda: one(GOOD.replace('"left_knee"', '"left_\u202eeenk"')),
        "robot-description-invalid",
    ),
    "bodies multiplied a thousandfold": (
        lambda: one(
            "<mujoco><worldbody>"
            + '<replicate count="1000">' * 3
            + "<body/>"
            + "</replicate>" * 3
            + "</worldbody></mujoco>"
        ),
        "robot-description-invalid",
    ),
    "a grid of flexible bodies": (
        lambda: one('<mujoco><worldbody><flexcomp name="f" type="grid" count="200 200 200"/></worldbody></mujoco>'),
        "robot-description-invalid",
    ),
    "a mesh of no numbers": (
        lambda: archive({"robot.urdf": MESHED, "meshes/foot.stl": nan_stl()}),
        "robot-mesh-unreadable",
    ),
    "entities in a mesh": (
        lambda: archive({"robot.urdf": MESHED.replace("foot.stl", "foot.dae"), "meshes/foot.dae": COLLADA}),
        "robot-mesh-unreadable",
    ),
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


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_descriptions_are_read_in_their_encoding(encoding: str, tmp_path: Path) -> None:
    name = "utf-16" if encoding == "utf-16" else "utf-8"
    text = f'<?xml version="1.0" encoding="{name}"?>{GOOD.split("?>")[-1]}'.replace("left_knee", "left_ركبة")
    (tmp_path / "upload").write_bytes(archive({"robot.urdf": text.encode(encoding)}))
    rebuild_description(tmp_path / "upload", "robot.zip", "small", tmp_path / "robots")
    assert "left_ركبة" in (tmp_path / "robots" / "small" / "robot.urdf").read_text(encoding="utf-8")


def test_a_mesh_in_another_format_is_named_with_the_formats(tmp_path: Path) -> None:
    upload = archive({"robot.urdf": MESHED.replace("foot.stl", "foot.wrl"), "meshes/foot.wrl": "#VRML V2.0 utf8"})
    (tmp_path / "upload").write_bytes(upload)
    with pytest.raises(StridelabError, match=r"foot\.wrl: its format is none of \.stl, \.obj, \.dae"):
        rebuild_description(tmp_path / "upload", "robot.zip", "small", tmp_path / "robots")


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
