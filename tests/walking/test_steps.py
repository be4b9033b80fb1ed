"""Steps of the schematic walk: what each is, how long, how fast, and whether the plates saw it whole."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.measures.walk_motion import strides
from stridelab.recordings.foot_contact import find_feet
from stridelab.recordings.force_windows import measured_windows
from stridelab.recordings.recording import Recording, Remark
from stridelab.walking.gait_events import find_contacts
from stridelab.walking.steps import find_steps, footprint_direction
from support.recordings.walks import LANDMARKS as FEET
from support.recordings.walks import STANCE_S, STEP_M, STEP_S, walk

LANDMARKS = {**FEET, "l_asis": "pelvis_0", "r_asis": "pelvis_4", "sacrum": "pelvis_2"}
SPEED_M_S = STEP_M / STEP_S
DOUBLE_S = STANCE_S - STEP_S


def steps_of(recording: Recording):  # type: ignore[no-untyped-def]
    return find_steps(recording, LANDMARKS, measured_windows(recording, LANDMARKS))


def test_every_whole_step_is_detected_with_its_side() -> None:
    steps = steps_of(walk([2, 3]))
    assert [s.side for s in steps] == ["left", "right", "left", "right", "left"]
    for k, step in enumerate(steps):
        assert step.lift_off_s == pytest.approx(STEP_S * k + 0.3, abs=0.025)
        assert step.strike_s == pytest.approx(STEP_S * k + 0.7, abs=0.025)
        assert step.next_lift_off_s == pytest.approx(STEP_S * k + 0.8, abs=0.025)
        if k > 0:  # the first foot stands already
            assert step.prior_strike_s == pytest.approx(STEP_S * k + 0.2, abs=0.025)


def test_length_period_and_speed_are_those_of_the_walk() -> None:
    for step in steps_of(walk([2, 3])):
        assert step.length_m == pytest.approx(STEP_M, abs=0.03)
        assert step.period_s == pytest.approx(STEP_S, abs=0.03)
        assert step.speed_m_s == pytest.approx(SPEED_M_S, rel=1e-6)


def test_between_two_plates_double_support_is_exact() -> None:
    (step,) = [s for s in steps_of(walk([2, 3])) if s.measured]
    start_s, end_s = step.double_support_s
    assert end_s - start_s == pytest.approx(DOUBLE_S - 0.006, abs=0.0021)
    assert step.source == "mixed"
    assert step.start_s < start_s < end_s == step.end_s


def test_more_plates_measure_more_steps_by_themselves() -> None:
    steps = steps_of(walk([1, 2, 3, 4]))
    assert [s.measured for s in steps] == [True, True, True, False, False]
    assert [s.source for s in steps] == ["mixed", "plates", "plates", "mixed", "mixed"]


def test_without_windows_nothing_is_measured_and_all_is_timed_by_markers() -> None:
    recording = replace(walk([2, 3]), plates=())
    steps = find_steps(recording, LANDMARKS)
    assert len(steps) == 5
    assert not any(s.measured for s in steps)
    assert {s.source for s in steps} == {"markers"}


def test_the_belt_of_a_treadmill_counts() -> None:
    """The same walk carried back by a belt: lengths and speeds over the belt stay."""
    walked = walk([2, 3])
    back = np.outer(walked.time_s, [SPEED_M_S, 0.0, 0.0])
    markers = {label: track - back for label, track in walked.markers_m.items()}
    recording = replace(walked, markers_m=markers, plates=(), remarks=(Remark("treadmill", "A belt."),))
    steps = find_steps(recording, LANDMARKS)
    assert len(steps) == 5
    for step in steps:
        assert step.length_m == pytest.approx(STEP_M, abs=0.03)
        assert step.speed_m_s == pytest.approx(SPEED_M_S, rel=0.01)


def test_a_walk_towards_anywhere_has_the_same_steps() -> None:
    walked = walk([])
    angle = 2.1
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    markers = {label: track @ turn.T for label, track in walked.markers_m.items()}
    unknown = replace(walked, markers_m=markers, walking_direction=None)
    for step, same in zip(find_steps(walked, LANDMARKS), find_steps(unknown, LANDMARKS), strict=True):
        assert step.length_m == pytest.approx(same.length_m, abs=1e-6)
        assert step.strike_s == pytest.approx(same.strike_s)


def test_a_hidden_heel_leaves_the_length_open() -> None:
    walked = walk([1, 2, 3, 4])
    heel = walked.markers_m["l_heel"].copy()
    heel[60:140] = np.nan
    steps = steps_of(replace(walked, markers_m={**walked.markers_m, "l_heel": heel}))
    assert any(s.length_m is None for s in steps)


def test_a_hidden_landing_leaves_the_other_steps_and_makes_no_stride_of_two() -> None:
    walked = walk([], n_steps=10)
    steps = find_steps(walked, LANDMARKS)
    lost = steps[4]
    during = (walked.time_s > lost.strike_s - 0.08) & (walked.time_s < lost.strike_s + 0.08)
    markers = {label: track.copy() for label, track in walked.markers_m.items()}
    for label in (label for label in FEET.values() if label.startswith(lost.side[0])):
        markers[label][during] = np.nan
    seen = find_steps(replace(walked, markers_m=markers), LANDMARKS)
    kept = [step for step in steps if step is not lost]
    assert [step.strike_s for step in seen] == pytest.approx([step.strike_s for step in kept])
    assert [step.next_lift_off_s for step in seen] == pytest.approx([step.next_lift_off_s for step in kept])
    strides_s = [later.strike_s - step.strike_s for _, step, later in strides(seen)]
    assert len(strides_s) == len(list(strides(steps))) - 2
    assert strides_s == pytest.approx([2.0 * STEP_S] * len(strides_s), abs=0.03)


def test_a_part_of_a_step_is_no_step() -> None:
    short = walk([2, 3], n_steps=2)
    assert find_steps(short, LANDMARKS) == ()


def direction_of(recording: Recording) -> np.ndarray | None:
    contacts = find_contacts(recording, LANDMARKS)
    return footprint_direction(recording, find_feet(recording, LANDMARKS), contacts)


@pytest.mark.parametrize(("n_steps", "turned_rad"), [(3, 0.0), (4, 0.3), (8, -1.0), (6, 2.5)])
def test_the_line_of_progression_is_that_of_the_footprints(n_steps: int, turned_rad: float) -> None:
    """The feet are 20 cm apart and turned outwards; the body may sway as it likes."""
    c, s = np.cos(turned_rad), np.sin(turned_rad)
    plain = walk([], n_steps=n_steps)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    turned = replace(plain, markers_m={label: track @ turn for label, track in plain.markers_m.items()})
    sway = 0.2 * np.sin(turned.time_s)[:, None] * [-s, c, 0.0]
    swaying = {k: v + sway if k.startswith("pelvis") else v for k, v in turned.markers_m.items()}
    found = direction_of(replace(turned, markers_m=swaying))
    assert found is not None
    np.testing.assert_allclose(found, [c, s, 0.0], atol=2e-3)


def test_two_footprints_have_no_line_of_progression() -> None:
    assert direction_of(walk([], n_steps=2)) is None
