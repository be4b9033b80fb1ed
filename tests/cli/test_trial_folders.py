"""Folders as OpenSim users have them: TRC files, and the forces of each beside it."""

import json
import zipfile
from pathlib import Path

import pytest
from typer.testing import CliRunner

from stridelab.cli.app import app
from stridelab.cli.study_population import collect_files
from stridelab.recordings.reader import read_recording
from stridelab.simulation.human.walker import HumanWalker
from stridelab.simulation.human_recording import record
from stridelab.simulation.noise import MeasurementNoise
from support.recordings.export_files import write_trc_mot


@pytest.fixture(scope="module")
def trial_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two walks of one person, as TRC and MOT files of equal names."""
    home = tmp_path_factory.mktemp("lab")
    walk = HumanWalker(mass_kg=64.0, duration_s=3.0, seed=4).walk()
    for k in range(2):
        recording = record(walk, MeasurementNoise(marker_m=0.002), k, lab="two_plates").recording
        with zipfile.ZipFile(write_trc_mot(home / "pair.zip", recording)) as pair:
            (home / f"walk{k}.trc").write_bytes(pair.read("walk.trc"))
            (home / f"walk{k}_grf.mot").write_bytes(pair.read("walk_grf.mot"))
    (home / "pair.zip").unlink()
    return home


@pytest.mark.parametrize("several", [False, True])
def test_a_trc_file_is_estimated_with_the_forces_beside_it(several: bool, trial_folder: Path, tmp_path: Path) -> None:
    given = trial_folder if several else trial_folder / "walk0.trc"
    words = ["estimate", str(given), "--method", "complementary", "--height", "1.75", "--out", str(tmp_path / "out")]
    answer = CliRunner().invoke(app, words)
    assert answer.exit_code == 0, answer.output
    assert several or "walk0_grf.mot" in answer.stderr.replace("\n", "")
    results = sorted((tmp_path / "out").rglob("result.json"))
    assert len(results) == (2 if several else 1)
    for result in results:
        summary = json.loads(result.read_text())["summary"]
        assert summary["mass_kg"] == pytest.approx(64.0, rel=0.02)


def test_folders_of_studies_hold_trials_with_their_forces(trial_folder: Path, tmp_path: Path) -> None:
    files = dict(collect_files([trial_folder], None, tmp_path).files)
    assert sorted(files) == ["walk0.trc", "walk1.trc"]
    for path in files.values():
        assert len(read_recording(path).plates) == 2


def test_measures_of_a_folder_use_the_forces(trial_folder: Path, tmp_path: Path) -> None:
    answer = CliRunner().invoke(
        app, ["measures", str(trial_folder), "--height", "1.75", "--out", str(tmp_path / "out")]
    )
    assert answer.exit_code == 0, answer.output
    summary = json.loads((tmp_path / "out" / "result.json").read_text())["summary"]
    assert summary["method"] == "smoother"
    assert summary["mass_kg"] == pytest.approx(64.0, rel=0.02)
    lines = " ".join(answer.output.split())
    assert "not measured local dynamic stability: " in lines
    assert "foot placement gain position, foot placement gain velocity, foot placement explained: " in lines
