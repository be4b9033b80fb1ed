"""The forces of an OpenSim trial are found by the names of its files, and only where the names leave no doubt."""

import zipfile
from pathlib import Path, PurePosixPath

import pytest

from stridelab.recordings.files.trial_pairs import copy_recording, forces_beside, pair_trials

GRF = "grf\nnRows=1\nendheader\ntime\tground_force_vx\n0\t0\n"
ANGLES = "angles\nnRows=1\nendheader\ntime\tknee_angle\n0\t0\n"


def pairs_by_name(*names: str) -> dict[str, str]:
    paths = [PurePosixPath(name) for name in names]
    trials = [path for path in paths if path.suffix == ".trc"]
    pairs = pair_trials(trials, [path for path in paths if path.suffix != ".trc"])
    return {str(trial): str(force) for trial, force in pairs.items()}


@pytest.mark.parametrize(
    ("trial", "force"),
    [
        ("walk1.trc", "walk1.mot"),
        ("walk1.trc", "walk1_grf.mot"),
        ("Walk1.trc", "walk1_GRF.sto"),
        ("walk1.trc", "walk1-ground-reaction-forces.mot"),
        ("subject01_walk1.trc", "subject01_walk1_external_loads.mot"),
        ("walk1_markers.trc", "walk1_forces.mot"),
        ("marker_experimental.trc", "grf.mot"),
        ("day1/MarkerData/walk1.trc", "day1/ForceData/walk1_forces.mot"),
        ("day1/MarkerData/walk1.trc", "day1/ID/walk1_grf.mot"),
    ],
)
def test_names_that_say_the_same_are_a_pair(trial: str, force: str) -> None:
    assert pairs_by_name(trial, force, "static.trc", "other/walk2_grf.mot") == {trial: force}


@pytest.mark.parametrize(
    "names",
    [
        ("walk1.trc", "walk2_grf.mot"),
        ("walk1.trc", "walk10_grf.mot"),
        ("walk1.trc", "other/walk1_grf.mot"),
        ("a/MarkerData/walk1.trc", "b/ForceData/walk1_grf.mot"),
        ("walk1.trc", "walk1_grf.mot", "walk1_forces.mot"),
        ("walk1.trc", "walk1_markers.trc", "walk1_grf.mot"),
    ],
)
def test_names_that_leave_a_doubt_are_no_pair(names: tuple[str, ...]) -> None:
    assert pairs_by_name(*names) == {}


def test_forces_in_the_same_folder_come_before_others() -> None:
    assert pairs_by_name("day/m/walk.trc", "day/m/walk_grf.mot", "day/Forces/walk_grf.mot") == {
        "day/m/walk.trc": "day/m/walk_grf.mot"
    }


def test_joint_angles_are_no_forces(tmp_path: Path) -> None:
    for name, text in {"walk.trc": "trc", "walk.mot": ANGLES, "run.trc": "trc", "run.mot": GRF}.items():
        (tmp_path / name).write_text(text)
    assert forces_beside(tmp_path / "walk.trc") is None
    assert forces_beside(tmp_path / "run.trc") == tmp_path / "run.mot"
    assert forces_beside(tmp_path / "run.mot") is None


def test_a_path_relative_to_the_folder_is_as_good(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("MarkerData/walk.trc", "MarkerData/ForceData/walk_grf.mot", "ForceData/walk_grf.mot"):
        (tmp_path / name).parent.mkdir(exist_ok=True, parents=True)
        (tmp_path / name).write_text(GRF)
    monkeypatch.chdir(tmp_path / "MarkerData")
    assert forces_beside(Path("walk.trc")) == tmp_path / "ForceData" / "walk_grf.mot"


def test_a_trial_is_copied_with_its_forces(tmp_path: Path) -> None:
    (tmp_path / "MarkerData").mkdir()
    (tmp_path / "ForceData").mkdir()
    (tmp_path / "MarkerData" / "walk.trc").write_text("markers")
    copy_recording(tmp_path / "MarkerData" / "walk.trc", tmp_path / "alone")
    assert (tmp_path / "alone").read_text() == "markers"
    (tmp_path / "ForceData" / "walk_grf.mot").write_text(GRF)
    copy_recording(tmp_path / "MarkerData" / "walk.trc", tmp_path / "both")
    with zipfile.ZipFile(tmp_path / "both") as packed:
        assert packed.namelist() == ["walk.trc", "walk_grf.mot"]
