"""Results of a walk on a treadmill: the belts' speeds, who stated them, and the frame of the positions."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stridelab.recordings.files.c3d_writer import write_c3d
from stridelab.recordings.recording import Recording
from stridelab.schemas.cycloid import FitCycloidInput, FitCycloidSummary, FitCycloidTask
from stridelab.schemas.jobs import EstimateComInput, EstimateComSummary
from stridelab.schemas.recordings import PlateSwitch
from stridelab.schemas.tasks import EstimateComTask, RecordingSource
from stridelab.service.kinds.estimate_com import run as estimate_com
from stridelab.service.kinds.fit_cycloid import run as fit_cycloid
from stridelab.simulation.human.walker import HumanWalker
from stridelab.simulation.human_recording import record
from stridelab.simulation.noise import MeasurementNoise
from support.command_line import quiet
from support.recordings.walks import corners

BELT_M_S, MASS_KG = 1.2, 70.0


@pytest.fixture(scope="module")
def walk_on_belt() -> Recording:
    """Four seconds of walking with all force measured by one long plate, which moves with the belt's frame."""
    walker = HumanWalker(height_m=1.75, mass_kg=MASS_KG, sex="male", speed_m_s=BELT_M_S, duration_s=4.0, seed=1).walk()
    on_floor = record(walker, MeasurementNoise(force_n=2.0, moment_nm=1.0, marker_m=0.001), 1, lab="walkway").recording
    velocity_m_s = np.array([BELT_M_S, 0.0, 0.0])
    markers = {label: track - np.outer(on_floor.time_s, velocity_m_s) for label, track in on_floor.markers_m.items()}
    force = np.sum([plate.force_n for plate in on_floor.plates], axis=0)
    moment = np.sum([plate.moment_nm for plate in on_floor.plates], axis=0)
    way_m = np.outer(np.arange(len(force)) / on_floor.force_rate_hz, velocity_m_s)
    middle_m = np.nanmean(list(markers.values()), axis=(0, 1)) * [1.0, 1.0, 0.0]
    plate = replace(
        on_floor.plates[0],
        corners_m=corners(middle_m, (4.0, 2.0)),
        force_n=force,
        moment_nm=moment - np.cross(way_m, force),
    )
    return replace(on_floor, markers_m=markers, plates=(plate,), remarks=(), carried={})


@pytest.mark.parametrize("stated", [True, False])
def test_belts_and_frame_are_in_the_results(walk_on_belt: Recording, tmp_path: Path, *, stated: bool) -> None:
    write_c3d(tmp_path / "trial", walk_on_belt)
    plates = {1: PlateSwitch(belt_speed_m_s=BELT_M_S)} if stated else {}
    source = RecordingSource(file="trial", filename="belt.c3d", plates=plates)
    com_task = EstimateComTask(recording=source, input=EstimateComInput(recording_id="x"))
    com = EstimateComSummary.model_validate(estimate_com.run(com_task, tmp_path, quiet).summary)
    wheel_task = FitCycloidTask(recording=source, input=FitCycloidInput(recording_id="x"))
    wheel = FitCycloidSummary.model_validate(fit_cycloid.run(wheel_task, tmp_path, quiet).summary)
    for result, frame in ((com.treadmill, "laboratory"), (wheel.treadmill, "belt")):
        assert result is not None
        assert result.frame == frame
        assert result.source == ("stated" if stated else "feet")
        assert [result.left_m_s, result.right_m_s] == pytest.approx([BELT_M_S, BELT_M_S], abs=1e-9 if stated else 0.05)
    assert np.mean([step.speed_m_s for step in wheel.steps]) == pytest.approx(BELT_M_S, rel=0.05)
    lengths_m = [step.step_length_m for step in wheel.steps if step.step_length_m is not None]
    walked_m = [BELT_M_S * step.period_s for step in wheel.steps if step.step_length_m is not None]
    assert np.mean(lengths_m) == pytest.approx(np.mean(walked_m), rel=0.05)
