"""``estimate-com`` with less than everything: without mass, plates or window, and with frames missing at an end."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from stridelab.errors import NotEstimable
from stridelab.pipelines import com_inputs
from stridelab.pipelines.trial import Trial
from stridelab.recordings.files.c3d_writer import write_c3d
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Window
from stridelab.schemas.jobs import EstimateComSummary
from stridelab.schemas.recordings import SubjectFields
from stridelab.schemas.tasks import RecordingSource
from stridelab.service.kinds.estimate_com import run as estimate_com
from support.command_line import SAMPLE, estimate_task, quiet
from support.recordings.export_files import write_trc

TRIAL = SAMPLE / "recording.c3d"


def summary_of(folder: Path, **asked: object) -> EstimateComSummary:
    outcome = estimate_com.run(estimate_task(TRIAL, folder, **asked), folder, quiet)
    return EstimateComSummary.model_validate(outcome.summary)


def without_mass(target: Path, *, plates: bool) -> Path:
    """The sample without a body mass, with or without its force plates."""
    recording = read_recording(TRIAL)
    subject = replace(recording.subject, mass_kg=None)
    write_c3d(target, replace(recording, subject=subject, plates=recording.plates if plates else ()))
    return target


def test_geometry_alone_needs_no_mass_and_invents_none(tmp_path: Path) -> None:
    trial = without_mass(tmp_path / "markers.c3d", plates=False)
    outcome = estimate_com.run(estimate_task(trial, tmp_path / "a", method="geometry"), tmp_path / "a", quiet)
    summary = EstimateComSummary.model_validate(outcome.summary)
    assert (summary.mass_kg, summary.mass_source, summary.mass_sd_kg, summary.masses) == (None, None, None, [])
    assert summary.rms_force_residual_n == []
    stated = estimate_task(trial, tmp_path / "b", subject=SubjectFields(mass_kg=45.0), method="geometry")
    estimate_com.run(stated, tmp_path / "b", quiet)
    ours, theirs = (pq.read_table(tmp_path / folder / "com.parquet") for folder in "ab")
    assert ours.column_names == theirs.column_names
    for name in ours.column_names:
        np.testing.assert_array_equal(ours[name].to_numpy(), theirs[name].to_numpy())
    assert np.isfinite(ours["x_m"].to_numpy()).all()


def test_only_a_mass_that_the_plates_measure_is_judged_by_its_error(tmp_path: Path) -> None:
    trial = without_mass(tmp_path / "walk.c3d", plates=True)
    for subject, checked in ((SubjectFields(), True), (SubjectFields(mass_kg=summary_of(tmp_path).mass_kg), False)):
        folder = tmp_path / str(checked)
        outcome = estimate_com.run(estimate_task(trial, folder, subject=subject), folder, quiet)
        summary = EstimateComSummary.model_validate(outcome.summary)
        assert summary.quality is not None
        assert summary.mass_kg is not None
        assert summary.mass_sd_kg is not None
        values = [check.value for check in summary.quality.checks if check.name == "mass_uncertainty"]
        assert values == ([pytest.approx(summary.mass_sd_kg / summary.mass_kg)] if checked else [])
        assert ("mass_uncertainty" in summary.quality.not_checked) != checked


def test_geometry_alone_needs_no_measured_window(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a window too short for the fused estimates it says nothing, and gives the whole recording."""
    examined = com_inputs.examine_trial  # type: ignore[attr-defined]

    def brief(*arguments: Any) -> Trial:
        return replace(examined(*arguments), windows=(Window(1.0, 1.2),))

    monkeypatch.setattr(com_inputs, "examine_trial", brief)
    summary = summary_of(tmp_path / "a", method="geometry")
    assert summary.window_s == pytest.approx((0.0, 3.99))
    part = summary_of(tmp_path / "b", method="geometry", window_s=(0.5, 2.0))
    assert part.window_s == pytest.approx((0.5, 2.0))
    with pytest.raises(NotEstimable) as refusal:
        summary_of(tmp_path / "c", method="complementary")
    assert refusal.value.code == "window-too-short"


def test_an_interval_of_a_recording_without_plates_is_that_of_the_geometry(tmp_path: Path) -> None:
    trial = without_mass(tmp_path / "markers.c3d", plates=False)
    task = estimate_task(trial, tmp_path / "a", method="geometry", window_s=(0.5, 2.0))
    summary = EstimateComSummary.model_validate(estimate_com.run(task, tmp_path / "a", quiet).summary)
    assert summary.window_s == pytest.approx((0.5, 2.0))
    short = estimate_task(trial, tmp_path / "b", method="geometry", window_s=(0.5, 0.7))
    with pytest.raises(NotEstimable) as refusal:
        estimate_com.run(short, tmp_path / "b", quiet)
    assert refusal.value.code == "window-too-short"
    assert "force" not in refusal.value.message


def without_pelvis_from(frame: int, target: Path) -> Path:
    """The sample whose pelvis markers vanish at a frame and do not come back."""
    recording = read_recording(TRIAL)
    markers = {label: track.copy() for label, track in recording.markers_m.items()}
    for label in ("L_IAS", "R_IAS", "L_IPS", "R_IPS"):
        markers[label][frame:] = np.nan
    write_c3d(target, replace(recording, markers_m=markers))
    return target


@pytest.mark.parametrize("method", ["complementary", "kalman", "rts", "smoother", "geometry"])
def test_a_few_missing_frames_at_the_end_are_left_out_with_a_remark(method: str, tmp_path: Path) -> None:
    whole = summary_of(tmp_path / "whole", method="geometry").window_s
    for missing in (1, 4):
        first = round(whole[1] * 100) + 1 - missing
        task = estimate_task(
            without_pelvis_from(first, tmp_path / "cut.c3d"), tmp_path / "a", method=method, latency="report"
        )
        summary = EstimateComSummary.model_validate(estimate_com.run(task, tmp_path / "a", quiet).summary)
        assert summary.window_s == pytest.approx((whole[0], (first - 1) / 100.0), abs=0.011)
        assert [w.code for w in summary.warnings if w.code.startswith("window-cut")] == ["window-cut-to-markers"]


def without_pelvis(from_s: float, to_s: float, target: Path) -> Path:
    """The sample whose pelvis markers are hidden for a time."""
    recording = read_recording(TRIAL)
    markers = {label: track.copy() for label, track in recording.markers_m.items()}
    for label in ("L_IAS", "R_IAS", "L_IPS", "R_IPS"):
        markers[label][round(from_s * 100) : round(to_s * 100)] = np.nan
    write_c3d(target, replace(recording, markers_m=markers))
    return target


def test_the_longest_part_with_markers_is_used_with_a_remark(tmp_path: Path) -> None:
    start_s, end_s = summary_of(tmp_path / "whole", latency="report").window_s
    hole = without_pelvis(start_s + 0.15, start_s + 0.4, tmp_path / "hole.c3d")
    task = estimate_task(hole, tmp_path / "a", latency="report")
    summary = EstimateComSummary.model_validate(estimate_com.run(task, tmp_path / "a", quiet).summary)
    assert summary.window_s == pytest.approx((start_s + 0.4, end_s), abs=0.011)
    (message,) = [w.message for w in summary.warnings if w.code == "geometry-gaps"]
    assert f"{summary.window_s[0]:.2f} to {summary.window_s[1]:.2f} s are used" in message


def test_markers_that_are_never_seen_long_enough_are_refused(tmp_path: Path) -> None:
    start_s, end_s = summary_of(tmp_path / "whole", latency="report").window_s
    hole = without_pelvis(start_s + 0.3, end_s - 0.3, tmp_path / "hole.c3d")
    with pytest.raises(NotEstimable) as refusal:
        estimate_com.run(estimate_task(hole, tmp_path / "a"), tmp_path / "a", quiet)
    assert refusal.value.code == "geometry-gaps"


def test_a_whole_recording_that_is_too_short_can_serve_as_a_static_trial(tmp_path: Path) -> None:
    walk = read_recording(TRIAL)
    short = {label: track[200:220] for label, track in walk.markers_m.items()}
    static = write_trc(tmp_path / "static.trc", replace(walk, markers_m=short))
    with pytest.raises(NotEstimable, match=r"at least 0\.4 s are needed\. The recording can serve as a static trial\."):
        estimate_com.run(estimate_task(static, tmp_path / "a", method="geometry"), tmp_path / "a", quiet)


@pytest.mark.parametrize("n_frames", [1, 2, 5])
def test_a_few_frames_are_a_static_trial_and_no_recording(n_frames: int, tmp_path: Path) -> None:
    """One frame a second is long enough for a step, and nothing can be differentiated from it."""
    walk = read_recording(TRIAL)
    few = {label: track[200 : 200 + n_frames] for label, track in walk.markers_m.items()}
    static = write_trc(tmp_path / "static.trc", replace(walk, markers_m=few, marker_rate_hz=1.0))
    with pytest.raises(NotEstimable) as refusal:
        estimate_com.run(estimate_task(static, tmp_path / "a", method="geometry"), tmp_path / "a", quiet)
    assert refusal.value.code == ("window-too-short" if n_frames == 1 else "recording-too-short")
    assert f"{n_frames} frames in a row; at least 6 are needed" in refusal.value.message or n_frames == 1
    task = estimate_task(TRIAL, tmp_path / "b")
    (tmp_path / "b" / "static-trial").write_bytes(static.read_bytes())
    static_source = RecordingSource(file="static-trial", filename="static.trc")
    summary = EstimateComSummary.model_validate(
        estimate_com.run(task.model_copy(update={"static": static_source}), tmp_path / "b", quiet).summary
    )
    assert (summary.method, "static-not-used" in {remark.code for remark in summary.warnings}) == ("smoother", False)
