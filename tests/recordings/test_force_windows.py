"""Windows of a schematic walk whose contacts are known exactly."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.errors import NotEstimable
from stridelab.recordings.body_mass import best_mass, weigh
from stridelab.recordings.force_windows import find_windows, measured_windows, require_windows
from stridelab.recordings.plate_contacts import centre_of_pressure_m
from stridelab.recordings.recording import Recording, Remark, Window
from support.recordings.walks import LANDMARKS, STANCE_S, STEP_S, WEIGHT_N, corners, walk

TOLERANCE_S = 0.03


def lift_s(k: int) -> float:
    return STEP_S * k - 0.3 + STANCE_S


def strike_s(k: int) -> float:
    return STEP_S * k - 0.3


def mass_kg(recording: Recording, windows: tuple[Window, ...]) -> float | None:
    best = best_mass(weigh(recording, windows))
    return None if best is None else best.mass_kg


def check(recording: Recording, expected: list[tuple[float, float]]) -> None:
    windows = measured_windows(recording, LANDMARKS)
    assert len(windows) == len(expected)
    for window, (start_s, end_s) in zip(windows, expected, strict=True):
        assert start_s - 0.011 <= window.start_s <= start_s + TOLERANCE_S
        assert end_s - TOLERANCE_S <= window.end_s <= end_s + 0.011


def test_two_plates_measure_from_the_lift_before_to_the_strike_after() -> None:
    check(walk([2, 3]), [(lift_s(1), strike_s(4))])


def test_events_are_not_needed_and_there_are_two_windows() -> None:
    check(walk([1, 2, 5, 6], n_steps=9), [(lift_s(0), strike_s(3)), (lift_s(4), strike_s(7))])


def test_a_foot_beside_the_plates_leaves_one_single_support() -> None:
    check(walk([3]), [(lift_s(2), strike_s(4))])


def test_a_foot_half_off_its_plate_ends_the_window() -> None:
    """The second plate is shifted so that the forefoot lands behind its edge."""
    recording = walk([2, 3])
    second = recording.plates[1]
    moved = replace(second, corners_m=second.corners_m - [0.36, 0.0, 0.0])
    check(replace(recording, plates=(recording.plates[0], moved)), [(lift_s(1), strike_s(3))])


def test_a_dead_plate_measures_nothing() -> None:
    recording = walk([2, 3])
    dead = replace(recording.plates[1], force_n=0 * recording.plates[1].force_n)
    check(replace(recording, plates=(recording.plates[0], dead)), [(lift_s(1), strike_s(3))])


def test_a_plate_that_is_switched_off_counts_as_floor() -> None:
    recording = walk([2, 3])
    off = replace(recording.plates[1], use=False)
    check(replace(recording, plates=(recording.plates[0], off)), [(lift_s(1), strike_s(3))])


def test_an_unseen_foot_is_not_assumed_to_be_in_the_air() -> None:
    recording = walk([2, 3])
    markers = dict(recording.markers_m)
    for name in ("r_heel", "r_mt1", "r_mt5"):
        track = markers[name].copy()
        track[recording.time_s > 1.5] = np.nan
        markers[name] = track
    (window,) = measured_windows(replace(recording, markers_m=markers), LANDMARKS)
    assert window.end_s <= 1.5


def test_a_hidden_forefoot_beside_the_plates_is_not_assumed_to_be_in_the_air() -> None:
    """The heel rises first: without the forefoot the lift-off cannot be seen."""
    recording = walk([2, 3])
    markers = dict(recording.markers_m)
    for name in ("r_mt1", "r_mt5"):
        track = markers[name].copy()
        track[recording.time_s < 1.0] = np.nan
        markers[name] = track
    (window,) = measured_windows(replace(recording, markers_m=markers), LANDMARKS)
    assert window.start_s >= 0.99


def test_marker_noise_of_a_millimetre_changes_little() -> None:
    recording = walk([2, 3], rate_hz=200.0)
    rng = np.random.default_rng(0)
    noisy = {label: track + rng.normal(0.0, 0.001, track.shape) for label, track in recording.markers_m.items()}
    check(replace(recording, markers_m=noisy), [(lift_s(1), strike_s(4))])


def test_without_foot_markers_the_load_and_symmetry_decide() -> None:
    recording = walk([2, 3])
    search = find_windows(recording, {})
    assert [remark.code for remark in search.remarks] == ["windows-from-load"]
    (window,) = search.windows
    assert lift_s(1) <= window.start_s <= lift_s(1) + 0.05
    assert strike_s(4) - 0.05 <= window.end_s <= strike_s(4)


def test_without_foot_markers_one_contact_gives_no_window() -> None:
    assert measured_windows(walk([3]), {}) == ()


def test_one_single_support_is_flagged() -> None:
    assert [remark.code for remark in find_windows(walk([3]), LANDMARKS).remarks] == ["no-whole-step"]


def test_two_feet_on_one_long_plate() -> None:
    recording = walk([2, 3])
    a, b = recording.plates
    force, moment = a.force_n + b.force_n, a.moment_nm + b.moment_nm
    long = replace(a, corners_m=corners((1.5 + 0.09, 0.0, 0.0), (1.18, 0.5)), force_n=force, moment_nm=moment)
    recording = replace(recording, plates=(long,))
    check(recording, [(lift_s(1), strike_s(4))])
    assert "two-feet-on-one-plate" in {remark.code for remark in find_windows(recording, LANDMARKS).remarks}


def test_standing_on_a_plate_is_one_window() -> None:
    t = np.arange(300) / 100.0
    markers = {label: np.tile([0.1, 0.1 if label[0] == "l" else -0.1, 0.04], (300, 1)) for label in LANDMARKS}
    markers |= {"pelvis": np.tile([0.0, 0.0, 1.0], (300, 1))}
    base = walk([2]).plates[0]
    force = np.tile([0.0, 0.0, WEIGHT_N], (3000, 1))
    plate = replace(base, corners_m=corners((0.1, 0, 0)), force_n=force, moment_nm=np.cross([0.1, 0, 0], force))
    recording = Recording(markers, 100.0, 1000.0, (plate,), walk([2]).subject, (), "+z", None)
    (window,) = measured_windows(recording, LANDMARKS)
    assert (window.start_s, window.end_s) == (0.0, pytest.approx(t[-1]))
    assert mass_kg(recording, (window,)) == pytest.approx(WEIGHT_N / 9.81)
    assert find_windows(recording, LANDMARKS).remarks == ()


def on_a_belt(recording: Recording) -> Recording:
    """The same walk seen from a frame that moves with the body: a treadmill with one long plate."""
    shift = np.outer(recording.time_s * 1.2, [1.0, 0.0, 0.0])
    markers = {label: track - shift for label, track in recording.markers_m.items()}
    plates = []
    for plate in recording.plates:
        force_time_s = np.arange(len(plate.force_n)) / recording.force_rate_hz
        moved = plate.moment_nm - np.cross(np.outer(force_time_s * 1.2, [1.0, 0.0, 0.0]), plate.force_n)
        plates.append(replace(plate, corners_m=corners((0.0, 0.0, 0.0), (2.0, 1.0)), moment_nm=moved))
    return replace(recording, markers_m=markers, plates=tuple(plates), remarks=(Remark("treadmill", ""),))


def test_on_a_treadmill_the_whole_recording_is_measured() -> None:
    recording = on_a_belt(walk(range(8)))
    (window,) = measured_windows(recording, LANDMARKS)
    assert window.start_s == 0.0
    assert window.end_s == pytest.approx(recording.duration_s, abs=0.02)


def test_a_short_gap_of_one_foot_marker_does_not_end_the_window() -> None:
    """The left heel is hidden for 0.18 s in the middle of a swing, when the foot is over no plate."""
    recording = on_a_belt(walk(range(8)))
    middle = round((lift_s(2) + 0.2) * recording.marker_rate_hz)
    heel = recording.markers_m["l_heel"].copy()
    heel[middle - 9 : middle + 9] = np.nan
    (window,) = measured_windows(replace(recording, markers_m={**recording.markers_m, "l_heel": heel}), LANDMARKS)
    assert window.end_s - window.start_s == pytest.approx(recording.duration_s, abs=0.03)


def test_mass_over_whole_steps() -> None:
    recording = walk([2, 3])
    windows = (Window(lift_s(1), strike_s(4)),)
    assert mass_kg(recording, windows) == pytest.approx(WEIGHT_N / 9.81, rel=2e-3)
    assert mass_kg(walk([3]), (Window(lift_s(2), strike_s(4)),)) is None
    assert mass_kg(replace(recording, plates=()), windows) is None


def test_mass_needs_whole_steps_not_whole_windows() -> None:
    """A force that rises over the step would be over-weighted by its part of a step at the window's end."""
    recording = walk([2, 3])
    phase = np.arange(len(recording.plates[0].force_n)) / 1000.0 / STEP_S * 2 * np.pi
    swing = (1.0 + 0.3 * np.sin(phase))[:, None]
    plates = tuple(replace(plate, force_n=plate.force_n * swing) for plate in recording.plates)
    estimated_kg = mass_kg(replace(recording, plates=plates), (Window(lift_s(1), strike_s(4)),))
    assert estimated_kg == pytest.approx(WEIGHT_N / 9.81, rel=0.02)


def test_centre_of_pressure_is_masked_while_unloaded() -> None:
    plate = walk([2]).plates[0]
    cop = centre_of_pressure_m(plate)
    assert np.isnan(cop[~plate.loaded]).all()
    np.testing.assert_allclose(cop[plate.loaded], np.tile([1.29, 0.1, 0.0], (int(plate.loaded.sum()), 1)), atol=1e-9)


def refused(recording: Recording) -> str:
    with pytest.raises(NotEstimable) as error:
        require_windows(recording, LANDMARKS)
    return error.value.code


def test_refusals_give_their_reason() -> None:
    recording = walk([2, 3])
    one = {label: track[:1] for label, track in recording.markers_m.items()}
    few = {label: track[:10] for label, track in recording.markers_m.items()}
    switched = tuple(replace(plate, use=False) for plate in recording.plates)
    empty = tuple(replace(plate, force_n=0 * plate.force_n) for plate in recording.plates)
    elsewhere = tuple(replace(plate, corners_m=plate.corners_m + np.array([0, 5.0, 0])) for plate in recording.plates)
    assert refused(replace(recording, markers_m=one)) == "single-frame"
    assert refused(replace(recording, markers_m=few)) == "recording-too-short"
    assert refused(replace(recording, plates=())) == "no-plates"
    with pytest.raises(NotEstimable, match="The method geometry gives the centre of mass from the markers alone"):
        require_windows(replace(recording, plates=()), LANDMARKS)
    assert refused(replace(recording, plates=switched)) == "plates-switched-off"
    assert refused(replace(recording, plates=empty)) == "plates-unloaded"
    assert refused(replace(recording, plates=elsewhere)) == "no-measured-window"


def test_markers_that_are_visible_only_while_the_plates_are_empty_are_refused() -> None:
    recording = walk([2, 3])
    late = {label: track.copy() for label, track in recording.markers_m.items()}
    for track in late.values():
        track[: int(2.2 * recording.marker_rate_hz)] = np.nan
    with pytest.raises(NotEstimable) as error:
        require_windows(replace(recording, markers_m=late), LANDMARKS)
    assert error.value.code == "forces-and-markers-apart"
    assert "2.20 to" in error.value.message
    assert [fault.where for fault in error.value.faults] == ["plates", "markers"]
