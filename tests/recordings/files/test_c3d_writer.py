"""C3D files out and in again."""

import struct
from dataclasses import replace
from pathlib import Path

import ezc3d
import numpy as np
import pytest

from stridelab.errors import InvalidInput
from stridelab.recordings.files.c3d import add_points_to_c3d
from stridelab.recordings.files.c3d_writer import split_text, write_c3d
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Event, Plate, Recording, Subject
from support.recordings.c3d_files import (
    PlateChannels,
    parameter_at,
    read_plain,
    with_integer_samples,
    with_parameter,
    write_file,
)
from support.recordings.walks import walk


def full() -> Recording:
    recording = walk([2, 3])
    markers = {label: track.copy() for label, track in recording.markers_m.items()}
    markers["l_heel"][50:90] = np.nan
    return replace(
        recording,
        markers_m=markers,
        subject=Subject(1.72, 71.5, "female", 34.0),
        events=(Event(0.8, "foot_off", "right"), Event(61.25, "foot_strike", "left")),
        carried={"segment_table": '{"name": "own", "text": "' + "two words " * 40 + '"}'},
        joint_widths_m={"l_knee": 0.104, "r_ankle": 0.071},
        model_points_m={"LHJC": recording.markers_m["pelvis_0"] - 0.1},
    )


def test_a_written_recording_is_read_back_unchanged(tmp_path: Path) -> None:
    recording = full()
    com = np.column_stack([recording.time_s, 0 * recording.time_s, 1.0 + 0 * recording.time_s])
    write_c3d(tmp_path / "out.c3d", recording, extra_points={"CentreOfMass": com})
    back = read_recording(tmp_path / "out.c3d")
    assert set(back.markers_m) == set(recording.markers_m)
    for label, track in recording.markers_m.items():
        np.testing.assert_allclose(back.markers_m[label], track, atol=1e-6)
    np.testing.assert_allclose(back.model_points_m["CentreOfMass"], com, atol=1e-6)
    assert "LHJC" in back.model_points_m
    for a, b in zip(recording.plates, back.plates, strict=True):
        np.testing.assert_allclose(b.force_n, a.force_n, atol=1e-3)
        np.testing.assert_allclose(b.moment_nm, a.moment_nm, atol=1e-3)
        np.testing.assert_allclose(b.corners_m, a.corners_m, atol=1e-6)
    assert back.subject == recording.subject
    assert [(e.kind, e.side) for e in back.events] == [(e.kind, e.side) for e in recording.events]
    np.testing.assert_allclose([e.time_s for e in back.events], [0.8, 61.25], atol=1e-4)
    assert back.carried == recording.carried
    assert back.joint_widths_m == pytest.approx(recording.joint_widths_m)
    assert back.walking_direction is not None
    np.testing.assert_allclose(back.walking_direction, recording.walking_direction, atol=1e-6)
    assert "plate-sign-reversed" not in {remark.code for remark in back.remarks}


def test_another_program_reads_the_same_plates(tmp_path: Path) -> None:
    """ezc3d's own force-plate filter, which trusts the types of the parameters."""
    recording = full()
    write_c3d(tmp_path / "out.c3d", recording)
    plates = ezc3d.c3d(str(tmp_path / "out.c3d"), extract_forceplat_data=True)["data"]["platform"]
    for ours, theirs in zip(recording.plates, plates, strict=True):
        np.testing.assert_allclose(theirs["force"].T, ours.force_n, atol=1e-3)
        cop = theirs["center_of_pressure"].T[ours.force_n[:, 2] > 50.0] / 1000.0
        inside = np.all((cop > ours.corners_m.min(axis=0) - 1e-6) & (cop < ours.corners_m.max(axis=0) + 1e-6), axis=1)
        assert inside.all()


def test_a_force_rate_that_is_no_multiple_is_raised_to_one(tmp_path: Path) -> None:
    recording = walk([2, 3], force_rate_hz=950.0)
    write_c3d(tmp_path / "out.c3d", recording)
    back = read_recording(tmp_path / "out.c3d")
    assert back.force_rate_hz == 1000.0
    assert len(back.plates[0].force_n) == 10 * recording.n_frames


def test_a_recording_without_plates_subject_and_events_is_written(tmp_path: Path) -> None:
    recording = replace(walk([2]), plates=())
    write_c3d(tmp_path / "out.c3d", recording)
    back = read_recording(tmp_path / "out.c3d")
    assert back.plates == ()
    assert back.subject == Subject()


def test_chunks_never_end_in_a_blank() -> None:
    text = "word " * 200 + "x" * 300
    parts = split_text(text)
    assert "".join(parts) == text
    assert all(len(part) <= 100 for part in parts)
    assert all(part == part.strip() for part in parts)
    assert split_text("") == [""]


def upload(folder: Path) -> Path:
    """Y up, 260 points (more than one list of labels), a gap, an odd unit, a copyright notice, cropped to frame 120."""
    rng = np.random.default_rng(0)
    rest = rng.uniform([-300, 0, -300], [300, 1700, 300], (260, 3))
    points = {f"M{i}": rest[i] + rng.normal(0, 5, (40, 3)) for i in range(260)}
    points["M7"][10:20] = np.nan
    signals = np.zeros((400, 6))
    signals[100:300, 2] = -700.0
    corners = np.array([[-250.0, 0, 200], [250, 0, 200], [250, 0, -200], [-250, 0, -200]])[[3, 2, 1, 0]]
    extra = {
        ("POINT", "Y_SCREEN"): "+Y",
        ("COPYRIGHT", "NOTICE"): ["keep this", "and this"],
        ("EVENT", "USED"): [1],
        ("EVENT", "LABELS"): ["Foot Strike"],
        ("EVENT", "CONTEXTS"): ["Left"],
        ("EVENT", "TIMES"): np.array([[0.0], [1.35]]),
    }
    plates = [PlateChannels(2, signals, corners_mm=corners)]
    return write_file(folder / "upload.c3d", points, plates=plates, parameters=extra, first_frame=120)


def test_points_are_added_in_the_axes_of_the_file_and_all_else_is_unchanged(tmp_path: Path) -> None:
    source, target = upload(tmp_path), tmp_path / "com.c3d"
    com = np.column_stack([np.linspace(0, 1, 40), np.full(40, 0.2), np.full(40, 0.9)])
    com[3] = np.nan
    add_points_to_c3d(source, target, {"CentreOfMass": com}, "+y")
    before, after = ezc3d.c3d(str(source)), ezc3d.c3d(str(target))
    n = before["data"]["points"].shape[1]
    np.testing.assert_array_equal(after["data"]["points"][:3, :n], before["data"]["points"][:3])
    np.testing.assert_array_equal(after["data"]["analogs"], before["data"]["analogs"])
    assert after["header"]["points"]["first_frame"] == before["header"]["points"]["first_frame"] == 120
    assert after["parameters"]["COPYRIGHT"]["NOTICE"]["value"] == ["keep this", "and this"]
    for name in ("CORNERS", "ORIGIN", "CHANNEL", "TYPE", "ZERO"):
        np.testing.assert_array_equal(
            after["parameters"]["FORCE_PLATFORM"][name]["value"], before["parameters"]["FORCE_PLATFORM"][name]["value"]
        )
    y_up = np.column_stack([com[:, 0], com[:, 2], -com[:, 1]])
    np.testing.assert_allclose(after["data"]["points"][:3, n].T / 1000.0, y_up, atol=1e-6)
    assert after["data"]["meta_points"]["residuals"][0, n, 3] == -1
    a, b = read_recording(source), read_recording(target)
    assert a.up_axis == b.up_axis == "+y"
    assert a.events == b.events
    np.testing.assert_allclose(b.model_points_m["CentreOfMass"][10:], com[10:], atol=1e-6)
    for p, q in zip(a.plates, b.plates, strict=True):
        np.testing.assert_array_equal(p.force_n, q.force_n)


@pytest.mark.parametrize("as_integer_file", [False, True])
def test_header_and_parameters_agree_and_no_data_are_lost(as_integer_file: bool, tmp_path: Path) -> None:
    """Read by a reader of the tests' own; a program that compares the two statements of a scale opens the file."""
    source, target = upload(tmp_path), tmp_path / "com.c3d"
    content = bytearray(source.read_bytes())
    for at in (12, parameter_at(bytes(content), "POINT", "SCALE") + 2):
        struct.pack_into("<f", content, at, -0.01)
    before = read_plain(source)
    source.write_bytes(with_integer_samples(bytes(content), 0.1) if as_integer_file else bytes(content))
    add_points_to_c3d(source, target, {"CentreOfMass": np.full((40, 3), 0.9)}, "+y")
    after = read_plain(target)
    assert after.scale == after.numbers("POINT", "SCALE")[0] == np.float32(-0.1 if as_integer_file else -0.01)
    assert after.n_points == after.numbers("POINT", "USED")[0] % 65536 == before.n_points + 1
    assert after.data_block == after.numbers("POINT", "DATA_START")[0]
    visible = np.isfinite(before.points).all(axis=2)
    within = 0.051 if as_integer_file else 0.0
    np.testing.assert_allclose(
        after.points[:, :260, :3][visible], before.points[:, :, :3][visible], atol=within, rtol=0
    )
    np.testing.assert_array_equal(after.analogs, before.analogs)
    changed = {("POINT", name) for name in ("USED", "SCALE", "DATA_START", "LABELS2", "DESCRIPTIONS2")}
    for key in set(before.parameters) - changed:
        assert after.parameters[key] == before.parameters[key], key
    names = after.texts("POINT", "LABELS") + after.texts("POINT", "LABELS2")
    assert names[-1] == "CentreOfMass"
    assert len(names) == 261


def test_a_label_that_is_taken_is_not_overwritten(tmp_path: Path) -> None:
    source, target = upload(tmp_path), tmp_path / "com.c3d"
    add_points_to_c3d(source, target, {"M3": np.ones((40, 3))}, "+y")
    markers = read_recording(target).markers_m
    assert {"M3", "M3_stridelab"} <= set(markers)


def test_points_of_another_length_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput) as refused:
        add_points_to_c3d(upload(tmp_path), tmp_path / "com.c3d", {"CentreOfMass": np.ones((39, 3))}, "+y")
    assert refused.value.code == "wrong-frame-count"
    assert not (tmp_path / "com.c3d").exists()


N_LONG = 70_000


@pytest.fixture(scope="module")
def long_file(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Recording]:
    """Twelve minutes at 100 Hz: more frames than 16 bits count."""
    rng = np.random.default_rng(2)
    rest = rng.uniform([-0.3, -0.3, 0.0], [0.3, 0.3, 1.7], (6, 3))
    markers = {f"M{i}": rest[i] + rng.normal(0.0, 0.005, (N_LONG, 3)) for i in range(6)}
    corners = np.array([[0.3, 0.2, 0.0], [-0.3, 0.2, 0.0], [-0.3, -0.2, 0.0], [0.3, -0.2, 0.0]])
    force = np.column_stack([np.zeros((N_LONG, 2)), 600.0 + 50.0 * np.sin(np.arange(N_LONG) / 300.0)])
    plate = Plate(1, 2, corners, force, np.zeros((N_LONG, 3)), np.zeros(3))
    events = (Event(690.5, "foot_strike", "left"),)
    recording = Recording(markers, 100.0, 100.0, (plate,), Subject(), events, "+z", None)
    path = tmp_path_factory.mktemp("long") / "long.c3d"
    write_c3d(path, recording)
    return path, recording


def test_more_frames_than_the_header_counts_are_written_and_read(long_file: tuple[Path, Recording]) -> None:
    path, recording = long_file
    stated = read_plain(path)
    assert stated.numbers("TRIAL", "ACTUAL_START_FIELD") == [1, 0]
    assert stated.numbers("TRIAL", "ACTUAL_END_FIELD") == [N_LONG - 65536, 1]
    back = read_recording(path)
    assert (back.n_frames, len(back.plates[0].force_n)) == (N_LONG, N_LONG)
    for label, track in recording.markers_m.items():
        np.testing.assert_allclose(back.markers_m[label], track, atol=1e-6)
    np.testing.assert_allclose(back.plates[0].force_n, recording.plates[0].force_n, atol=1e-3)
    assert [event.time_s for event in back.events] == pytest.approx([690.5])


def test_points_are_added_to_more_frames_than_the_header_counts(
    long_file: tuple[Path, Recording], tmp_path: Path
) -> None:
    path, recording = long_file
    com = np.column_stack([np.linspace(0.0, 1.0, N_LONG), np.full(N_LONG, 0.2), np.full(N_LONG, 0.9)])
    add_points_to_c3d(path, tmp_path / "com.c3d", {"COM": com}, "+z")
    back = read_recording(tmp_path / "com.c3d")
    assert back.n_frames == N_LONG
    np.testing.assert_allclose(back.markers_m["COM"], com, atol=1e-6)
    np.testing.assert_allclose(back.markers_m["M3"], recording.markers_m["M3"], atol=1e-6)


@pytest.mark.parametrize(("value", "kind"), [(0.0, 2), (-7.0, 2), (32767.0, 2), (2.5, 4), (40000.0, 4)])
def test_offsets_of_a_float_type_become_integers_where_they_are(value: float, kind: int, tmp_path: Path) -> None:
    """As the C3D manual has them: py-c3d reads them as 16-bit integers whatever their type, and fails on floats."""
    points = {f"M{i}": np.full((40, 3), 300.0 * i) for i in range(5)}
    signals = np.random.default_rng(3).normal(0.0, 5.0, (400, 6)) - [0.0, 0.0, 700.0, 0.0, 0.0, 0.0]
    source = write_file(tmp_path / "upload.c3d", points, plates=[PlateChannels(2, signals)])
    as_floats = bytes([4, 1, 6]) + struct.pack("<6f", *[value] * 6)
    source.write_bytes(with_parameter(source.read_bytes(), "ANALOG", "OFFSET", as_floats))
    target = tmp_path / "com.c3d"
    add_points_to_c3d(source, target, {"CentreOfMass": np.full((40, 3), 0.9)}, "+y")
    before, after = read_plain(source), read_plain(target)
    assert before.parameters["ANALOG", "OFFSET"] == (4, (6,), [value] * 6)
    assert after.parameters["ANALOG", "OFFSET"] == (kind, (6,), [value] * 6)
    np.testing.assert_array_equal(after.analogs, before.analogs)
    a, b = (np.linalg.norm(read_recording(path).plates[0].force_n, axis=1) for path in (source, target))
    np.testing.assert_allclose(b, a, rtol=1e-12)


def test_scales_of_an_integer_type_become_floats(tmp_path: Path) -> None:
    source, target = upload(tmp_path), tmp_path / "com.c3d"
    as_words = bytes([2, 1, 6]) + struct.pack("<6h", *[3] * 6)
    source.write_bytes(with_parameter(source.read_bytes(), "ANALOG", "SCALE", as_words))
    add_points_to_c3d(source, target, {"CentreOfMass": np.full((40, 3), 0.9)}, "+y")
    assert read_plain(target).parameters["ANALOG", "SCALE"] == (4, (6,), [3.0] * 6)
