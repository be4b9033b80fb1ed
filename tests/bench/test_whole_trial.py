"""A whole recording of 2 s, from the C3D to the numbers of the report; run by ``make bench`` (skipped otherwise)."""

from pathlib import Path

import pytest

from stridelab.body.segment_model import SegmentModel
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.estimation.estimator import ComEstimator
from stridelab.estimation.evaluation.physics_residuals import bias_m, force_residual_n
from stridelab.estimation.kalman.filter import RtsSmoother
from stridelab.estimation.latency import estimate_latency
from stridelab.estimation.observability import summarise_observability
from stridelab.estimation.smoother import Smoother
from stridelab.recordings.files.c3d_writer import write_c3d
from stridelab.recordings.force_windows import measured_windows
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.plate_contacts import wrench_track
from stridelab.recordings.reader import read_recording
from stridelab.service.kinds.estimate_com import run as estimate_com
from stridelab.simulation.human.walker import HumanWalker
from stridelab.simulation.human_recording import record
from stridelab.simulation.noise import MeasurementNoise
from support.command_line import estimate_task, quiet

DURATION_S = 2.0


@pytest.fixture(scope="module")
def trial(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two steps on two plates, 49 markers."""
    walk = HumanWalker(height_m=1.75, mass_kg=70.0, sex="male", speed_m_s=1.2, duration_s=DURATION_S, seed=1).walk()
    noise = MeasurementNoise(marker_m=0.001, force_n=2.0, moment_nm=1.0, mass_model=0.2, latency_s=0.012)
    path = tmp_path_factory.mktemp("trial") / "walk.c3d"
    write_c3d(path, record(walk, noise, 0, lab="two_plates").recording)
    return path


ESTIMATORS: list[ComEstimator] = [ComplementaryFilter(), RtsSmoother.tuned(), Smoother()]


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda e: e.name)
def test_read_geometry_fusion_report_numbers_of_2_s(benchmark, trial: Path, estimator: ComEstimator):
    """Nothing is written; latency, residual, bias and observability are the numbers of the report."""

    def numbers():
        recording = read_recording(trial)
        landmarks = identify(list(recording.markers_m)).landmarks
        windows = measured_windows(recording, landmarks)
        geometric = SegmentModel().com(recording, landmarks, subject=recording.subject)
        mass_kg = recording.subject.mass_kg
        lag = estimate_latency(geometric, lambda late_s: wrench_track(recording, windows, latency_s=late_s), mass_kg)
        wrench = wrench_track(recording, windows, latency_s=lag.latency_s)
        estimate = estimator.estimate(geometric, wrench, mass_kg)
        return (
            force_residual_n(estimate, wrench, mass_kg),
            bias_m(estimate, geometric),
            summarise_observability(estimate),
            estimate,
        )

    estimate = benchmark(numbers)[-1]
    benchmark.extra_info["window_s"] = round(estimate.window.duration_s, 2)


@pytest.mark.parametrize("method", ["complementary", "smoother"])
def test_job_on_2_s_with_its_files(benchmark, trial: Path, tmp_path: Path, method: str):
    """What a worker's child does: the same, and com.parquet, com.csv and com.c3d."""
    task = estimate_task(trial, tmp_path, method=method)
    benchmark(lambda: estimate_com.run(task, tmp_path, quiet))
