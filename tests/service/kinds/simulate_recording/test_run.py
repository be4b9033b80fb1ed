"""A simulated recording is a C3D like any other, repeats bit for bit, and its truth obeys mechanics."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from pydantic import ValidationError

from stridelab.body.segment_model import SegmentModel
from stridelab.conventions import g
from stridelab.errors import InvalidInput
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.pipelines.trial import examine_trial
from stridelab.recordings.plate_contacts import wrench_track
from stridelab.recordings.reader import read_recording
from stridelab.schemas.jobs import SimulateRecordingInput, SimulateRecordingSummary, SimulationNoise
from stridelab.schemas.recordings import RecordingFacts
from stridelab.schemas.tasks import RecordingSource, SimulateRecordingTask
from stridelab.service.filenames import SIMULATED_FACTS_FILE
from stridelab.service.kinds.provenance import known_references
from stridelab.service.kinds.simulate_recording import run as simulate_recording
from support.command_line import RecordedProgress, quiet

WALK = SimulateRecordingInput(duration_s=2.0, height_m=1.8, mass_kg=75.0, sex="male", seed=3, lab="two_plates")


def simulated(folder: Path, simulation: SimulateRecordingInput = WALK) -> SimulateRecordingSummary:
    folder.mkdir(exist_ok=True)
    outcome = simulate_recording.run(SimulateRecordingTask(input=simulation), folder, quiet)
    return SimulateRecordingSummary.model_validate(outcome.summary)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder, progress = tmp_path_factory.mktemp("simulated"), RecordedProgress()
    outcome = simulate_recording.run(SimulateRecordingTask(input=WALK), folder, progress)
    assert [a.name for a in outcome.artifacts] == ["recording.c3d", "truth.parquet", "truth.csv"]
    assert progress.fractions[-1] == 1.0
    assert set(outcome.references) <= known_references()
    summary = SimulateRecordingSummary.model_validate(outcome.summary)
    assert summary.speed_m_s == pytest.approx(1.2, abs=0.15)
    assert summary.n_steps >= 2
    assert summary.recording_id is None, "only the publication gives it one"
    return folder


def truth(folder: Path, *names: str) -> np.ndarray:
    table = pq.read_table(folder / "truth.parquet")
    return np.column_stack([table[name].to_numpy() for name in names])


def test_the_recording_reads_back_with_its_person_and_its_segment_table(folder: Path) -> None:
    recording = read_recording(folder / "recording.c3d")
    assert recording.subject.height_m == pytest.approx(1.8)
    assert recording.subject.mass_kg == pytest.approx(75.0)
    assert "segments" in json.loads(recording.carried["segment_table"])
    assert len(recording.plates) == 2
    assert recording.n_frames == 200


def test_the_facts_are_those_of_the_file(folder: Path) -> None:
    facts = RecordingFacts.model_validate_json((folder / SIMULATED_FACTS_FILE).read_text())
    assert facts.marker_set is not None
    assert len(facts.windows_s) == 1
    assert facts.mass_from_force_kg == pytest.approx(75.0, rel=0.03)
    assert len(facts.labels) == facts.n_markers
    assert (folder / "tracks.parquet").is_file()


def test_the_truth_obeys_newton(folder: Path) -> None:
    """m (c'' - g) = f, with c'' from the positions by central differences at 100 Hz."""
    c = truth(folder, "com_x_m", "com_y_m", "com_z_m")
    f = truth(folder, "fx_n", "fy_n", "fz_n")
    acceleration = (c[2:] - 2 * c[1:-1] + c[:-2]) * 100.0**2
    residual_n = 75.0 * (acceleration - g) - f[1:-1]
    assert np.sqrt(np.mean(residual_n**2)) < 0.02 * 75.0 * 9.81


def test_the_truth_obeys_euler(folder: Path) -> None:
    """The moment about the centre of mass is the rate of the angular momentum."""
    c, f = truth(folder, "com_x_m", "com_y_m", "com_z_m"), truth(folder, "fx_n", "fy_n", "fz_n")
    moment = truth(folder, "mx_nm", "my_nm", "mz_nm") - np.cross(c, f)
    rate = np.gradient(truth(folder, "l_x_nms", "l_y_nms", "l_z_nms"), 0.01, axis=0)
    assert np.sqrt(np.mean((moment - rate)[2:-2] ** 2)) < 0.1 * np.sqrt(np.mean(moment**2)) + 0.5


def test_the_same_seed_repeats_and_another_does_not(folder: Path, tmp_path: Path) -> None:
    simulated(tmp_path / "again")
    same = [p.read_bytes() == (tmp_path / "again" / p.name).read_bytes() for p in folder.glob("recording.c3d")]
    assert same == [True]
    simulated(tmp_path / "other", WALK.model_copy(update={"seed": 4}))
    assert not np.allclose(truth(tmp_path / "other", "com_x_m"), truth(folder, "com_x_m"), atol=1e-3)


def test_without_noise_the_recording_is_exact(folder: Path, tmp_path: Path) -> None:
    silent = SimulationNoise(force_n=0, moment_nm=0, marker_m=0)
    simulated(tmp_path / "a", WALK.model_copy(update={"noise": silent}))
    clean, noisy = read_recording(tmp_path / "a" / "recording.c3d"), read_recording(folder / "recording.c3d")
    np.testing.assert_array_equal(truth(tmp_path / "a", "com_x_m"), truth(folder, "com_x_m"))
    differences = np.concatenate([noisy.markers_m[label] - clean.markers_m[label] for label in clean.markers_m])
    assert np.std(differences) == pytest.approx(0.0005, rel=0.1)


def test_only_the_artifacts_remain_where_no_row_is_made(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "a")
    simulate_recording.remove_private_files(tmp_path / "a")
    assert {p.name for p in (tmp_path / "a").iterdir()} == {"recording.c3d", "truth.parquet", "truth.csv"}


@pytest.fixture(scope="module")
def talos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """TALOS walks for four seconds; its recording reads back as a file from a laboratory would."""
    folder = tmp_path_factory.mktemp("talos")
    simulation = SimulateRecordingInput.model_validate({"robot": "talos", "duration_s": 4.0, "seed": 2})
    assert simulation.speed_m_s == pytest.approx(0.4), "its own speed, unless one is stated"
    outcome = simulate_recording.run(SimulateRecordingTask(input=simulation), folder, quiet)
    assert [a.name for a in outcome.artifacts] == ["recording.c3d", "truth.parquet", "truth.csv"]
    assert set(outcome.references) <= known_references()
    summary = SimulateRecordingSummary.model_validate(outcome.summary)
    assert summary.n_steps == 4
    return folder


def test_talos_reads_back_as_a_recording_with_its_mass_and_its_table(talos: Path) -> None:
    recording = read_recording(talos / "recording.c3d")
    assert recording.subject.mass_kg == pytest.approx(90.27, abs=0.01)
    assert json.loads(recording.carried["segment_table"])["name"] == "talos"
    facts = RecordingFacts.model_validate_json((talos / SIMULATED_FACTS_FILE).read_text())
    assert facts.marker_set == "isb-head"
    assert facts.mass_from_force_kg == pytest.approx(90.27, rel=0.01)
    assert facts.windows_s[0][1] - facts.windows_s[0][0] > 3.9
    assert facts.missing_landmarks == []


def test_the_truth_of_talos_obeys_newton_and_euler(talos: Path) -> None:
    c, f = truth(talos, "com_x_m", "com_y_m", "com_z_m"), truth(talos, "fx_n", "fy_n", "fz_n")
    acceleration = (c[2:] - 2 * c[1:-1] + c[:-2]) * 100.0**2
    residual_n = 90.272192 * (acceleration - g) - f[1:-1]
    assert np.sqrt(np.mean(residual_n**2)) < 0.003 * 90.27 * 9.81
    moment = truth(talos, "mx_nm", "my_nm", "mz_nm") - np.cross(c, f)
    rate = np.gradient(truth(talos, "l_x_nms", "l_y_nms", "l_z_nms"), 0.01, axis=0)
    assert np.sqrt(np.mean((moment - rate)[2:-2] ** 2)) < 0.1 * np.sqrt(np.mean(moment**2)) + 0.5


def test_talos_is_estimated_like_a_person(talos: Path) -> None:
    """Through the file alone: markers, plates, carried table; every axis within 3 mm of the truth."""
    trial = examine_trial(RecordingSource(file="recording.c3d", filename="recording.c3d"), talos)
    recording = trial.recording
    geometric = SegmentModel("carried").com(recording, trial.match.landmarks, subject=recording.subject)
    wrench = wrench_track(recording, trial.windows)
    estimate = ComplementaryFilter().estimate(geometric, wrench, 90.27)
    at = np.round(estimate.time_s * 100.0).astype(int)
    error = estimate.com_m - truth(talos, "com_x_m", "com_y_m", "com_z_m")[at]
    assert np.sqrt(np.mean(error**2, axis=0)).max() < 3e-3


@pytest.mark.parametrize(
    ("options", "part"),
    [
        ({"gait": "running"}, "only TALOS runs"),
        ({"robot": "hrp2", "gait": "running"}, "only TALOS runs"),
        ({"robot": "talos", "mass_kg": 80.0}, "its own height and mass"),
        ({"robot": "talos", "sex": "male"}, "its own height and mass"),
        ({"robot": "hrp2", "height_m": 1.6}, "its own height and mass"),
        ({"robot": ""}, "at least 1 character"),
        ({"mass_kg": None}, "a person needs"),
    ],
)
def test_impossible_simulations_are_refused_at_submission(options: dict[str, Any], part: str) -> None:
    with pytest.raises(ValidationError, match=part):
        SimulateRecordingInput.model_validate(options)


@pytest.mark.parametrize(
    "options", [{"robot": "talos", "speed_m_s": 1.5}, {"robot": "talos", "gait": "running", "speed_m_s": 2.0}]
)
def test_speeds_beyond_talos_are_refused_by_the_job(options: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="TALOS") as refusal:
        simulated(tmp_path / "a", SimulateRecordingInput.model_validate(options))
    assert refusal.value.code == "walker-out-of-range"


def test_an_input_that_travels_as_json_stays_the_same() -> None:
    simulation = SimulateRecordingInput.model_validate({"robot": "talos", "gait": "running", "seed": 1})
    assert simulation.speed_m_s == pytest.approx(1.0)
    assert simulation.mass_kg is None
    assert SimulateRecordingInput.model_validate_json(simulation.model_dump_json()) == simulation
