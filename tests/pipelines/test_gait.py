"""Every shared recording through ``estimate-com``: estimated, or refused with the code the table says."""

import os
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from stridelab.errors import NotEstimable
from stridelab.schemas.jobs import EstimateComSummary
from stridelab.schemas.recordings import RecordingFacts, SubjectFields
from stridelab.schemas.tasks import ParseUploadTask, RecordingSource
from stridelab.service.kinds import parse_upload
from stridelab.service.kinds.estimate_com import run as estimate_com
from support.command_line import estimate_task, quiet
from support.recordings.gait_table import ESTIMABLE, GAIT_TABLE, GaitTrial, trial

GAIT = Path(os.environ.get("STRIDELAB_TEST_DATA", Path(__file__).parents[3] / "shared")).resolve() / "gait"
if not GAIT.is_dir():
    pytest.skip("real recordings are not here (set STRIDELAB_TEST_DATA)", allow_module_level=True)

REFUSED = {
    "FP_Type3": "unknown-marker-set",
    "walking2": "window-too-short",
    "gait2354-subject01": "knee-markers-missing",
    "subject01_static": "no-plates",
}
"""What the recordings' own table does not decide: labels, markers that only a static trial has, length."""

STATIC_OF = {"gait2354-subject01": "subject01_static"}


def summary_of(row: GaitTrial, tmp_path: Path, subject: SubjectFields | None = None) -> EstimateComSummary:
    folder = tmp_path / "task"
    task = estimate_task(row.uploaded(GAIT, tmp_path), folder, subject=subject)
    if row.name in STATIC_OF and subject is not None:
        static = trial(STATIC_OF[row.name]).uploaded(GAIT, folder)
        task = task.model_copy(update={"static": RecordingSource(file=static.name, filename=static.name)})
    return EstimateComSummary.model_validate(estimate_com.run(task, folder, quiet).summary)


@pytest.mark.parametrize("row", GAIT_TABLE, ids=lambda row: row.name)
def test_each_recording_is_estimated_or_refused_as_expected(row: GaitTrial, tmp_path: Path) -> None:
    expected = REFUSED.get(row.name, row.outcome)
    if expected != ESTIMABLE:
        with pytest.raises(NotEstimable) as refusal:
            summary_of(row, tmp_path)
        assert refusal.value.code == expected
        if row.name not in STATIC_OF:
            return
    summary = summary_of(row, tmp_path, SubjectFields())
    start_s, end_s = summary.window_s
    assert any(a - 0.02 <= start_s < end_s <= b + 0.02 for a, b in row.windows_s)
    if row.measured_mass_kg is not None:
        assert summary.mass_from_force_kg == pytest.approx(row.measured_mass_kg, abs=0.01)
    if row.stated_mass_kg is not None and row.mass_tolerance is not None and summary.mass_source == "file":
        assert summary.mass_kg == pytest.approx(row.stated_mass_kg, abs=0.06)
        assert summary.mass_from_force_kg == pytest.approx(row.stated_mass_kg, rel=row.mass_tolerance)
    assert np.abs(summary.bias_m).max() < 0.06
    com = pq.read_table(tmp_path / "task" / "com.parquet")
    height_m = com["z_m"].to_numpy()
    assert 0.5 < np.nanmedian(height_m) < 1.3
    assert np.isfinite(height_m).sum() == round((end_s - start_s) * summary.rate_hz) + 1


ONE_OF_EACH = [row for row in GAIT_TABLE if "rehazenter" not in row.files[0] or "2014022" in row.files[0]]


@pytest.mark.parametrize("row", ONE_OF_EACH, ids=lambda row: row.name)
def test_each_recording_is_parsed_and_no_person_is_named(row: GaitTrial, tmp_path: Path) -> None:
    upload = row.uploaded(GAIT, tmp_path)
    (tmp_path / "trial").write_bytes(upload.read_bytes())
    source = RecordingSource(file="trial", filename=upload.name)
    outcome = parse_upload.run(ParseUploadTask(recording=source), tmp_path, quiet)
    facts = RecordingFacts.model_validate(outcome.summary)
    assert facts.subject.name is None
    assert not any(":" in label for label in facts.labels)
    assert len(facts.windows_s) == len(row.windows_s)
    for window, seen in zip(row.windows_s, facts.windows_s, strict=True):
        assert seen == pytest.approx(window, abs=0.011)
    for plate in facts.plates:
        assert all(0.0 <= a < b <= facts.duration_s + 0.02 for a, b in plate.loaded_s)
    tracks = pq.read_table(tmp_path / "tracks.parquet")
    assert tracks.num_rows == facts.n_frames
    assert {f"{label}_x_m" for label in facts.labels} <= set(tracks.column_names)
    assert {f"plate{plate.index}_fx_n" for plate in facts.plates} <= set(tracks.column_names)


def test_a_latency_applied_brings_force_and_geometry_together(tmp_path: Path) -> None:
    """2014022_C4_04: the bias along the walk is mostly the clock (17 ms at 1.2 m/s), and goes when it is set right."""
    row = trial("2014022_C4_04")
    task = estimate_task(row.uploaded(GAIT, tmp_path), tmp_path / "task", latency="apply")
    applied = EstimateComSummary.model_validate(estimate_com.run(task, tmp_path / "task", quiet).summary)
    task = estimate_task(row.uploaded(GAIT, tmp_path), tmp_path / "task", latency="report")
    reported = EstimateComSummary.model_validate(estimate_com.run(task, tmp_path / "task", quiet).summary)
    assert applied.latency_s is not None
    assert 0.010 < applied.latency_s < 0.025
    assert (applied.latency_applied_s, reported.latency_applied_s) == (applied.latency_s, 0.0)
    assert abs(applied.bias_m[0]) < 0.5 * abs(reported.bias_m[0])
