"""Archives and descriptions that no one should send: each is refused by name, and nothing is written outside."""

from collections.abc import Callable
from pathlib import Path

import pytest

from stridelab.errors import StridelabError
from stridelab.robots.proposal import archive as archives
from stridelab.robots.proposal.propose import rebuild_description
from support.robots.hostile_archives import GOOD, HOSTILE, MESHED
from support.robots.humanoid import archive, box_stl


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
