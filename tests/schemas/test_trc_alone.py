"""A TRC file alone from the file to the result: the geometry, and a C3D file made from its tracks."""

from pathlib import Path

import ezc3d
import numpy as np
import pyarrow.parquet as pq
import pytest

from stridelab.errors import NotEstimable, UnreadableFile
from stridelab.recordings.reader import read_recording
from stridelab.schemas.cycloid import FitCycloidTask
from stridelab.schemas.jobs import EstimateComSummary
from stridelab.schemas.recordings import SubjectFields
from stridelab.schemas.tasks import ParseUploadTask, RecordingSource
from stridelab.service.kinds.estimate_com import run as estimate_com
from stridelab.service.kinds.fit_cycloid import run as fit_cycloid
from stridelab.service.kinds.parse_upload import run as parse
from support.command_line import SAMPLE, estimate_task, quiet
from support.recordings.export_files import write_trc

TRIAL = SAMPLE / "recording.c3d"
PERSON = SubjectFields(height_m=1.75, sex="male")


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_trc(tmp_path_factory.mktemp("lab") / "walk.trc", read_recording(TRIAL))


def geometry(folder: Path) -> np.ndarray:
    read = pq.read_table(folder / "com.parquet")
    return np.column_stack([read[f"geometry_{axis}_m"].to_numpy() for axis in "xyz"])


@pytest.fixture(scope="module")
def result(walk: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, EstimateComSummary]:
    folder = tmp_path_factory.mktemp("result")
    outcome = estimate_com.run(estimate_task(walk, folder, subject=PERSON, method="geometry"), folder, quiet)
    assert {artifact.name for artifact in outcome.artifacts} == {"com.parquet", "com.csv", "com.c3d"}
    return folder, EstimateComSummary.model_validate(outcome.summary)


def test_the_geometry_is_that_of_the_markers_in_the_c3d(result, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    """A tenth of a micrometre is written. The C3D carries a segment table and the person, which are stated here."""
    folder = tmp_path / "c3d"
    task = estimate_task(TRIAL, folder, subject=PERSON, method="geometry", segment_table="dumas2007")
    estimate_com.run(task, folder, quiet)
    np.testing.assert_allclose(geometry(result[0]), geometry(folder), atol=2e-5)
    assert result[1].method == "geometry"
    assert result[1].mass_kg is None
    assert "no-force-file" in {remark.code for remark in result[1].warnings}


def test_com_c3d_is_a_new_file_with_all_markers_and_the_centre_of_mass(result, walk: Path) -> None:  # type: ignore[no-untyped-def]
    content = ezc3d.c3d(str(result[0] / "com.c3d"))
    labels = content["parameters"]["POINT"]["LABELS"]["value"]
    recording = read_recording(walk)
    assert labels == [*recording.markers_m, "COM", "COM_GEOMETRY"]
    assert content["parameters"]["POINT"]["UNITS"]["value"] == ["mm"]
    assert content["parameters"]["POINT"]["RATE"]["value"][0] == recording.marker_rate_hz
    points_m = content["data"]["points"][:3].transpose(2, 1, 0) / 1000.0
    for i, label in enumerate(recording.markers_m):
        np.testing.assert_allclose(points_m[:, i], recording.markers_m[label], atol=1e-6)
    np.testing.assert_allclose(points_m[:, labels.index("COM_GEOMETRY")], geometry(result[0]), atol=1e-6)


def test_methods_with_force_name_geometry_and_where_forces_come_from(walk: Path, tmp_path: Path) -> None:
    with pytest.raises(NotEstimable) as refusal:
        estimate_com.run(estimate_task(walk, tmp_path), tmp_path, quiet)
    assert refusal.value.code == "no-plates"
    assert "method geometry" in refusal.value.message
    assert any("MOT" in fault.message for fault in refusal.value.faults)


def test_the_wheel_is_fitted_to_every_step_of_the_geometry(walk: Path, tmp_path: Path) -> None:
    task = estimate_task(walk, tmp_path, method="geometry")
    all_steps = FitCycloidTask.model_validate(
        {**task.model_dump(), "input": {**task.input.model_dump(), "steps": "all"}}
    )
    assert fit_cycloid.run(all_steps, tmp_path, quiet).summary["steps"]


def test_a_broken_upload_is_refused_by_its_own_name_and_line(walk: Path, tmp_path: Path) -> None:
    """The stored copy has another name, which is a word that sentences use as well."""
    lines = walk.read_text().splitlines()
    (tmp_path / "trial").write_text("\n".join([*lines[:12], lines[12].replace("\t", " x\t", 3)]))
    task = ParseUploadTask(recording=RecordingSource(file="trial", filename="walk 03.trc"))
    with pytest.raises(UnreadableFile) as refusal:
        parse(task, tmp_path, quiet)
    assert refusal.value.message.startswith("The TRC file walk 03.trc is broken: line 13, column 1 holds")
    assert refusal.value.faults[0].where == "walk 03.trc"


def test_the_refusal_of_two_trials_keeps_its_sentence(walk: Path, tmp_path: Path) -> None:
    import zipfile

    with zipfile.ZipFile(tmp_path / "trial", "w") as packed:
        packed.write(walk, "a.trc")
        packed.write(walk, "b.trc")
    task = ParseUploadTask(recording=RecordingSource(file="trial", filename="pair.zip"))
    with pytest.raises(UnreadableFile) as refusal:
        parse(task, tmp_path, quiet)
    assert "more than one trial;" in refusal.value.message


def test_a_recorded_trc_gives_a_centre_of_mass(gait: Path, tmp_path: Path) -> None:
    task = estimate_task(gait / "opensim-core" / "rajagopal-walk" / "markers_walk.trc", tmp_path, method="geometry")
    summary = EstimateComSummary.model_validate(estimate_com.run(task, tmp_path, quiet).summary)
    assert summary.window_s == pytest.approx((0.0, 2.37), abs=0.011)
    read = pq.read_table(tmp_path / "com.parquet")
    height_m = read["z_m"].to_numpy()
    assert 0.9 < np.nanmin(height_m) < np.nanmax(height_m) < 1.15
