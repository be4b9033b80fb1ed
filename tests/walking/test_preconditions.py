"""What is no straight, level walk is refused with what was seen; walks are not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stridelab.errors import NotEstimable
from stridelab.recordings.force_windows import measured_windows
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Recording
from stridelab.reproduction.studies.estimator_study import clean_motion
from stridelab.simulation.noise import NOISE_FREE
from stridelab.simulation.robot_recording import record_robot
from stridelab.translations.catalogue import ENGLISH, LANGUAGES, in_language, translate_sentence
from stridelab.walking.gait_events import find_contacts
from stridelab.walking.preconditions import require_steps, require_walk
from stridelab.walking.steps import find_steps
from support.recordings.walks import LANDMARKS as FEET
from support.recordings.walks import walk

LANDMARKS = {**FEET, "l_asis": "pelvis_0", "r_asis": "pelvis_4", "sacrum": "pelvis_2"}
REAL_WALKS = (
    "rehazenter-adult-walking/2014001/2014001_C1_03.c3d",
    "rehazenter-adult-walking/2014001/2014001_C5_01.c3d",
    "biomechzoo-sample-study/HC040A/Straight_HC040A14.c3d",
    "ezc3d-testfiles/BTS.c3d",
    "rtosim-treadmill/walking_1.c3d",
)


def judge(recording: Recording, landmarks: dict[str, str] | None = None) -> None:
    known = LANDMARKS if landmarks is None else landmarks
    require_walk(recording, known, find_contacts(recording, known))


def refused(recording: Recording, landmarks: dict[str, str] | None = None) -> NotEstimable:
    """The refusal; pages show it in every language."""
    with pytest.raises(NotEstimable) as caught:
        judge(recording, landmarks)
    for language in LANGUAGES.keys() - {ENGLISH}:
        with in_language(language):
            assert translate_sentence(caught.value.message), (language, caught.value.message)
    return caught.value


def real(path: Path) -> tuple[Recording, dict[str, str]]:
    recording = read_recording(path)
    return recording, dict(identify(list(recording.markers_m)).landmarks)


def moved(recording: Recording, change) -> Recording:  # type: ignore[no-untyped-def]
    return replace(recording, markers_m={label: change(track) for label, track in recording.markers_m.items()})


def test_a_simulated_walk_passes_all_preconditions() -> None:
    judge(walk([2, 3]))
    judge(walk([]))


@pytest.mark.parametrize("name", REAL_WALKS)
def test_real_walks_slow_fast_small_and_on_a_belt_are_walks(gait: Path, name: str) -> None:
    judge(*real(gait / name))


def test_stairs_are_refused_with_their_heights() -> None:
    climbing = moved(walk([]), lambda track: track + np.outer(track[:, 0], [0.0, 0.0, 0.25]))
    error = refused(climbing)
    assert error.code == "stairs"
    assert "0.33, 0.48, 0.63, 0.78" in error.message
    assert error.faults[0].where == "contacts"


def test_real_stairs_turns_and_standing_are_refused(gait: Path) -> None:
    stairs = refused(*real(gait / "pycgm-stairs/Movement_trial.c3d"))
    assert stairs.code == "stairs"
    assert "0.20 m apart" in stairs.message
    turn = refused(*real(gait / "biomechzoo-sample-study/HC032A/Turn_HC032A18.c3d"))
    assert turn.code == "turning"
    assert "90 degrees in all" in turn.message
    for name in ("biomechzoo-sample-study/HC032A/Static_HC032A01.c3d", "pycgm-stairs/Static_trial.c3d"):
        standing = refused(*real(gait / name))
        assert standing.code == "standing"
        assert "the pelvis moves by 0.007 m" in standing.message


def test_a_walk_along_an_arc_is_turning() -> None:
    """The plane is bent by 0.25 rad per metre: 9 degrees per step."""

    def bend(track: np.ndarray) -> np.ndarray:
        angle, radius = 0.25 * track[:, 0], 1 / 0.25 - track[:, 1]
        return np.column_stack([radius * np.sin(angle), 1 / 0.25 - radius * np.cos(angle), track[:, 2]])

    error = refused(moved(walk([], n_steps=9), bend))
    assert error.code == "turning"
    assert "from stride to stride" in error.message.lower()
    judge(moved(walk([]), lambda track: track @ np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])))


def test_a_running_robot_is_refused_with_its_flights() -> None:
    running = record_robot(clean_motion("running"), NOISE_FREE, 0).recording
    error = refused(running, dict(identify(list(running.markers_m)).landmarks))
    assert error.code == "running"
    assert "13 of 13 steps have a flight, of 122 ms (median)" in error.message
    assert len(error.faults[0].message.split(",")) == 13


def test_standing_is_refused() -> None:
    still = moved(walk([]), lambda track: np.repeat(track[:1], len(track), axis=0))
    error = refused(still)
    assert error.code == "standing"
    assert "In 3.00 s no foot is lifted and the pelvis moves by 0.000 m" in error.message


def test_feet_without_markers_cannot_step() -> None:
    assert refused(walk([2, 3]), {}).code == "feet-not-marked"


def not_enough(recording: Recording) -> NotEstimable:
    windows = measured_windows(recording, LANDMARKS)
    steps = find_steps(recording, LANDMARKS, windows)
    with pytest.raises(NotEstimable) as caught:
        require_steps(recording, steps, [step for step in steps if step.measured], windows)
    return caught.value


def test_one_plate_cannot_measure_a_step() -> None:
    error = not_enough(walk([3]))
    assert error.code == "one-plate-only"
    assert "plate 1 only" in error.message
    assert "of 5 whole steps" in error.message
    assert [fault.where for fault in error.faults] == ["steps", "all contact force is measured"]


def test_plates_apart_measure_no_step() -> None:
    error = not_enough(walk([1, 4]))
    assert error.code == "no-measured-step"
    assert "There are 5 whole steps" in error.message


def test_a_recording_shorter_than_a_step_is_refused() -> None:
    assert not_enough(walk([2, 3], n_steps=2)).code == "no-whole-step"


def test_measured_steps_are_enough() -> None:
    recording = walk([2, 3])
    windows = measured_windows(recording, LANDMARKS)
    steps = find_steps(recording, LANDMARKS, windows)
    require_steps(recording, steps, steps[:1], windows)


def test_a_walk_backwards_or_sideways_is_refused(gait: Path) -> None:
    """Left is then not on the left of the walk: widths and margins would have the wrong sign."""
    assert refused(moved(walk([]), lambda track: track[::-1])).code == "backwards"
    recording, landmarks = real(gait / "ezc3d-testfiles/Qualisys.c3d")
    backwards = refused(moved(replace(recording, plates=()), lambda track: track[::-1]), landmarks)
    assert backwards.code == "backwards"
    assert "178 degrees" in backwards.message
    ahead = walk([])
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turned = {
        label: ahead.markers_m[f"{label[0]}_heel"] + (track - ahead.markers_m[f"{label[0]}_heel"]) @ quarter.T
        for label, track in ahead.markers_m.items()
        if label in FEET.values()
    }
    sideways = refused(replace(ahead, markers_m={**ahead.markers_m, **turned}))
    assert sideways.code == "sideways"
    assert "90 degrees" in sideways.message
