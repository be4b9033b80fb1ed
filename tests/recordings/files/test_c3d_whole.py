"""C3D files that look damaged: what their own arithmetic shows to be whole is read, and the rest named."""

import struct
from fractions import Fraction
from pathlib import Path

import ezc3d
import numpy as np
import pytest

from stridelab.body.segment_model import SegmentModel
from stridelab.errors import UnreadableFile
from stridelab.recordings.files.c3d import add_points_to_c3d
from stridelab.recordings.files.c3d_records import DEC, decode_floats
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Recording
from support.recordings.c3d_files import (
    PlateChannels,
    as_written_by,
    parameter_at,
    read_plain,
    with_integer_samples,
    write_file,
)


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


# -- a header that counts one frame more than the file holds


def counting(content: bytes, more: int, *, parameter: bool = True) -> bytes:
    """An Intel file whose header, and POINT:FRAMES, count ``more`` frames more than it holds."""
    out = bytearray(content)
    (last,) = struct.unpack_from("<H", content, 8)
    struct.pack_into("<H", out, 8, last + more)
    if parameter:
        at = parameter_at(content, "POINT", "FRAMES") + 2 + content[parameter_at(content, "POINT", "FRAMES") + 1]
        kind = "<f" if content[parameter_at(content, "POINT", "FRAMES")] == 4 else "<H"
        struct.pack_into(kind, out, at, *(value + more for value in struct.unpack_from(kind, content, at)))
    return bytes(out)


def same_tracks(one: Recording, other: Recording) -> None:
    assert list(one.markers_m) == list(other.markers_m)
    for label, track in one.markers_m.items():
        np.testing.assert_array_equal(other.markers_m[label], track)
    np.testing.assert_array_equal(other.plates[0].force_n, one.plates[0].force_n)


@pytest.mark.parametrize("parameter", [True, False])
@pytest.mark.parametrize("padding", [0, 160])
@pytest.mark.parametrize("machine", ["intel", "dec", "sgi", "integers"])
def test_a_frame_that_only_the_header_counts_is_left_out(
    machine: str, padding: int, parameter: bool, tmp_path: Path
) -> None:
    plain = good(tmp_path)
    (start,) = struct.unpack_from("<H", plain, 16)
    width = 2 if machine == "integers" else 4
    content = counting(with_integer_samples(plain, 0.1) if machine == "integers" else plain, 1, parameter=parameter)
    content = content[: (start - 1) * 512 + 20 * (4 * 6 + 10 * 6) * width]
    whole = with_integer_samples(plain, 0.1) if machine == "integers" else plain
    if machine in {"dec", "sgi"}:
        content, whole = as_written_by(machine, content), as_written_by(machine, whole)
    (tmp_path / "whole.c3d").write_bytes(whole)
    (tmp_path / "short.c3d").write_bytes(content + bytes(padding))
    short = read_recording(tmp_path / "short.c3d")
    assert short.n_frames == 20
    same_tracks(read_recording(tmp_path / "whole.c3d"), short)
    (message,) = [remark.message for remark in short.remarks if remark.code == "c3d-frame-count"]
    assert message.startswith("The header states 21 frames, and the file ends after 20")


@pytest.mark.parametrize(("more", "cut", "tail"), [(2, 0, b""), (1, 4, b""), (1, 336, b""), (1, 0, b"\1")])
def test_a_file_that_ends_within_a_frame_or_lacks_two_is_truncated(
    more: int, cut: int, tail: bytes, tmp_path: Path
) -> None:
    """Of 336 bytes a frame; also one that is cut by a whole frame more than the header counts too many."""
    content = counting(good(tmp_path), more)
    (start,) = struct.unpack_from("<H", content, 16)
    assert refused_bytes(tmp_path, content[: (start - 1) * 512 + 20 * 336 - cut] + tail).code == "truncated-file"


def test_events_and_added_points_of_a_file_without_its_last_frame(tmp_path: Path) -> None:
    points = {f"M{i}": np.random.default_rng(i).normal(900.0, 300.0, (20, 3)) for i in range(6)}
    events = {
        ("EVENT", "USED"): [1],
        ("EVENT", "TIMES"): np.array([[0.0], [0.6]]),
        ("EVENT", "LABELS"): ["Foot Strike"],
        ("EVENT", "CONTEXTS"): ["Left"],
    }
    path = write_file(tmp_path / "good.c3d", points, first_frame=50, parameters=events)
    content = counting(path.read_bytes(), 1)
    (start,) = struct.unpack_from("<H", content, 16)
    short = tmp_path / "short.c3d"
    short.write_bytes(content[: (start - 1) * 512 + 20 * 6 * 16])
    assert [event.time_s for event in read_recording(short).events] == [
        event.time_s for event in read_recording(path).events
    ]
    add_points_to_c3d(short, tmp_path / "more.c3d", {"COM": np.ones((20, 3))}, "+z")
    more = read_recording(tmp_path / "more.c3d")
    assert "c3d-frame-count" not in {remark.code for remark in more.remarks}
    assert ezc3d.c3d(str(tmp_path / "more.c3d"))["data"]["points"].shape == (4, 7, 20)
    assert read_plain(tmp_path / "more.c3d").points.shape == (20, 7, 4)


# -- numbers of a DEC machine


@pytest.mark.filterwarnings("error")
def test_every_bit_pattern_of_a_dec_float_is_a_number() -> None:
    """Against exact arithmetic; the largest exponent is NaN, as elsewhere."""
    rng = np.random.default_rng(5)
    words = [int(word) for word in rng.integers(0, 2**32, 2000, dtype=np.uint64)]
    words += [0x00007F80, 0x0000FF80, 0xFFFF7FFF, 0xFFFFFFFF, 0x00008000, 0x00010000, 0x00004080, 0x0000C080]
    values = decode_floats(struct.pack(f"<{len(words)}I", *words), DEC)
    for word, value in zip(words, values, strict=True):
        bits = ((word & 0xFFFF) << 16) | (word >> 16)
        sign, exponent, fraction = bits >> 31, (bits >> 23) & 0xFF, bits & 0x7FFFFF
        if exponent == 255:
            assert np.isnan(value)
            continue
        exact = Fraction(2**23 + fraction, 2**24) * Fraction(2) ** (exponent - 128) if exponent else Fraction(0)
        assert Fraction(float(value)) == (-exact if sign else exact)
    assert decode_floats(b"", DEC).shape == (0,)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("processor", [84, 86])
def test_a_signalling_nan_is_read_without_a_warning(processor: int) -> None:
    order = "<" if processor == 84 else ">"
    assert np.isnan(decode_floats(struct.pack(order + "I", 0x7F800001), processor)).all()
