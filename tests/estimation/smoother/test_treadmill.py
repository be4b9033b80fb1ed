"""A walk on a treadmill is a walk: the belt under the feet shows it, and the estimate is that of the floor."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stridelab.body.segment_model import SegmentModel
from stridelab.estimation.estimator import ComEstimate
from stridelab.estimation.smoother import Smoother
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.plate_contacts import wrench_track
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Recording, Remark, Window
from stridelab.simulation.human.walker import HumanWalker
from stridelab.simulation.human_recording import record
from stridelab.simulation.noise import MeasurementNoise
from support.recordings.export_files import write_trc_mot
from support.recordings.walks import STEP_M, STEP_S, corners, walk

MASS_KG = 70.0


def from_moving_frame(recording: Recording, velocity_m_s: np.ndarray, remarks: tuple[Remark, ...] = ()) -> Recording:
    """The recording as seen from a frame that moves with ``velocity_m_s``; one long plate under everything."""
    markers = {label: track - np.outer(recording.time_s, velocity_m_s) for label, track in recording.markers_m.items()}
    plates = []
    for plate in recording.plates:
        way_m = np.outer(np.arange(len(plate.force_n)) / recording.force_rate_hz, velocity_m_s)
        moment = plate.moment_nm - np.cross(way_m, plate.force_n)
        plates.append(replace(plate, corners_m=corners((0.0, 0.0, 0.0), (4.0, 2.0)), moment_nm=moment))
    return replace(recording, markers_m=markers, plates=tuple(plates), remarks=remarks)


@pytest.mark.parametrize("drift_m_s", [0.0, 0.2, -0.2])
def test_a_treadmill_is_recognised_though_the_body_drifts(tmp_path: Path, drift_m_s: float) -> None:
    """The body moves 0.6 m in 3 s, more than the 0.4 m that count as walking over the floor; the belt is faster."""
    belt_m_s = STEP_M / STEP_S - drift_m_s
    seen = from_moving_frame(walk(range(8)), np.array([belt_m_s, 0.0, 0.0]))
    result = read_recording(write_trc_mot(tmp_path / "walk.zip", seen))
    (message,) = [remark.message for remark in result.remarks if remark.code == "treadmill"]
    assert f"{belt_m_s:.2f} m/s" in message
    assert result.walking_direction == pytest.approx([1.0, 0.0, 0.0], abs=0.02)


def test_a_walk_over_the_floor_is_not_on_a_treadmill(tmp_path: Path) -> None:
    result = read_recording(write_trc_mot(tmp_path / "walk.zip", walk(range(8))))
    assert "treadmill" not in {remark.code for remark in result.remarks}


def estimated(recording: Recording) -> ComEstimate:
    landmarks = identify(list(recording.markers_m)).landmarks
    geometric = SegmentModel().com(recording, landmarks, subject=recording.subject)
    return Smoother().estimate(geometric, wrench_track(recording, (Window(0.9, 2.1),)), MASS_KG)


def test_the_same_walk_on_a_treadmill_has_the_same_centre_of_mass() -> None:
    walker = HumanWalker(height_m=1.75, mass_kg=MASS_KG, sex="male", speed_m_s=1.2, duration_s=3.0, seed=1).walk()
    noise = MeasurementNoise(force_n=3.0, moment_nm=2.0, marker_m=0.001, mass_model=0.1)
    on_floor = record(walker, noise, 1, lab="walkway").recording
    velocity_m_s = np.array([1.2, 0.0, 0.0])
    on_belt = from_moving_frame(on_floor, velocity_m_s, (Remark("treadmill", "A belt."),))
    floor, belt = estimated(on_floor), estimated(on_belt)
    assert belt.diagnostics["speed_m_s"] == pytest.approx(floor.diagnostics["speed_m_s"], abs=0.05)
    assert belt.diagnostics["step_hz"] == pytest.approx(floor.diagnostics["step_hz"], rel=0.02)
    back = belt.com_m + np.outer(belt.time_s, velocity_m_s)
    assert np.abs(back - floor.com_m).max() < 0.002
