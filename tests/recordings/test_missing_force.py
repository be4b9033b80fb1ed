"""Detection of force that acts beside the plates, on bodies whose force is known."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.errors import NotEstimable
from stridelab.recordings.body_mass import VerticalMotion, vertical_motion
from stridelab.recordings.files.raw import CONTACT_TYPE
from stridelab.recordings.foot_contact import find_feet, foot_outline
from stridelab.recordings.force_windows import find_windows, measured_windows, require_windows
from stridelab.recordings.recording import Recording, Subject, Window
from support.recordings.walks import (
    DROP_S,
    LANDMARKS,
    MASS_KG,
    STANCE_S,
    STEP_S,
    MovingBody,
    drop_jump,
    moving_body,
    sit_to_stand,
    smooth_step,
    stand,
    walk,
)

LANDED_2_S, LIFTED_1_S, LANDED_3_S, LANDED_4_S = (
    2 * STEP_S - 0.3,
    STEP_S - 0.3 + STANCE_S,
    3 * STEP_S - 0.3,
    4 * STEP_S - 0.3,
)


def motion(body: MovingBody) -> VerticalMotion:
    vertical = vertical_motion(body.recording, LANDMARKS, body.com_m)
    assert vertical is not None
    return vertical


def shifted_second_plate(shift_m: tuple[float, float, float]) -> Recording:
    recording = walk([2, 3])
    first, second = recording.plates
    return replace(recording, plates=(first, replace(second, corners_m=second.corners_m + np.array(shift_m))))


# -- the outline of the foot


def test_the_outline_has_the_length_of_a_foot() -> None:
    """The markers are 16.6 cm apart from heel to the middle of the metatarsal heads: a foot of 24.4 cm."""
    recording = walk([2, 3])
    foot = find_feet(recording, LANDMARKS)[0]
    points = foot_outline(recording, LANDMARKS, foot)[0]
    heel = foot.markers_m[0, 0]
    length_m = float(np.linalg.norm(points[4, :2] - heel[:2]))
    assert length_m == pytest.approx(0.165 / 0.68, abs=0.002)
    assert np.linalg.norm(points[2] - points[3]) == pytest.approx(0.36 * length_m, abs=0.002)
    assert np.linalg.norm(points[0] - points[1]) == pytest.approx(0.24 * length_m, abs=0.002)


def test_a_toe_marker_and_stature_bound_the_length() -> None:
    recording = walk([2, 3])
    landmarks = {"l_heel": "l_heel", "l_mt2": "l_mt1", "r_heel": "r_heel", "r_mt2": "r_mt1"}
    foot = find_feet(recording, landmarks)[0]
    free = foot_outline(recording, landmarks, foot)[0, 4, 0]
    child = replace(recording, subject=Subject(height_m=1.2))
    assert free - foot_outline(child, landmarks, foot)[0, 4, 0] == pytest.approx(0.184 / 0.72 - 0.175 * 1.2, abs=0.005)
    at_toe = {"l_heel": "l_heel", "l_toe": "l_mt1", "r_heel": "r_heel", "r_toe": "r_mt1"}
    tip = foot_outline(recording, at_toe, foot)[0, 4, 0]
    assert 0.0 < tip - recording.markers_m["l_mt1"][0, 0] < 0.01


def test_toes_over_the_edge_end_the_window_though_all_markers_lie_on_the_plate() -> None:
    """The edge is 21 cm in front of the heel marker: 3 cm in front of the last marker, 3 cm behind the toes."""
    (window,) = measured_windows(shifted_second_plate((-0.17, 0.0, 0.0)), LANDMARKS)
    assert window.start_s == pytest.approx(LIFTED_1_S, abs=0.04)
    assert window.end_s == pytest.approx(LANDED_3_S, abs=0.03)


def test_the_side_of_a_foot_over_the_edge_ends_the_window() -> None:
    """A marker on the midline would not tell; here the fifth metatarsal head is 2 cm outside, the skin 2.4 cm."""
    (window,) = measured_windows(shifted_second_plate((0.0, 0.13, 0.0)), LANDMARKS)
    assert window.end_s == pytest.approx(LANDED_3_S, abs=0.03)


def test_a_centimetre_of_toes_over_the_edge_is_within_the_error_of_the_outline() -> None:
    (window,) = measured_windows(shifted_second_plate((-0.15, 0.0, 0.0)), LANDMARKS)
    assert window.end_s == pytest.approx(LANDED_4_S, abs=0.03)


# -- what the motion needs


def test_sitting_on_a_chair_beside_the_plate_is_not_measured() -> None:
    body = sit_to_stand()
    search = find_windows(body.recording, LANDMARKS, motion(body))
    (window,) = search.windows
    assert 1.6 < window.start_s < 1.95, "the chair has been left at 1.9 s"
    assert window.end_s == pytest.approx(body.recording.time_s[-1])
    inside = (body.recording.time_s >= window.start_s) & (body.recording.time_s <= window.end_s)
    assert body.beside[inside].max() < 0.2
    (remark,) = search.remarks
    assert remark.code == "force-missing"
    assert "0.00 to" in remark.message


def test_without_a_chair_the_same_movement_is_measured_from_end_to_end() -> None:
    body = moving_body(lambda t: 0.62 + 0.35 * smooth_step(t, 1.4, 2.8), np.zeros_like, duration_s=4.5)
    search = find_windows(body.recording, LANDMARKS, motion(body))
    assert search.remarks == ()
    assert search.windows == (Window(0.0, float(body.recording.time_s[-1])),)


def test_a_rail_that_carries_a_third_of_the_weight_is_detected() -> None:
    body = moving_body(
        lambda t: 0.95 + 0 * t, lambda t: 0.33 * smooth_step(t, 1.0, 1.3) * (1 - smooth_step(t, 2, 2.3)), 4.0
    )
    first, second = find_windows(body.recording, LANDMARKS, motion(body)).windows
    assert 1.0 < first.end_s < 1.2
    assert 2.1 < second.start_s < 2.3


@pytest.mark.parametrize("latency_s", [-0.01, 0.0, 0.02, 0.03])
def test_a_late_force_is_not_a_missing_force(latency_s: float) -> None:
    """A walk at 2 steps per second with 3 cm of vertical movement, and a force that comes late."""
    body = moving_body(lambda t: 0.95 + 0.03 * np.sin(4.0 * np.pi * t), np.zeros_like, duration_s=3.0)
    plate = body.recording.plates[0]
    shift = round(latency_s * body.recording.force_rate_hz)
    late = replace(plate, force_n=np.roll(plate.force_n, shift, axis=0))
    recording = replace(body.recording, plates=(late,))
    assert find_windows(recording, LANDMARKS, motion(body)).remarks == ()


def test_free_fall_needs_no_force() -> None:
    """From the box the jumper falls, which is measured: no force, and none is missing."""
    body = drop_jump()
    search = find_windows(body.recording, LANDMARKS, motion(body))
    (window,) = search.windows
    assert DROP_S <= window.start_s < DROP_S + 0.15
    assert window.end_s == pytest.approx(body.recording.time_s[-1])
    assert "force-missing" not in {remark.code for remark in search.remarks}


def test_hanging_above_the_plate_is_no_flight() -> None:
    """The same feet in the air, and a body that does not fall: something carries it."""
    body = drop_jump()
    hanging = np.full_like(body.com_m, 1.2)
    search = find_windows(body.recording, LANDMARKS, vertical_motion(body.recording, LANDMARKS, hanging))
    assert all(window.start_s > DROP_S + 0.2 for window in search.windows)
    assert "force-missing" in {remark.code for remark in search.remarks}


def test_an_overstated_mass_is_not_taken_for_a_chair() -> None:
    """Standing still on a plate with a steady force gives the mass: a wrong stated mass must not end the window."""
    body = stand()
    search = find_windows(body.recording, LANDMARKS, motion(body), stated_kg=1.3 * MASS_KG)
    assert search.remarks == ()
    assert len(search.windows) == 1


def test_a_refusal_names_the_interval_of_missing_force() -> None:
    body = moving_body(lambda t: 0.95 + 0 * t, lambda t: 0.3 + 0.4 * (t % 0.4 < 0.2), duration_s=2.0)
    with pytest.raises(NotEstimable) as refusal:
        require_windows(body.recording, LANDMARKS, motion(body), stated_kg=MASS_KG)
    assert refusal.value.code == "no-measured-window"
    assert "carry less than the motion of the body needs" in refusal.value.message


def test_the_pelvis_stands_in_for_the_centre_of_mass() -> None:
    """Where the segments cannot be placed, a chair that carries nine tenths is still detected."""
    body = sit_to_stand()
    landmarks = {**LANDMARKS, "sacrum": "pelvis"}
    by_pelvis = vertical_motion(body.recording, landmarks)
    assert by_pelvis is not None
    assert by_pelvis.from_pelvis
    (window,) = find_windows(body.recording, landmarks, by_pelvis).windows
    assert 1.5 < window.start_s < 2.0


# -- the contacts of a force file


def test_a_centre_of_pressure_that_drifts_at_small_loads_makes_no_holes() -> None:
    """Laboratories filter the centre of pressure of a MOT file together with the zeros of the unloaded plate."""
    recording = walk([2, 3])
    contacts = []
    for plate in recording.plates:
        share = np.clip(plate.force_n[:, 2] / 300.0, 0.0, 1.0)[:, None]
        contacts.append(replace(plate, type=CONTACT_TYPE, moment_nm=plate.moment_nm * share))
    as_mot = replace(recording, plates=tuple(contacts))
    (expected,) = measured_windows(recording, LANDMARKS)
    (window,) = measured_windows(as_mot, LANDMARKS)
    assert window == expected


def test_a_contact_under_the_other_foot_is_not_under_this_one() -> None:
    """The centre of pressure of the third stance lies under a foot 60 cm ahead of the second."""
    recording = walk([3])
    (plate,) = recording.plates
    (expected,) = measured_windows(recording, LANDMARKS)
    (window,) = measured_windows(replace(recording, plates=(replace(plate, type=CONTACT_TYPE),)), LANDMARKS)
    assert window == expected
    assert window.start_s > LANDED_2_S
