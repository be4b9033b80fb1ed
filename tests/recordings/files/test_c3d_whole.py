"""C3D files that look damaged: what their own arithmetic shows to be whole is read, and the rest named."""

import struct
from pathlib import Path

import ezc3d
import numpy as np
import pytest

from stridelab.body.segment_model import SegmentModel
from stridelab.errors import UnreadableFile
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.reader import read_recording
from support.recordings.c3d_files import PlateChannels, write_file


def good(folder: Path) -> bytes:
    rng = np.random.default_rng(0)
    points = {f"M{i}": rng.normal(900.0, 300.0, (20, 3)) for i in range(6)}
    return write_file(folder / "good.c3d", points, plates=[PlateChannels(2, rng.normal(0, 1, (200, 6)))]).read_bytes()


def refusal(path: Path) -> UnreadableFile:
    with pytest.raises(UnreadableFile) as refused:
        read_recording(path)
    assert refused.value.message.endswith((".", ")."))
    return refused.value


def refused_bytes(folder: Path, content: bytes, name: str = "trial.c3d") -> UnreadableFile:
    path = folder / name
    path.write_bytes(content)
    return refusal(path)


def without_description(content: bytes, name: bytes, n_bytes: int = 1) -> bytes:
    """The last ``n_bytes`` of a parameter, of which the last is the length of its empty description, taken out."""
    data = (struct.unpack_from("<H", content, 16)[0] - 1) * 512
    link = content.index(b"\x01" + name, 512) + 1 + len(name)
    (step,) = struct.unpack_from("<H", content, link)
    end = link + step
    assert content[end - 1] == 0
    head = content[:link] + struct.pack("<H", step - n_bytes) + content[link + 2 : end - n_bytes]
    return head + content[end:data] + bytes(n_bytes) + content[data:]


def test_a_parameter_without_room_for_a_description_is_whole(tmp_path: Path) -> None:
    """Its offset ends with its values: the next record begins there, though ezc3d calls the file not standard."""
    plain = good(tmp_path)
    whole = read_recording(tmp_path / "good.c3d")
    (tmp_path / "brief.c3d").write_bytes(without_description(plain, b"LABELS"))
    brief = read_recording(tmp_path / "brief.c3d")
    assert list(brief.markers_m) == list(whole.markers_m)
    for label, track in whole.markers_m.items():
        np.testing.assert_array_equal(brief.markers_m[label], track)
    np.testing.assert_array_equal(brief.plates[0].force_n, whole.plates[0].force_n)


def test_a_parameter_that_ends_in_the_next_one_is_damaged(tmp_path: Path) -> None:
    error = refused_bytes(tmp_path, without_description(good(tmp_path), b"LABELS", 2))
    assert error.code == "c3d-parameters-broken"
    assert "LABELS overlaps the next one" in error.faults[0].message


@pytest.mark.parametrize(("more", "code"), [(0, "no-markers"), (511, "no-markers"), (2048, "c3d-parameters-broken")])
def test_points_without_parameters_have_no_names(more: int, code: str, tmp_path: Path) -> None:
    head = bytearray(512)
    struct.pack_into("<2B4H", head, 0, 2, 0x50, 5, 0, 1, 30)
    struct.pack_into("<fHHf", head, 12, -1.0, 3, 0, 60.0)
    section = bytes([1, 0x50, 0, 84]) + bytes(508)
    error = refused_bytes(tmp_path, bytes(head) + section + bytes(30 * 5 * 16) + bytes(more))
    assert error.code == code
    assert ("5 points in 30 frames" in error.message) == (code == "no-markers")


def test_a_file_without_markers_names_what_it_holds(tmp_path: Path) -> None:
    plate = PlateChannels(2, np.zeros((200, 6)))
    points = {label: np.ones((20, 3)) for label in ("LHipAngles", "*7")}
    error = refusal(write_file(tmp_path / "trial.c3d", points, plates=[plate]))
    assert error.code == "no-markers"
    assert "2 points, none of them a named marker (LHipAngles, *7 ...), and 6 analog channels" in error.message
    content = ezc3d.c3d()
    content["parameters"]["POINT"]["RATE"]["value"] = [85.0]
    content["data"]["rotations"] = np.tile(np.eye(4)[:, :, None, None], (1, 1, 3, 20))
    content["parameters"]["POINT"]["LABELS"]["value"] = ["*1"]
    content["data"]["points"] = np.ones((4, 1, 20))
    content.write(str(tmp_path / "turned.c3d"))
    assert "and the rotations of body segments" in refusal(tmp_path / "turned.c3d").message


THEIA_M = {
    "pelvis": (0.0, 0.0, 0.9),
    "l_thigh": (0.0, 0.09, 0.9),
    "r_thigh": (0.0, -0.09, 0.9),
    "l_shank": (0.0, 0.09, 0.48),
    "r_shank": (0.0, -0.09, 0.48),
    "l_foot": (0.0, 0.09, 0.09),
    "r_foot": (0.0, -0.09, 0.09),
    "l_toes": (0.15, 0.09, 0.04),
    "r_toes": (0.15, -0.09, 0.04),
    "torso": (0.0, 0.0, 1.45),
    "l_uarm": (0.0, 0.16, 1.4),
    "r_uarm": (0.0, -0.16, 1.4),
}


def test_the_poses_of_segments_are_read_as_joint_centres(tmp_path: Path) -> None:
    """As a system without markers writes them: 4 x 4 poses in mm, the first of the room, some frames empty."""
    content = ezc3d.c3d()
    content["parameters"]["POINT"]["RATE"]["value"] = [85.0]
    content["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    content["parameters"]["POINT"]["LABELS"]["value"] = ["*1"]
    content["data"]["points"] = np.full((4, 1, 60), np.nan)
    poses = np.tile(np.eye(4)[:, :, None, None], (1, 1, 1 + len(THEIA_M), 60))
    poses[:3, 3, 1:] = 1000.0 * np.array(list(THEIA_M.values())).T[:, :, None]
    poses[:, :, 1:, :2] = np.nan
    content["data"]["rotations"] = poses
    content.add_parameter("ROTATION", "LABELS", ["worldbody_4X4", *(f"{name}_4X4" for name in THEIA_M)])
    content.write(str(tmp_path / "poses.c3d"))
    recording = read_recording(tmp_path / "poses.c3d")
    assert "segment-origins" in {remark.code for remark in recording.remarks}
    assert set(recording.markers_m) == {f"{name}_4X4" for name in THEIA_M}
    for name, at_m in THEIA_M.items():
        np.testing.assert_allclose(recording.markers_m[f"{name}_4X4"][5], at_m, atol=1e-6)
    assert np.isnan(recording.markers_m["pelvis_4X4"][0]).all()
    match = identify(list(recording.markers_m))
    assert (match.name, match.landmarks["l_knee_centre"]) == ("theia", "l_shank_4X4")
    com_m = SegmentModel().com(recording, match.landmarks, subject=recording.subject).com_m
    assert 0.9 < com_m[5, 2] < 1.1
    assert np.abs(com_m[5, :2]).max() < 0.05
