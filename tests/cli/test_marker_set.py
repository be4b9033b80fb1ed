"""``--marker-set FILE``: markers with the labels of a laboratory give the same result as with known labels."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from stridelab.recordings.files.c3d_writer import write_c3d
from stridelab.recordings.marker_sets import identify, is_landmark
from stridelab.recordings.reader import read_recording
from support.command_line import SAMPLE, Run


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the sample under labels that no shipped set has, ``walk.c3d``, and their set, ``lab.toml``."""
    folder = tmp_path_factory.mktemp("lab")
    recording = read_recording(SAMPLE / "recording.c3d")
    landmarks = identify(tuple(recording.markers_m)).landmarks
    new = {label: f"mk{k:02d}" for k, label in enumerate(recording.markers_m)}
    markers = {new[label]: track for label, track in recording.markers_m.items()}
    write_c3d(folder / "walk.c3d", replace(recording, markers_m=markers))
    assert all(is_landmark(landmark) for landmark in landmarks)
    lines = [f'{landmark} = ["{new[label]}"]' for landmark, label in landmarks.items()]
    (folder / "lab.toml").write_text("\n".join(['name = "lab"', "[unpaired]", *lines]), encoding="utf-8")
    return folder


def result(folder: Path) -> dict[str, object]:
    summary: dict[str, object] = json.loads((folder / "result.json").read_text())["summary"]
    return {name: summary[name] for name in ("window_s", "mass_kg", "latency_s", "rms_force_residual_n")}


@pytest.mark.parametrize("command", ["estimate", "compare", "fit-cycloid"])
def test_the_set_of_a_file_names_the_markers(run: Run, lab: Path, tmp_path: Path, command: str) -> None:
    refused = run(command, lab / "walk.c3d")
    assert refused.code == 4
    assert "--marker-set FILE" in " ".join(refused.err.split())
    assert run(command, lab / "walk.c3d", "--marker-set", lab / "lab.toml", "--out", tmp_path / "out").code == 0
    assert (tmp_path / "out" / "result.json").is_file()


def test_the_estimate_equals_that_of_known_labels(run: Run, lab: Path, tmp_path: Path) -> None:
    assert run("estimate", SAMPLE / "recording.c3d", "--out", tmp_path / "known").code == 0
    assert run("estimate", lab / "walk.c3d", "--marker-set", lab / "lab.toml", "--out", tmp_path / "own").code == 0
    known, own = result(tmp_path / "known"), result(tmp_path / "own")
    assert own == {name: pytest.approx(value, rel=1e-3, abs=1e-3) for name, value in known.items()}


def test_several_recordings_use_the_set(run: Run, lab: Path, tmp_path: Path) -> None:
    (tmp_path / "again.c3d").write_bytes((lab / "walk.c3d").read_bytes())
    files = (lab / "walk.c3d", tmp_path / "again.c3d")
    options = ("--method", "geometry", "--marker-set", lab / "lab.toml", "--out", tmp_path / "out")
    assert run("estimate", *files, *options).code == 0
    assert (tmp_path / "out" / "again-com" / "result.json").is_file()


def test_a_set_that_does_not_fit_is_the_nearest_one_with_what_it_lacks(run: Run, lab: Path, tmp_path: Path) -> None:
    text = (lab / "lab.toml").read_text(encoding="utf-8").replace('l_asis = ["', 'l_asis = ["not-')
    (tmp_path / "other.toml").write_text(text, encoding="utf-8")
    refused = run("estimate", lab / "walk.c3d", "--marker-set", tmp_path / "other.toml")
    message = " ".join(refused.err.split())
    assert refused.code == 4
    assert "nearest: lab" in message
    assert "missing: l_asis" in message
    (tmp_path / "other.toml").write_text("name = 3", encoding="utf-8")
    assert "marker-set-invalid" in run("estimate", lab / "walk.c3d", "--marker-set", tmp_path / "other.toml").err
