"""Robots recorded as a person would be: markers, plates, their own segment table, truth beside."""

import numpy as np
import pytest

from stridelab.body.segment_model import SegmentModel
from stridelab.recordings.force_windows import find_windows
from stridelab.recordings.marker_sets import identify
from stridelab.robots.loader import load_robot
from stridelab.simulation.human_recording import SimulatedRecording
from stridelab.simulation.noise import NOISE_FREE, THESIS, MeasurementNoise
from stridelab.simulation.robot.anatomy import RobotAnatomy
from stridelab.simulation.robot.gait_plan import WalkerSize, gait_for
from stridelab.simulation.robot.walker import RobotWalk, simulate_walk
from stridelab.simulation.robot_recording import record_robot
from support.recordings.analytic_motions import all_measured

MOTIONS = ["robot_walk", "brisk_walk", "robot_run"]


@pytest.fixture(params=MOTIONS)
def moved(request: pytest.FixtureRequest) -> RobotWalk:
    walk: RobotWalk = request.getfixturevalue(request.param)
    return walk


def plates_sum(simulated: SimulatedRecording) -> tuple[np.ndarray, np.ndarray]:
    plates = simulated.recording.plates
    force = np.sum([plate.force_n for plate in plates], axis=0)[::10]
    return force, np.sum([plate.moment_nm for plate in plates], axis=0)[::10]


def test_the_carried_table_sees_the_true_com_in_noise_free_markers(moved: RobotWalk) -> None:
    """Nothing is left out: the lumps of links are not quite rigid, which costs under a millimetre."""
    simulated = record_robot(moved, NOISE_FREE, 0)
    recording = simulated.recording
    match = identify(list(recording.markers_m))
    assert match.name == "isb-head"
    geometric = SegmentModel("carried").com(recording, match.landmarks, subject=recording.subject)
    assert np.abs(geometric.com_m - simulated.truth.com_m).max() < 1e-3
    assert geometric.remarks == ()


@pytest.mark.parametrize("name", ["hrp2", "g1"])
def test_any_robot_is_recorded_through_its_card(name: str) -> None:
    """Legs after the arms (HRP-2), hips whose axes do not meet (G1): still below a millimetre without noise."""
    robot = load_robot(name)
    anatomy = RobotAnatomy.of_robot(robot)
    size = WalkerSize(robot.title, anatomy.size, anatomy.spacing_m)
    simulated = record_robot(simulate_walk(gait_for(0.3, 4.0, size), 0, name), NOISE_FREE, 0)
    recording = simulated.recording
    match = identify(list(recording.markers_m))
    assert match.name == "isb-head"
    geometric = SegmentModel("carried").com(recording, match.landmarks, subject=recording.subject)
    assert np.abs(geometric.com_m - simulated.truth.com_m).max() < 1e-3
    force, _ = plates_sum(simulated)
    np.testing.assert_allclose(force, simulated.truth.force_n, atol=1.0)
    assert recording.subject.mass_kg == pytest.approx(robot.mass_kg)


def test_plates_add_up_to_the_true_wrench(moved: RobotWalk) -> None:
    simulated = record_robot(moved, NOISE_FREE, 0)
    force, moment = plates_sum(simulated)
    np.testing.assert_allclose(force, simulated.truth.force_n, atol=1.0)
    np.testing.assert_allclose(moment, simulated.truth.moment_nm, atol=3.0)
    loaded = [plate for plate in simulated.recording.plates if plate.loaded.any()]
    for plate in loaded:
        on = plate.force_n[:, 2] > 50.0
        f, m = plate.force_n[on], plate.moment_nm[on]
        cop = np.column_stack([-m[:, 1], m[:, 0]]) / f[:, 2:]
        low, high = plate.corners_m[:, :2].min(axis=0), plate.corners_m[:, :2].max(axis=0)
        assert np.all((cop > low - 1e-3) & (cop < high + 1e-3)), "the pressure lies on the plate"


def test_walking_is_measured_from_end_to_end(robot_walk: RobotWalk) -> None:
    recording = record_robot(robot_walk, NOISE_FREE, 0).recording
    (window,) = find_windows(recording, identify(list(recording.markers_m)).landmarks).windows
    assert window.duration_s > 9.1


def test_two_plates_measure_a_part_of_the_walk(brisk_walk: RobotWalk) -> None:
    """All contact on two plates in a row for about a second; there the sum is the whole wrench."""
    simulated = record_robot(brisk_walk, NOISE_FREE, 0, lab="two_plates")
    recording = simulated.recording
    assert len(recording.plates) == 2
    (window,) = find_windows(recording, identify(list(recording.markers_m)).landmarks).windows
    assert 0.4 < window.duration_s < 1.3
    inside = (recording.time_s >= window.start_s) & (recording.time_s <= window.end_s)
    force, _ = plates_sum(simulated)
    np.testing.assert_allclose(force[inside], simulated.truth.force_n[inside], atol=1.0)
    assert np.abs(force - simulated.truth.force_n)[~inside].max() > 100.0


def test_feet_push_within_friction_and_carry_nothing_in_the_air(robot_run: RobotWalk) -> None:
    recording = record_robot(robot_run, NOISE_FREE, 0).recording
    total = np.sum([plate.force_n[:, 2] for plate in recording.plates], axis=0)
    assert (total < 1.0).mean() > 0.2
    for plate in recording.plates:
        assert plate.force_n[:, 2].min() > -5.0
        on = plate.force_n[:, 2] > 100.0
        assert np.all(np.linalg.norm(plate.force_n[on, :2], axis=1) < 0.6 * plate.force_n[on, 2])


def test_same_seed_same_recording(robot_walk: RobotWalk) -> None:
    first, again, other = (record_robot(robot_walk, THESIS, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(all_measured(first), all_measured(again))
    assert first.recording.carried == again.recording.carried
    assert first.recording.carried != other.recording.carried
    assert np.abs(all_measured(first) - all_measured(other)).max() > 1e-3


def test_latency_makes_the_force_late(robot_walk: RobotWalk) -> None:
    on_time = plates_sum(record_robot(robot_walk, NOISE_FREE, 0))[0]
    noise = MeasurementNoise(0.0, 0.0, 0.0, 0.0, 0.0, latency_s=0.02)
    late = plates_sum(record_robot(robot_walk, noise, 0))[0]
    np.testing.assert_allclose(late[2:], on_time[:-2], atol=1e-6)


def test_the_recording_knows_the_robots_mass_and_no_sex(robot_walk: RobotWalk) -> None:
    recording = record_robot(robot_walk, NOISE_FREE, 0).recording
    assert recording.subject.mass_kg == pytest.approx(90.27, abs=0.01)
    assert recording.subject.sex is None
    assert sum(event.kind == "foot_strike" for event in recording.events) == 9
