"""Belts of treadmills: stated or estimated, one for each foot, compared with the feet."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stridelab.errors import InvalidInput
from stridelab.recordings.foot_contact import find_feet, stance_velocity_m_s, stated_belts_m_s, walking_surface_m_s
from stridelab.recordings.force_windows import find_windows
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Plate, PlateSwitches, Recording, Remark
from stridelab.walking.gait_events import find_contacts
from support.recordings.export_files import qualisys_markers, write_trc_mot
from support.recordings.walks import (
    LANDMARKS,
    STANCE_S,
    STEP_M,
    STEP_S,
    WEIGHT_N,
    contacts,
    corners,
    share_of_weight,
    walk,
)

MEAN_M_S = STEP_M / STEP_S
N_STEPS = 9
_JUMP_FRAMES = 4


def carried_on(time_s: np.ndarray, side: str, faster_m_s: float) -> np.ndarray:
    """How far a belt that is faster than the mean has carried a foot back; each swing brings it forward again."""
    way_m = np.zeros(len(time_s))
    stances = [c for c in contacts(N_STEPS + 2) if c.side == side]
    instants = np.array([t for c in stances for t in (c.start_s, c.end_s)])
    ends_m = np.array([m for _ in stances for m in (-0.5, 0.5)]) * STANCE_S * faster_m_s
    way_m[:] = np.interp(time_s, instants, ends_m)
    return way_m


def split_belts(left_m_s: float, right_m_s: float, *, belts: tuple[float, float] | None = None) -> Recording:
    """The schematic walk on two belts, whose plates share one origin and the corners of the whole treadmill."""
    on_floor = walk((), n_steps=N_STEPS)
    faster = {"l": left_m_s - MEAN_M_S, "r": right_m_s - MEAN_M_S}
    markers = {}
    for label, track in on_floor.markers_m.items():
        way_m = MEAN_M_S * on_floor.time_s
        if label[:2] in ("l_", "r_"):
            way_m = way_m + carried_on(on_floor.time_s, label[0], faster[label[0]])
        markers[label] = track - np.outer(way_m, [1.0, 0.0, 0.0])
    force_s = np.arange(round(on_floor.duration_s * on_floor.force_rate_hz)) / on_floor.force_rate_hz
    plates = []
    for index, side in enumerate("lr", start=1):
        force = np.zeros((len(force_s), 3))
        cop = np.column_stack([np.interp(force_s, on_floor.time_s, axis) for axis in markers[f"{side}_heel"].T])
        cop = cop * [1.0, 1.0, 0.0] + [0.09, 0.0, 0.0]
        for c in (c for c in contacts(N_STEPS + 2) if c.side == side):
            force[:, 2] += WEIGHT_N * np.maximum(share_of_weight(c, [], force_s), 0.0)
        speed = None if belts is None else belts[index - 1]
        plates.append(
            Plate(
                index,
                2,
                corners((0.0, 0.0, 0.0), (2.0, 1.0)),
                force,
                np.cross(cop, force),
                np.zeros(3),
                True,
                20.0,
                speed,
            )
        )
    remarks = (Remark("treadmill", "Two belts."),)
    return replace(on_floor, markers_m=markers, plates=tuple(plates), remarks=remarks)


@pytest.mark.parametrize(("left_m_s", "right_m_s"), [(1.2, 1.2), (1.6, 0.8), (0.7, 1.7)])
@pytest.mark.parametrize("stated", [True, False])
def test_every_foot_has_its_own_belt(left_m_s: float, right_m_s: float, *, stated: bool) -> None:
    recording = split_belts(left_m_s, right_m_s, belts=(left_m_s, right_m_s) if stated else None)
    ground = {foot.side: foot.ground_m_s for foot in find_feet(recording, LANDMARKS)}
    assert ground["left"] == pytest.approx([-left_m_s, 0.0, 0.0], abs=0.02)
    assert ground["right"] == pytest.approx([-right_m_s, 0.0, 0.0], abs=0.02)
    assert walking_surface_m_s(recording, LANDMARKS) == pytest.approx([-MEAN_M_S, 0.0, 0.0], abs=0.02)


def test_the_stances_on_split_belts_are_those_of_the_floor() -> None:
    """With one speed for both feet the foot on the slow belt would seem to swing while it stands."""
    floor = find_contacts(walk((), n_steps=N_STEPS), LANDMARKS, plates=False)
    belts = find_contacts(split_belts(1.7, 0.7), LANDMARKS, plates=False)
    assert [c.side for c in belts] == [c.side for c in floor]
    for one, other in zip(belts, floor, strict=True):
        assert one.start_s == pytest.approx(other.start_s, abs=0.06)


def with_raised_foot(recording: Recording, height_m: float, *, slope: float = 0.0) -> tuple[Recording, np.ndarray]:
    """The recording with the right foot raised through one stance, as if dragged back in the air; and frames of it."""
    stance = [c for c in contacts(N_STEPS + 2) if c.side == "r"][2]
    raised = (recording.time_s > stance.start_s + 0.1) & (recording.time_s < stance.end_s - 0.1)
    markers = {}
    for label, track in recording.markers_m.items():
        up_m = height_m * raised if label.startswith("r_") else 0.0 * raised
        markers[label] = track + np.outer(up_m, [0.0, 0.0, 1.0]) - np.outer(slope * track[:, 0], [0.0, 0.0, 1.0])
    return replace(recording, markers_m=markers), np.flatnonzero(raised)[_JUMP_FRAMES:-_JUMP_FRAMES]


def resting_share(recording: Recording, frames: np.ndarray) -> float:
    right = next(foot for foot in find_feet(recording, LANDMARKS) if foot.side == "right")
    return float(right.resting[frames].any(axis=1).mean())


@pytest.mark.parametrize(("height_m", "share"), [(0.0, 1.0), (0.03, 1.0), (0.08, 0.0)])
def test_a_foot_above_a_level_belt_does_not_rest_on_it(height_m: float, share: float) -> None:
    """A foot that has just left the belt still moves with it."""
    assert resting_share(*with_raised_foot(split_belts(1.2, 1.2), height_m)) == share


def test_a_raised_foot_rests_where_the_ground_may_be_higher() -> None:
    assert resting_share(*with_raised_foot(walk((), n_steps=N_STEPS), 0.08)) == 1.0
    assert resting_share(*with_raised_foot(split_belts(1.2, 1.2), 0.08, slope=0.1)) == 1.0


def test_belts_that_share_an_origin_and_corners_measure_all_force() -> None:
    recording = split_belts(1.4, 1.0)
    (window,) = find_windows(recording, LANDMARKS, None).windows
    assert window.duration_s > 0.9 * recording.duration_s


def test_stated_belts_are_used_and_reported(tmp_path: Path) -> None:
    path = write_trc_mot(tmp_path / "walk.zip", split_belts(1.4, 1.0))
    switches = {1: PlateSwitches(belt_speed_m_s=1.4), 2: PlateSwitches(belt_speed_m_s=1.0)}
    recording = read_recording(path, plate_switches=switches)
    assert stated_belts_m_s(recording) == {1: 1.4, 2: 1.0}
    assert recording.walking_direction == pytest.approx([1.0, 0.0, 0.0], abs=0.02)
    (message,) = [remark.message for remark in recording.remarks if remark.code == "treadmill"]
    assert "1.40 m/s (plate 1) and 1.00 m/s (plate 2), as stated" in message


@pytest.mark.parametrize("speed_m_s", [0.6, 2.5])
def test_a_speed_that_is_not_that_of_the_feet_is_refused(tmp_path: Path, speed_m_s: float) -> None:
    path = write_trc_mot(tmp_path / "walk.zip", split_belts(1.2, 1.2))
    with pytest.raises(InvalidInput, match=r"1\.20 m/s") as refused:
        read_recording(path, plate_switches={1: PlateSwitches(belt_speed_m_s=speed_m_s)})
    assert refused.value.code == "belt-speed-contradicts-feet"
    assert refused.value.faults[0].where == "plates.1.belt_speed_m_s"


def test_a_belt_under_a_walk_over_the_floor_is_refused(tmp_path: Path) -> None:
    path = write_trc_mot(tmp_path / "walk.zip", walk(range(8)))
    with pytest.raises(InvalidInput) as refused:
        read_recording(path, plate_switches={1: PlateSwitches(belt_speed_m_s=1.2)})
    assert refused.value.code == "belt-speed-contradicts-feet"


def test_a_belt_of_a_plate_that_is_not_there_is_refused(tmp_path: Path) -> None:
    path = write_trc_mot(tmp_path / "walk.zip", split_belts(1.2, 1.2))
    with pytest.raises(InvalidInput) as refused:
        read_recording(path, plate_switches={9: PlateSwitches(belt_speed_m_s=1.2)})
    assert refused.value.code == "unknown-plate"


def test_for_a_static_trial_the_belts_stand(tmp_path: Path) -> None:
    moving = split_belts(1.2, 1.2)
    still = {label: np.tile(track[50], (len(track), 1)) for label, track in moving.markers_m.items()}
    path = write_trc_mot(tmp_path / "static.zip", replace(moving, markers_m=still))
    recording = read_recording(path, plate_switches={1: PlateSwitches(belt_speed_m_s=1.2)})
    codes = {remark.code for remark in recording.remarks}
    assert "belt-stopped" in codes
    assert "treadmill" not in codes


def bare(path: Path, recording: Recording) -> Path:
    """The markers alone, as a TSV file."""
    path.write_text(qualisys_markers(replace(recording, plates=())), encoding="utf-8")
    return path


@pytest.mark.parametrize(("left_m_s", "right_m_s"), [(1.2, 1.2), (1.6, 0.8)])
@pytest.mark.parametrize("stated", [True, False])
def test_a_treadmill_needs_no_plates(tmp_path: Path, left_m_s: float, right_m_s: float, *, stated: bool) -> None:
    path = bare(tmp_path / "walk.tsv", split_belts(left_m_s, right_m_s))
    speeds = {1: left_m_s, 2: right_m_s} if stated else {}
    recording = read_recording(path, plate_switches={i: PlateSwitches(belt_speed_m_s=v) for i, v in speeds.items()})
    assert recording.walking_direction == pytest.approx([1.0, 0.0, 0.0], abs=0.02)
    assert stated_belts_m_s(recording) == speeds
    ground = {foot.side: foot.ground_m_s for foot in find_feet(recording, LANDMARKS)}
    assert ground["left"] == pytest.approx([-left_m_s, 0.0, 0.0], abs=0.03)
    assert ground["right"] == pytest.approx([-right_m_s, 0.0, 0.0], abs=0.03)
    (message,) = [remark.message for remark in recording.remarks if remark.code == "treadmill"]
    assert ("(belt 2), as stated" in message) == stated


def test_a_belt_without_plates_that_is_not_that_of_the_feet_is_refused(tmp_path: Path) -> None:
    path = bare(tmp_path / "walk.tsv", walk((), n_steps=N_STEPS))
    with pytest.raises(InvalidInput) as refused:
        read_recording(path, plate_switches={1: PlateSwitches(belt_speed_m_s=1.2)})
    assert refused.value.code == "belt-speed-contradicts-feet"


@pytest.mark.parametrize("movement", ["walk", "pedals", "carried"])
def test_without_plates_only_feet_on_a_belt_are_on_a_treadmill(tmp_path: Path, movement: str) -> None:
    """Feet on pedals move backwards when they are low, those in a wheelchair with the whole body."""
    floor = walk((), n_steps=N_STEPS)
    time_s, markers = floor.time_s, dict(floor.markers_m)
    for label, track in markers.items():
        foot = label[:2] in ("l_", "r_") and float(np.median(track[:, 2])) < 0.3
        if movement == "pedals":
            turn = 2.0 * np.pi * 1.3 * time_s + (np.pi if label[0] == "r" else 0.0)
            circle = 0.17 * np.column_stack([np.sin(turn), np.zeros(len(turn)), 1.0 + np.cos(turn)])
            markers[label] = track[0] + (circle if foot else 0.0 * circle)
        if movement == "carried":
            markers[label] = track[0] + np.outer(1.2 * time_s, [1.0, 0.0, 0.0])
    recording = read_recording(bare(tmp_path / "trial.tsv", replace(floor, markers_m=markers)))
    assert "treadmill" not in {remark.code for remark in recording.remarks}


def test_a_marker_that_is_hardly_ever_visible_has_no_velocity() -> None:
    """One frame alone has no velocity: the ground under it does not move, and nothing warns."""
    track = np.full((50, 3), np.nan)
    track[20] = [0.1, 0.2, 0.05]
    np.testing.assert_array_equal(stance_velocity_m_s([track], 100.0), np.zeros(3))
