"""One simulated walk over two plates, as C3D and as TRC with MOT: the same windows and the same mass."""

from pathlib import Path

import pytest

from stridelab.body.segment_model import SegmentModel
from stridelab.recordings.body_mass import best_mass, vertical_motion, weigh
from stridelab.recordings.files.c3d_writer import write_c3d
from stridelab.recordings.force_windows import find_windows
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Recording, Window
from stridelab.simulation.human.walker import HumanWalker, Walk
from stridelab.simulation.human_recording import record
from stridelab.simulation.noise import MeasurementNoise
from support.recordings.export_files import write_trc_mot


def windows_and_mass(recording: Recording) -> tuple[tuple[Window, ...], float]:
    landmarks = identify(list(recording.markers_m)).landmarks
    com_m = SegmentModel().com(recording, landmarks, subject=recording.subject).com_m
    motion = vertical_motion(recording, landmarks, com_m)
    windows = find_windows(recording, landmarks, motion, stated_kg=recording.subject.mass_kg).windows
    best = best_mass(weigh(recording, windows, motion))
    assert best is not None
    return windows, best.mass_kg


@pytest.fixture(scope="module", params=[1, 2])
def walk(request: pytest.FixtureRequest) -> Walk:
    return HumanWalker(seed=request.param, speed_m_s=1.0 + 0.2 * request.param).walk()


def test_both_forms_have_the_same_window_and_mass(walk: Walk, tmp_path: Path) -> None:
    recording = record(walk, MeasurementNoise(), 3, lab="two_plates").recording
    write_c3d(tmp_path / "walk.c3d", recording)
    write_trc_mot(tmp_path / "walk.zip", recording)
    from_c3d, mass_c3d_kg = windows_and_mass(read_recording(tmp_path / "walk.c3d"))
    from_mot, mass_mot_kg = windows_and_mass(read_recording(tmp_path / "walk.zip"))
    assert len(from_c3d) == len(from_mot) == 1
    assert from_mot[0].start_s == pytest.approx(from_c3d[0].start_s, abs=0.011)
    assert from_mot[0].end_s == pytest.approx(from_c3d[0].end_s, abs=0.011)
    assert mass_c3d_kg == pytest.approx(60.0, rel=0.01)
    assert mass_mot_kg == pytest.approx(mass_c3d_kg, rel=0.002)
