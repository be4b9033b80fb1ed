"""The recording against the truth: noise-free exact, noisy as stated, and through files and the whole pipeline."""

from pathlib import Path

import numpy as np
import pytest

from stridelab.body import segment_tables
from stridelab.body.segment_model import SegmentModel
from stridelab.errors import InvalidInput
from stridelab.recordings.body_mass import best_mass, weigh
from stridelab.recordings.files.c3d_writer import write_c3d
from stridelab.recordings.force_windows import measured_windows
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.plate_contacts import wrench_track
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Recording
from stridelab.simulation.human.walker import Walk
from stridelab.simulation.human_recording import record
from stridelab.simulation.noise import NOISE_FREE, THESIS, MeasurementNoise
from support.recordings.analytic_motions import all_measured


def total(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    return (
        np.sum([plate.force_n for plate in recording.plates], axis=0),
        np.sum([plate.moment_nm for plate in recording.plates], axis=0),
    )


@pytest.mark.parametrize("walk_name", ["steady_walk", "man_from_rest", "quiet_standing"])
def test_carried_table_finds_the_true_centre_of_mass(walk_name: str, request: pytest.FixtureRequest) -> None:
    """Two implementations of the Dumas frames, one in links and one from landmarks, agree."""
    simulated = record(request.getfixturevalue(walk_name), NOISE_FREE, 0)
    recording = simulated.recording
    match = identify(list(recording.markers_m))
    assert match.name == "isb-head"
    assert match.missing == ()
    result = SegmentModel("carried").com(recording, match.landmarks, subject=recording.subject)
    np.testing.assert_allclose(result.com_m, simulated.truth.com_m, atol=1e-9)


@pytest.mark.parametrize("walk_name", ["steady_walk", "man_from_rest", "quiet_standing"])
def test_walkway_measures_all_contact(walk_name: str, request: pytest.FixtureRequest) -> None:
    walk: Walk = request.getfixturevalue(walk_name)
    force, moment = total(record(walk, NOISE_FREE, 0).recording)
    at = np.searchsorted(walk.truth.time_s, -1e-9) + np.arange(len(force))
    np.testing.assert_allclose(force, walk.force_n[at], atol=1e-6)
    np.testing.assert_allclose(moment, walk.moment_nm[at], atol=1e-6)


def test_every_footprint_of_the_walkway_has_its_own_plate(steady_walk: Walk) -> None:
    recording = record(steady_walk, NOISE_FREE, 0).recording
    stances = sum(
        s.off_s - steady_walk.plan.record_from_s > -1 and s.strike_s - steady_walk.plan.record_from_s < 6.0
        for s in steady_walk.plan.stances
    )
    loaded = [plate for plate in recording.plates if plate.loaded.any()]
    assert len(loaded) in (stances, stances - 1, stances - 2)
    for plate in loaded:
        edges = np.diff(plate.loaded.astype(int))
        assert np.count_nonzero(edges) <= 2, "one contact per plate"


def test_window_wrench_and_mass_are_those_of_the_simulation(steady_walk: Walk) -> None:
    simulated = record(steady_walk, MeasurementNoise(), 3)
    recording = simulated.recording
    landmarks = identify(list(recording.markers_m)).landmarks
    windows = measured_windows(recording, landmarks)
    assert sum(window.duration_s for window in windows) > 0.9 * recording.duration_s
    wrench = wrench_track(recording, windows)
    error = (wrench.force_n - simulated.truth.force_n)[wrench.complete]
    assert np.all(error.std(axis=0) < 3.0)
    best = best_mass(weigh(recording, windows))
    assert best is not None
    assert best.mass_kg == pytest.approx(60.0, rel=0.005)


def test_two_plates_measure_about_one_second(steady_walk: Walk) -> None:
    simulated = record(steady_walk, MeasurementNoise(), 3, lab="two_plates")
    recording = simulated.recording
    assert len(recording.plates) == 2
    landmarks = identify(list(recording.markers_m)).landmarks
    windows = measured_windows(recording, landmarks)
    assert len(windows) == 1
    assert 0.6 < windows[0].duration_s < 1.4
    wrench = wrench_track(recording, windows)
    error = (wrench.force_n - simulated.truth.force_n)[wrench.complete]
    assert np.abs(error).max() < 15.0, "inside the window nothing is missing"
    best = best_mass(weigh(recording, windows))
    assert best is not None
    assert best.mass_kg == pytest.approx(60.0, rel=0.03)


def test_recording_survives_the_file(steady_walk: Walk, tmp_path: Path) -> None:
    simulated = record(steady_walk, MeasurementNoise(), 3)
    path = tmp_path / "walk.c3d"
    write_c3d(path, simulated.recording)
    back = read_recording(path)
    assert back.markers_m.keys() == simulated.recording.markers_m.keys()
    for label, track in simulated.recording.markers_m.items():
        np.testing.assert_allclose(back.markers_m[label], track, atol=1e-6)
    force, moment = total(simulated.recording)
    force_back, moment_back = total(back)
    np.testing.assert_allclose(force_back, force, atol=0.2)
    np.testing.assert_allclose(moment_back, moment, atol=2.0)
    assert back.subject == simulated.recording.subject
    assert segment_tables.from_json(back.carried["segment_table"]) == segment_tables.from_json(
        simulated.recording.carried["segment_table"]
    )
    assert len(back.events) == len(simulated.recording.events)
    result = SegmentModel().com(back, identify(list(back.markers_m)).landmarks, subject=back.subject)
    assert np.abs(result.com_m - simulated.truth.com_m).max() < 2e-3


def test_noise_is_as_large_as_stated(steady_walk: Walk) -> None:
    clean = record(steady_walk, NOISE_FREE, 5).recording
    noisy = record(steady_walk, MeasurementNoise(force_n=7.0, moment_nm=3.0, marker_m=0.002), 5).recording
    for plate, reference in zip(noisy.plates, clean.plates, strict=True):
        force = plate.force_n - reference.force_n
        middle = plate.corners_m.mean(axis=0)
        moment = plate.moment_nm - reference.moment_nm - np.cross(middle, force)
        np.testing.assert_allclose(force.std(axis=0), 7.0, rtol=1e-6)
        np.testing.assert_allclose(moment.std(axis=0), 3.0, rtol=1e-6)
        spectrum = np.abs(np.fft.rfft(force[:, 0])) ** 2
        slow = np.fft.rfftfreq(len(force), 1e-3) < 2.0
        assert spectrum[slow].sum() < 0.01 * spectrum.sum(), "high frequencies only"
    skin = np.concatenate([noisy.markers_m[label] - clean.markers_m[label] for label in clean.markers_m])
    assert skin.std() == pytest.approx(0.002, rel=0.02)


def test_moving_skin_repeats_with_the_stride_and_moves_the_thigh_most(steady_walk: Walk) -> None:
    strikes = sorted(s.strike_s - steady_walk.plan.record_from_s for s in steady_walk.plan.stances if s.side == "left")
    sizes: dict[str, list[float]] = {"L_FLE": [], "L_FAL": [], "L_FCC": []}
    for seed in range(20):
        still = record(steady_walk, NOISE_FREE, seed).recording
        moving = record(steady_walk, NOISE_FREE, seed, skin_moves=True).recording
        for one, other in zip(still.plates, moving.plates, strict=True):
            np.testing.assert_array_equal(one.force_n, other.force_n)
        for label, size in sizes.items():
            moved_m = moving.markers_m[label] - still.markers_m[label]
            size.append(float(np.linalg.norm(moved_m, axis=1).max()))
            inside = [s for s in strikes if 0.0 < s < still.time_s[-1]]
            at_strikes = [[np.interp(s, still.time_s, moved_m[:, axis]) for axis in range(3)] for s in inside]
            assert np.ptp(at_strikes, axis=0).max() < 0.1 * np.ptp(moved_m, axis=0).max()
    thigh, shank, foot = (float(np.median(size)) for size in sizes.values())
    assert 0.010 < shank < thigh < 0.030, "bone pins and fluoroscopy: 15 to 27 mm"
    assert foot < 0.005


def test_same_seed_same_recording(steady_walk: Walk) -> None:
    noise = MeasurementNoise(configuration_rad=0.01, mass_model=0.1, latency_s=0.01)
    first, again, other = (record(steady_walk, noise, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(all_measured(first), all_measured(again))
    assert first.recording.carried == again.recording.carried
    assert first.recording.carried != other.recording.carried
    assert np.abs(all_measured(first) - all_measured(other)).max() > 1e-3


def test_latency_makes_the_force_late(steady_walk: Walk) -> None:
    on_time, _ = total(record(steady_walk, NOISE_FREE, 0).recording)
    late, _ = total(record(steady_walk, MeasurementNoise(0.0, 0.0, 0.0, 0.0, 0.0, latency_s=0.018), 0).recording)
    np.testing.assert_allclose(late[18:], on_time[:-18], atol=1e-6)


def test_configuration_noise_reaches_the_markers_above_5_hz(steady_walk: Walk) -> None:
    clean = record(steady_walk, NOISE_FREE, 0).recording
    shaken = record(steady_walk, MeasurementNoise(0.0, 0.0, configuration_rad=0.01, marker_m=0.0), 0).recording
    wrist = shaken.markers_m["L_RSP"] - clean.markers_m["L_RSP"]
    assert 1e-3 < wrist.std() < 2e-2
    np.testing.assert_allclose(shaken.markers_m["L_IAS"], clean.markers_m["L_IAS"], atol=1e-12)
    spectrum = np.abs(np.fft.rfft(wrist[:, 0])) ** 2
    slow = np.fft.rfftfreq(len(wrist), 0.01) < 2.0
    assert spectrum[slow].sum() < 0.02 * spectrum.sum()


def test_wrong_masses_shift_the_geometric_centre_of_mass(steady_walk: Walk) -> None:
    simulated = record(steady_walk, MeasurementNoise(0.0, 0.0, 0.0, 0.0, mass_model=0.2), 4)
    recording = simulated.recording
    landmarks = identify(list(recording.markers_m)).landmarks
    result = SegmentModel("carried").com(recording, landmarks, subject=recording.subject)
    bias = (result.com_m - simulated.truth.com_m).mean(axis=0)
    varying = (result.com_m - simulated.truth.com_m).std(axis=0)
    assert 1e-3 < np.linalg.norm(bias) < 0.1
    assert np.all(varying < 0.01)


def test_truth_is_at_the_marker_instants(steady_walk: Walk) -> None:
    simulated = record(steady_walk, THESIS, 0)
    np.testing.assert_array_equal(simulated.truth.time_s, simulated.recording.time_s)
    at = np.searchsorted(steady_walk.truth.time_s, simulated.truth.time_s - 1e-9)
    np.testing.assert_allclose(simulated.truth.com_m, steady_walk.truth.com_m[at], atol=1e-9)
    np.testing.assert_allclose(simulated.truth.force_n, steady_walk.truth.force_n[at], atol=1e-6)


def test_noise_outside_the_contract_is_refused() -> None:
    with pytest.raises(InvalidInput, match="latency_s"):
        MeasurementNoise(latency_s=0.2)
    with pytest.raises(InvalidInput, match="force_n"):
        MeasurementNoise(force_n=-1.0)
