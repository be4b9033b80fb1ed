"""``compare-estimators`` on the shipped sample, whose truth is known, and without it."""

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from stridelab.errors import InvalidInput, UnreadableFile
from stridelab.schemas.comparison import CompareEstimatorsInput, CompareEstimatorsSummary, CompareEstimatorsTask
from stridelab.schemas.methods import METHODS
from stridelab.service.kinds.compare_estimators import run as compare_estimators
from stridelab.service.kinds.estimate_com import run as estimate_com
from stridelab.service.kinds.provenance import known_references
from stridelab.service.kinds.result_tables import read_metadata
from stridelab.simulation.truth_table import com_errors_mm, known_motion
from support.command_line import SAMPLE, RecordedProgress, estimate_task, quiet

TRIAL, TRUTH = SAMPLE / "recording.c3d", SAMPLE / "truth.parquet"
TABLES = ("comparison", "spectra", "contributions", "bode")


def task(folder: Path, *, truth: bool = True, **options: object) -> CompareEstimatorsTask:
    staged = estimate_task(TRIAL, folder, **options)
    if truth:
        (folder / "truth.parquet").write_bytes(TRUTH.read_bytes())
    return CompareEstimatorsTask(
        recording=staged.recording,
        static=staged.static,
        input=CompareEstimatorsInput.model_validate(staged.input.model_dump()),
        truth="truth.parquet" if truth else None,
    )


def columns(table: Path, pattern: str) -> np.ndarray:
    read = pq.read_table(table)
    return np.column_stack([read[pattern.format(axis)].to_numpy() for axis in "xyz"])


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, CompareEstimatorsSummary]:
    folder, progress = tmp_path_factory.mktemp("compared"), RecordedProgress()
    outcome = compare_estimators.run(task(folder, latency="apply"), folder, progress)
    assert progress.fractions[-1] == 1.0
    assert [a.name for a in outcome.artifacts] == [f"{t}.{kind}" for t in TABLES for kind in ("parquet", "csv")]
    assert set(outcome.references) <= known_references()
    return folder, CompareEstimatorsSummary.model_validate(outcome.summary)


def test_every_method_of_this_version_is_compared(compared: tuple[Path, CompareEstimatorsSummary]) -> None:
    methods = compared[1].methods
    assert set(METHODS) | {"complementary-thesis"} <= set(methods) | set(compared[1].refused)
    assert compared[1].reference == "truth"
    assert all(comparison.truth is not None for comparison in methods.values())


def test_the_errors_are_those_of_estimate_com(compared: tuple[Path, CompareEstimatorsSummary], tmp_path: Path) -> None:
    """The same recording through the other job, compared with the truth by other code."""
    estimate_com.run(estimate_task(TRIAL, tmp_path, latency="apply", method="complementary"), tmp_path, quiet)
    x, y, z = com_errors_mm(tmp_path / "com.parquet", TRUTH)["fused"]
    error = compared[1].methods["complementary"].truth
    assert error is not None
    assert 1e3 * error.horizontal_m == pytest.approx(np.hypot(x, y), rel=1e-6)
    assert 1e3 * error.vertical_m == pytest.approx(z, rel=1e-6)


def test_the_spectra_hold_the_errors_of_the_tracks(compared: tuple[Path, CompareEstimatorsSummary]) -> None:
    """Parseval: the integral of a spectrum is the mean square of the windowed error."""
    folder, _ = compared
    error = columns(folder / "comparison.parquet", "geometry_{}_m") - columns(
        folder / "comparison.parquet", "truth_{}_m"
    )
    hann = np.hanning(len(error) + 1)[:-1, None] ** 2
    expected = np.sqrt((hann * error**2).sum(axis=0) / hann.sum())
    density = columns(folder / "spectra.parquet", "geometry_{}_m_rthz")
    resolution_hz = np.diff(pq.read_table(folder / "spectra.parquet")["frequency_hz"].to_numpy())[0]
    assert np.sqrt((density**2).sum(axis=0) * resolution_hz) == pytest.approx(expected, rel=0.02)
    units = read_metadata(folder / "spectra.parquet")["units"]
    assert units["geometry_x_m_rthz"] == "m/sqrt(Hz)"
    assert units["input_force_x_m_s2_rthz"] == "m/s^2/sqrt(Hz)"


def test_the_contributions_add_up_to_the_filter(compared: tuple[Path, CompareEstimatorsSummary]) -> None:
    folder = compared[0]
    parts = [columns(folder / "contributions.parquet", f"{part}_{{}}_m") for part in ("geometry", "force", "axis")]
    fused = columns(folder / "comparison.parquet", "complementary_{}_m")
    assert np.sum(parts, axis=0) == pytest.approx(fused, abs=1e-9)
    bode = pq.read_table(folder / "bode.parquet")
    gains = np.column_stack([bode[f"{part}_gain_db"].to_numpy() for part in ("geometry", "force", "axis")])
    assert gains[0].argmax() == 2, "the axis speaks at the lowest frequencies"
    assert gains[-1].argmax() == 1, "the force at the highest"


def test_without_a_truth_methods_are_scored_by_physics(tmp_path: Path) -> None:
    outcome = compare_estimators.run(task(tmp_path, truth=False, method="complementary"), tmp_path, quiet)
    summary = CompareEstimatorsSummary.model_validate(outcome.summary)
    assert summary.reference == "geometry"
    assert set(summary.methods) == {"geometry", "complementary"}
    fused = summary.methods["complementary"]
    assert fused.truth is None
    assert fused.flight is None
    assert fused.standing_m is None
    assert fused.momentum_rate is not None
    assert fused.momentum_rate.correlation.lateral is not None
    assert fused.momentum_rate.correlation.lateral > 0.8
    assert fused.held_back_n is not None
    assert "truth_x_m" not in pq.read_schema(tmp_path / "comparison.parquet").names


def test_own_cutoffs_are_for_the_filter_only(tmp_path: Path) -> None:
    outcome = compare_estimators.run(task(tmp_path, cutoffs=(0.3, 2.0)), tmp_path, quiet)
    summary = CompareEstimatorsSummary.model_validate(outcome.summary)
    assert set(METHODS) <= set(summary.methods) | set(summary.refused)
    assert "cutoffs-not-used" not in {reason.code for reason in summary.refused.values()}


def test_an_invalid_truth_is_refused(tmp_path: Path) -> None:
    broken = tmp_path / "truth.parquet"
    broken.write_bytes(b"no table")
    with pytest.raises(UnreadableFile) as refusal:
        known_motion(broken, np.arange(100) / 100.0)
    assert refusal.value.code == "truth-unreadable"
    with pytest.raises(InvalidInput) as mismatch:
        known_motion(TRUTH, np.arange(100000) / 100.0)
    assert mismatch.value.code == "truth-mismatch"
