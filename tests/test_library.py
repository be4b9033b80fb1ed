"""The public front: numbers of the jobs, results that plot and save themselves, errors that name the option."""

import json
from pathlib import Path

import numpy as np
import pytest

import stridelab as sl
from stridelab.errors import Conflict, InvalidInput, Unavailable, UnreadableFile
from stridelab.machine.models_folder import models_dir
from stridelab.service.kinds.estimate_com import run as estimate_com
from support.command_line import estimate_task, quiet

SAMPLE = models_dir() / "recordings" / "sample-walk" / "recording.c3d"


@pytest.fixture(scope="module")
def com() -> sl.CentreOfMass:
    return sl.estimate_com(SAMPLE)


def test_the_numbers_are_those_of_the_job(com: sl.CentreOfMass, tmp_path: Path) -> None:
    outcome = estimate_com.run(estimate_task(SAMPLE, tmp_path), tmp_path, quiet)
    assert com.summary.model_dump(mode="json") == outcome.summary
    truth = np.genfromtxt(SAMPLE.with_name("truth.csv"), delimiter=",", names=True)
    at = np.searchsorted(truth["time_s"], com.time_s)
    known_m = np.column_stack([truth[name][at] for name in ("com_x_m", "com_y_m", "com_z_m")])
    assert np.abs(com.com_m - known_m).max() < 0.03


def test_a_result_plots_its_band(com: sl.CentreOfMass) -> None:
    figure = com.plot()
    assert [trace.name for trace in figure.data] == ["x, 95 %", "x", "y, 95 %", "y", "z, 95 %", "z"]
    np.testing.assert_allclose(figure.data[5].y, com.com_m[:, 2])
    upper_m = figure.data[4].y[: len(com.time_s)]
    np.testing.assert_allclose(upper_m, com.com_m[:, 2] + 1.96 * com.sd_m[:, 2])


def test_a_result_saves_itself_once(com: sl.CentreOfMass, tmp_path: Path) -> None:
    folder = com.save(tmp_path / "result")
    names = {path.name for path in folder.iterdir()}
    assert {"com.csv", "com.parquet", "com.c3d", "result.json"} <= names
    assert "recording.c3d" not in names
    assert json.loads((folder / "result.json").read_text())["summary"] == com.summary.model_dump(mode="json")
    with pytest.raises(Conflict):
        com.save(folder)
    com.save(folder, replace=True)


def test_the_wheel_of_a_loaded_recording() -> None:
    loaded = sl.read(SAMPLE)
    assert loaded.recording.n_frames > 100
    fit = sl.fit_cycloid(loaded)
    assert len(fit.plot().data) == 2 * len(fit.summary.steps)


def test_data_frames_need_a_library(com: sl.CentreOfMass, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stridelab.library.options.find_spec", lambda _name: None)
    with pytest.raises(Unavailable) as caught:
        com.to_dataframe()
    assert caught.value.code == "dataframe-unavailable"


def test_a_motion_of_the_centre_of_mass_is_planned_and_saved(tmp_path: Path) -> None:
    motion = sl.plan_motion("flat-walk", whole_body=False)
    assert motion.failure is None
    assert motion.summary.n_phases > 2
    saved = motion.save(tmp_path / "plan")
    assert (saved / "result.json").is_file()


def test_wrong_options_are_named(tmp_path: Path) -> None:
    with pytest.raises(UnreadableFile, match="nowhere"):
        sl.read(tmp_path / "nowhere.c3d")
    with pytest.raises(InvalidInput, match="method"):
        sl.estimate_com(SAMPLE, method="guess")
    with pytest.raises(InvalidInput, match="mass_kg"):
        sl.estimate_com(sl.read(SAMPLE), mass_kg=70.0)
    with pytest.raises(InvalidInput, match="mass_kg"):
        sl.read(SAMPLE, mass_kg=-1.0)


def test_importing_the_package_imports_nothing_heavy() -> None:
    import subprocess
    import sys

    code = "import sys, stridelab; print({'numpy', 'pinocchio', 'pydantic'} & set(sys.modules))"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "set()"


def test_a_motion_is_pushed() -> None:
    pushed = sl.push_basin("flat-walk", speed_m_s=0.02, n=1, seed=2)
    assert (pushed.summary.survived, pushed.summary.n) == (1, 1)
    assert pushed.columns["outcome"].tolist() == ["survived"]
    with pytest.raises(InvalidInput) as refusal:
        sl.push_basin("flat-walk", speed_m_s=float("nan"), n=1)
    assert [fault.where for fault in refusal.value.faults] == ["speed_m_s"]
