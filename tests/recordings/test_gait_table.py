"""Every shared recording is read, and has the windows and the mass that the table says, or is refused as it says."""

import os
from pathlib import Path

import numpy as np
import pytest

from stridelab.body.segment_model import SegmentModel
from stridelab.errors import NotEstimable
from stridelab.recordings.body_mass import VerticalMotion, best_mass, vertical_motion, weigh
from stridelab.recordings.force_plates import plate_axes
from stridelab.recordings.force_windows import find_windows, require_windows
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.plate_contacts import centre_of_pressure_m
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Recording
from support.recordings.gait_table import ESTIMABLE, GAIT_TABLE, GaitTrial, trial

GAIT = Path(os.environ.get("STRIDELAB_TEST_DATA", Path(__file__).parents[3] / "shared")).resolve() / "gait"
if not GAIT.is_dir():
    pytest.skip("real recordings are not here (set STRIDELAB_TEST_DATA)", allow_module_level=True)

WALKS = [row for row in GAIT_TABLE if "rehazenter" in row.files[0] and row.outcome == ESTIMABLE]
TWO_STEP_WALKS = [row for row in WALKS if row.name != "2014001_C3_04"]


def read(row: GaitTrial, folder: Path) -> tuple[Recording, dict[str, str]]:
    recording = read_recording(row.uploaded(GAIT, folder))
    return recording, dict(identify(list(recording.markers_m)).landmarks)


def moves(recording: Recording, landmarks: dict[str, str]) -> VerticalMotion | None:
    try:
        com_m = SegmentModel().com(recording, landmarks, subject=recording.subject).com_m
    except NotEstimable:
        com_m = None
    return vertical_motion(recording, landmarks, com_m)


def test_the_table_names_every_file() -> None:
    listed = {file for row in GAIT_TABLE for file in row.files}
    files = {str(path.relative_to(GAIT)) for suffix in ("c3d", "trc", "mot") for path in GAIT.rglob(f"*.{suffix}")}
    assert listed == files
    assert sum(file.endswith(".c3d") for file in listed) == 62


@pytest.mark.parametrize("row", GAIT_TABLE, ids=lambda row: row.name)
def test_outcome_windows_and_mass(row: GaitTrial, tmp_path: Path) -> None:
    recording, landmarks = read(row, tmp_path)
    motion, stated_kg = moves(recording, landmarks), recording.subject.mass_kg
    search = find_windows(recording, landmarks, motion, stated_kg=stated_kg)
    assert [(w.start_s, w.end_s) for w in search.windows] == [pytest.approx(w, abs=0.011) for w in row.windows_s]
    if row.outcome == ESTIMABLE:
        assert require_windows(recording, landmarks, motion, stated_kg=stated_kg) == search.windows
    else:
        with pytest.raises(NotEstimable) as refused:
            require_windows(recording, landmarks, motion, stated_kg=stated_kg)
        assert refused.value.code == row.outcome
    mass = best_mass(weigh(recording, search.windows, motion))
    assert (mass is None) == (row.measured_mass_kg is None)
    if mass is not None:
        assert mass.mass_kg == pytest.approx(row.measured_mass_kg, abs=0.02)
        if row.stated_mass_kg is not None and row.mass_tolerance is not None:
            assert mass.mass_kg == pytest.approx(row.stated_mass_kg, rel=row.mass_tolerance)


def test_the_mass_of_adults_at_their_own_speed_is_that_stated() -> None:
    """The bars: 3 % at C4, 1 % for the demonstration trial."""
    rows = [row for row in GAIT_TABLE if row.adult_at_own_speed]
    assert len(rows) == 11
    assert all(row.mass_tolerance is not None and row.mass_tolerance <= 0.03 for row in rows)
    assert trial("2014022_C4_04").mass_tolerance == 0.01


@pytest.mark.parametrize("row", TWO_STEP_WALKS, ids=lambda row: row.name)
def test_windows_agree_with_the_events_of_the_file(row: GaitTrial, tmp_path: Path) -> None:
    """The window ends at the first second strike of a foot, and starts at the first foot off: within 40 and 20 ms."""
    recording, landmarks = read(row, tmp_path)
    (window,) = find_windows(recording, landmarks).windows
    lift_s = min(event.time_s for event in recording.events if event.kind == "foot_off")
    strikes = {
        side: [e.time_s for e in recording.events if e.kind == "foot_strike" and e.side == side]
        for side in ("left", "right")
    }
    second_s = min(max(times) for times in strikes.values() if len(times) > 1)
    assert -0.005 <= window.start_s - lift_s <= 0.045
    assert -0.025 <= window.end_s - second_s <= 0.015


def test_windows_agree_with_events_on_average(tmp_path: Path) -> None:
    late_s = []
    for row in TWO_STEP_WALKS:
        recording, landmarks = read(row, tmp_path)
        (window,) = find_windows(recording, landmarks).windows
        late_s.append(window.start_s - min(e.time_s for e in recording.events if e.kind == "foot_off"))
    assert 0.0 <= float(np.mean(late_s)) <= 0.02


def test_foot_beside_the_plates_is_flagged(tmp_path: Path) -> None:
    recording, landmarks = read(trial("2014001_C3_04"), tmp_path)
    search = find_windows(recording, landmarks)
    assert "one-step-window" in {remark.code for remark in search.remarks}


def test_two_feet_on_one_plate_is_flagged(tmp_path: Path) -> None:
    recording, landmarks = read(trial("walk"), tmp_path)
    assert "two-feet-on-one-plate" in {remark.code for remark in find_windows(recording, landmarks).remarks}


def test_personal_names_are_not_read(tmp_path: Path) -> None:
    """The stairs trial calls its subject Test and kineticstoolkit's 1111111111 (SUBJECTS:NAMES)."""
    for name in ("Movement_trial", "walk"):
        recording, _ = read(trial(name), tmp_path)
        content = repr((recording.subject, recording.remarks, recording.carried, list(recording.markers_m)))
        assert "Test" not in content
        assert "1111111111" not in content


@pytest.mark.parametrize("row", [r for r in GAIT_TABLE if r.outcome == ESTIMABLE], ids=lambda row: row.name)
def test_loaded_centre_of_pressure_lies_on_its_plate(row: GaitTrial, tmp_path: Path) -> None:
    recording, _ = read(row, tmp_path)
    for plate in recording.plates:
        cop = centre_of_pressure_m(plate)[np.abs(plate.force_n[:, 2]) > 100.0]
        if len(cop):
            local = (cop - plate.corners_m.mean(axis=0)) @ plate_axes(plate.corners_m)
            half = 0.5 * np.linalg.norm(plate.corners_m[[0, 0]] - plate.corners_m[[1, 3]], axis=1)
            assert np.mean(np.all(np.abs(local[:, :2]) < half + 0.02, axis=1)) > 0.97


def test_axes_directions_and_treadmills(tmp_path: Path) -> None:
    bts, _ = read(trial("BTS"), tmp_path)
    assert bts.up_axis == "+y"
    backwards, _ = read(trial("Straight_HC036A10"), tmp_path)
    assert backwards.walking_direction is not None
    assert backwards.walking_direction[1] < -0.99
    belt, _ = read(trial("walking_1"), tmp_path)
    codes = [remark.code for remark in belt.remarks]
    assert codes.count("plate-origin-negated") == 2
    assert "treadmill" in codes
    stairs, _ = read(trial("Movement_trial"), tmp_path)
    assert "unlabelled-points" in {remark.code for remark in stairs.remarks}
    offsets_n = [plate.tare_force_n[2] for plate in stairs.plates]
    assert 30.0 < sum(offsets_n) < 50.0


def test_model_outputs_are_no_markers(tmp_path: Path) -> None:
    child, _ = read(trial("Straight_HC032A03"), tmp_path)
    assert 50 < len(child.markers_m) < 70
    assert {"CentreOfMass", "PELO", "LHJC"} <= set(child.model_points_m)
    labels = set(child.markers_m) | set(child.model_points_m)
    assert not {label for label in labels if label.endswith(("Angles", "Power", "Force", "Moment", "PELA1"))}


def test_wrench_equals_ezc3d_where_ezc3d_is_right(tmp_path: Path) -> None:
    """An independent library on untared type-2 plates with a plain ORIGIN: forces to 1e-9 N, moments to 1e-6 Nm."""
    import ezc3d

    path = trial("2014022_C4_04").uploaded(GAIT, tmp_path)
    ours = read_recording(path)
    theirs = ezc3d.c3d(str(path), extract_forceplat_data=True)["data"]["platform"]
    for plate, other in zip(ours.plates, theirs, strict=True):
        centre_m = other["corners"].mean(axis=1) / 1000.0
        force = other["force"].T
        moment = other["moment"].T / 1000.0 + np.cross(centre_m, force)
        np.testing.assert_allclose(plate.force_n + plate.tare_force_n, force, atol=1e-9)
        untared = np.abs(plate.tare_force_n).max() < 1e-9
        np.testing.assert_allclose(plate.moment_nm, moment, atol=1e-6 if untared else 0.5)
