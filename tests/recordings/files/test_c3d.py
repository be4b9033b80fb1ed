"""Traps of C3D files that show only in a whole file; each built on purpose."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import PlateSwitches, Recording, Subject
from support.recordings.c3d_files import FLAT_CORNERS_MM, PlateChannels, write_file

N = 60


def body(scale: float = 1000.0) -> dict[str, np.ndarray]:
    """Eight markers of a person who walks along x over the plate, z up, in units of 1/scale metres."""
    rng = np.random.default_rng(3)
    rest = rng.uniform([0.1, 0.1, 0.02], [0.4, 0.3, 1.7], (8, 3))
    travel = np.column_stack([np.linspace(0.0, 0.7, N), np.zeros(N), np.zeros(N)])
    return {f"M{i}": scale * (rest[i] + travel) for i in range(8)}


def standing(weight_n: float = 700.0) -> PlateChannels:
    signals = np.zeros((10 * N, 6))
    signals[200:500, 2] = -weight_n
    return PlateChannels(2, signals)


def codes(recording: Recording) -> set[str]:
    return {remark.code for remark in recording.remarks}


def test_a_file_with_y_up_reads_as_with_z_up(tmp_path: Path) -> None:
    """The same scene with y up: markers, corners and force come out as with z up."""
    turn = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    plate = PlateChannels(2, standing().signals, corners_mm=FLAT_CORNERS_MM @ turn.T)
    points = {label: track @ turn.T for label, track in body().items()}
    turned = read_recording(write_file(tmp_path / "y.c3d", points, plates=[plate]))
    straight = read_recording(write_file(tmp_path / "z.c3d", body(), plates=[standing()]))
    assert (turned.up_axis, straight.up_axis) == ("+y", "+z")
    for label, track in straight.markers_m.items():
        np.testing.assert_allclose(turned.markers_m[label], track, atol=1e-6)
    np.testing.assert_allclose(turned.plates[0].moment_nm, straight.plates[0].moment_nm, atol=1e-4)
    np.testing.assert_allclose(turned.walking_direction, [1, 0, 0], atol=1e-6)


@pytest.mark.parametrize("hint", ["+Y", "-Z"])
def test_the_force_overrules_a_wrong_screen_hint(hint: str, tmp_path: Path) -> None:
    """BTS writes +Y where y is up, Qualisys -Z where z is up; others write anything."""
    extra = {("POINT", "Y_SCREEN"): hint}
    assert read_recording(write_file(tmp_path / "a.c3d", body(), plates=[standing()], parameters=extra)).up_axis == "+z"


def test_without_plates_the_screen_hint_decides(tmp_path: Path) -> None:
    recording = read_recording(write_file(tmp_path / "a.c3d", body(), parameters={("POINT", "Y_SCREEN"): "-Z"}))
    assert recording.up_axis == "+z"
    assert recording.plates == ()


def test_prefixes_unlabelled_points_and_duplicates_are_handled(tmp_path: Path) -> None:
    tracks = list(body().values())
    gappy = tracks[1].copy()
    gappy[5:50] = np.nan
    points = {"Dora:LASI": tracks[0], "Dora:RASI": gappy, "*115": tracks[2], "Dora:SACR": tracks[3], "RASI": tracks[4]}
    recording = read_recording(write_file(tmp_path / "a.c3d", points))
    assert set(recording.markers_m) == {"LASI", "RASI", "SACR"}
    np.testing.assert_allclose(recording.markers_m["RASI"], tracks[4] / 1000.0, atol=1e-6)
    assert {"unlabelled-points", "duplicate-labels"} <= codes(recording)
    assert "Dora" not in repr(recording)


def test_more_points_than_one_list_of_labels_holds(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    points = {f"P{i:03d}": 1000 * rng.uniform(0.1, 1.7, 3) + np.zeros((N, 3)) for i in range(300)}
    recording = read_recording(write_file(tmp_path / "a.c3d", points))
    assert len(recording.markers_m) == 300
    np.testing.assert_allclose(recording.markers_m["P299"], points["P299"] / 1000.0, atol=1e-6)


def test_angles_among_the_points_are_no_markers(tmp_path: Path) -> None:
    points = body() | {"LHipAngles": np.full((N, 3), 30.0), "LFETBA": np.full((N, 3), 12.0)}
    extra = {("POINT", "ANGLES"): ["LHipAngles", "LFETBA"]}
    recording = read_recording(write_file(tmp_path / "a.c3d", points, parameters=extra))
    assert set(recording.markers_m) == set(body())


def test_gaps_may_be_nan_or_zeros(tmp_path: Path) -> None:
    points = body()
    points["M0"][10:15] = np.nan
    points["M1"][10:15] = 0.0
    points["M2"][10:40] = 0.0
    recording = read_recording(write_file(tmp_path / "a.c3d", points))
    assert np.flatnonzero(recording.filled["M0"]).tolist() == list(range(10, 15))
    assert np.flatnonzero(recording.filled["M1"]).tolist() == list(range(10, 15))
    np.testing.assert_allclose(recording.markers_m["M1"], body()["M1"] / 1000.0, atol=1e-5)
    assert np.isnan(recording.markers_m["M2"][10:40]).all()
    assert "gaps-filled" in codes(recording)


def test_a_marker_that_is_never_seen_is_no_marker(tmp_path: Path) -> None:
    recording = read_recording(write_file(tmp_path / "a.c3d", body() | {"GHOST": np.full((N, 3), np.nan)}))
    assert "GHOST" not in recording.markers_m


@pytest.mark.parametrize(("unit", "scale"), [("mm", 1000.0), ("m", 1.0), ("cm", 100.0)])
def test_units_of_length_become_metres(unit: str, scale: float, tmp_path: Path) -> None:
    recording = read_recording(write_file(tmp_path / "a.c3d", body(scale), unit=unit))
    np.testing.assert_allclose(recording.markers_m["M3"], body(1.0)["M3"], atol=1e-5)
    assert "unit-corrected" not in codes(recording)


@pytest.mark.parametrize("scale", [1.0, 100.0])
def test_corners_keep_their_unit_when_only_the_markers_have_another(scale: float, tmp_path: Path) -> None:
    """The file says mm: its corners are, its markers are in m or cm."""
    wrong = write_file(tmp_path / "a.c3d", body(scale), plates=[standing()])
    recording = read_recording(wrong)
    (plate,) = recording.plates
    np.testing.assert_allclose(plate.corners_m, FLAT_CORNERS_MM / 1000.0, atol=1e-6)
    np.testing.assert_allclose(recording.markers_m["M3"], body(1.0)["M3"], atol=1e-5)
    assert "unit-corrected" in codes(recording)


def test_event_times_count_from_the_original_recording(tmp_path: Path) -> None:
    extra: dict[tuple[str, str], Any] = {
        ("EVENT", "USED"): [2],
        ("EVENT", "LABELS"): ["Foot Strike", "Foot Off"],
        ("EVENT", "CONTEXTS"): ["Left", "Right"],
        ("EVENT", "TIMES"): np.array([[0.0, 1.0], [3.1, 0.2]]),
    }
    recording = read_recording(write_file(tmp_path / "a.c3d", body(), parameters=extra, first_frame=285))
    assert [event.time_s for event in recording.events] == pytest.approx([0.25, 57.35], abs=1e-5)
    assert [event.side for event in recording.events] == ["left", "right"]


def test_subject_of_both_dialects_and_no_name(tmp_path: Path) -> None:
    vicon = {
        ("PROCESSING", "Bodymass"): [85.0],
        ("PROCESSING", "Height"): [1679.0],
        ("SUBJECTS", "NAMES"): ["Dora"],
    }
    recording = read_recording(write_file(tmp_path / "v.c3d", body(), parameters=vicon))
    assert recording.subject == Subject(1.679, 85.0)
    assert "Dora" not in repr(recording)
    lab = {
        ("SUBJECT", "LABELS"): ["age", "gender", "weight", "height"],
        ("SUBJECT", "VALUES"): np.array([99.0, 1.0, 61.0, 1.7]),
    }
    recording = read_recording(write_file(tmp_path / "l.c3d", body(), parameters=lab))
    assert recording.subject == Subject(1.7, 61.0, "male", None)
    assert "filler-in-subject" in codes(recording)


def test_switches_leave_a_plate_out_or_raise_its_threshold(tmp_path: Path) -> None:
    path = write_file(tmp_path / "a.c3d", body(), plates=[standing(), standing(30.0)])
    switches = {1: PlateSwitches(use=False), 2: PlateSwitches(threshold_n=40.0)}
    one, two = read_recording(path, plate_switches=switches).plates
    assert (one.use, one.threshold_n) == (False, 20.0)
    assert (two.use, two.threshold_n) == (True, 40.0)
    assert not two.loaded.any()


def test_a_plate_that_speeds_the_foot_up_at_landing_is_flagged(tmp_path: Path) -> None:
    """Brake, then push; the other way round the plate lies turned in the file."""
    signals = standing().signals.copy()
    t = np.linspace(0.0, 1.0, 300)
    for name, sign in (("right", 1.0), ("turned", -1.0)):
        signals[200:500, 0] = sign * 80.0 * np.sin(2 * np.pi * t)
        recording = read_recording(write_file(tmp_path / f"{name}.c3d", body(), plates=[PlateChannels(2, signals)]))
        assert ("fore-aft-reversed" in codes(recording)) == (name == "turned")


def test_one_frame_without_analog_is_a_static_trial(tmp_path: Path) -> None:
    recording = read_recording(write_file(tmp_path / "a.c3d", {k: v[:1] for k, v in body().items()}))
    assert recording.n_frames == 1
    assert recording.walking_direction is None


def test_parameters_may_be_stored_as_columns(tmp_path: Path) -> None:
    """Rehazenter shapes FORCE_PLATFORM's lists as columns."""
    extra = {("FORCE_PLATFORM", "TYPE"): np.array([[2], [2]]), ("FORCE_PLATFORM", "USED"): np.array([[2]])}
    path = write_file(tmp_path / "a.c3d", body(), plates=[standing(), standing()], parameters=extra)
    assert len(read_recording(path).plates) == 2
