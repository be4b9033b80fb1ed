"""``fit-cycloid`` on the shipped sample: summary, tables and what is refused."""

import shutil
from pathlib import Path

import numpy as np
import pyarrow.csv
import pyarrow.parquet as pq
import pytest
from pydantic import ValidationError

from stridelab.errors import InvalidInput, NotEstimable
from stridelab.pipelines.fit_cycloid import fit_cycloid_of_recording
from stridelab.schemas.cycloid import FitCycloidInput, FitCycloidSummary, FitCycloidTask
from stridelab.schemas.jobs import SimulateRecordingInput
from stridelab.schemas.recordings import PlateSwitch, SubjectFields
from stridelab.schemas.tasks import RecordingSource, SimulateRecordingTask
from stridelab.service.kinds.fit_cycloid import run as fit_cycloid
from stridelab.service.kinds.provenance import known_references
from stridelab.service.kinds.result_tables import read_metadata
from stridelab.service.kinds.simulate_recording import run as simulate_recording
from stridelab.service.processes.child import with_json
from support.command_line import SAMPLE, RecordedProgress, quiet

TRIAL = SAMPLE / "recording.c3d"
DECLARED = (
    *("time_s", "step", "x_ahead_m", "z_m", "theta_rad", "hub_x_m", "hub_z_m", "model_x_m", "model_z_m", "error_x_m"),
    *("error_z_m", "x_m", "y_m", "hub_world_x_m", "hub_world_y_m"),
)


def task(
    folder: Path, file: Path = TRIAL, plates: dict[int, PlateSwitch] | None = None, **options: object
) -> FitCycloidTask:
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(file, folder / "trial")
    source = RecordingSource(file="trial", filename=file.name, subject=SubjectFields(), plates=plates or {})
    return FitCycloidTask(recording=source, input=FitCycloidInput.model_validate({"recording_id": "r", **options}))


def summary_of(folder: Path, **options: object) -> FitCycloidSummary:
    return fit_cycloid_of_recording(task(folder, **options), folder, quiet).summary  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def fitted(
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[Path, FitCycloidSummary, tuple[str, ...], RecordedProgress]:
    folder, progress = tmp_path_factory.mktemp("wheel"), RecordedProgress()
    outcome = fit_cycloid.run(task(folder), folder, progress)
    assert [a.name for a in outcome.artifacts] == ["steps.parquet", "steps.csv", "wheel.parquet", "wheel.csv"]
    assert {p.name for p in folder.iterdir()} == {"trial", *(a.name for a in outcome.artifacts)}
    return folder, FitCycloidSummary.model_validate(outcome.summary), outcome.references, progress


@pytest.fixture(scope="module")
def walkway(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every footprint on a plate of its own, so that many steps are measured."""
    folder = tmp_path_factory.mktemp("walkway")
    simulation = SimulateRecordingInput(duration_s=4.0, lab="walkway", seed=3)
    simulate_recording.run(SimulateRecordingTask(input=simulation), folder, quiet)
    return folder / "recording.c3d"


def test_the_step_on_the_plates_is_that_of_the_simulated_walk(fitted) -> None:  # type: ignore[no-untyped-def]
    """The walk was made with 0.57 s and 0.69 m per step at 1.2 m/s, and 0.12 s of double support."""
    (step,) = fitted[1].steps
    assert step.measured
    assert step.source == "mixed"
    assert step.period_s == pytest.approx(0.57, abs=0.02)
    assert step.step_length_m == pytest.approx(0.69, abs=0.03)
    assert step.speed_m_s == pytest.approx(1.21, abs=0.05)
    start_s, end_s = step.double_support_s
    assert end_s - start_s == pytest.approx(0.12, abs=0.04)
    assert step.t0_s <= step.fitted_s[0] < step.fitted_s[1] <= step.t1_s


def test_the_wheel_fits_and_its_figures_agree(fitted) -> None:  # type: ignore[no-untyped-def]
    summary = fitted[1]
    (step,) = summary.steps
    assert step.error_mean_mm < 1.5
    assert step.error_mean_mm <= step.error_max_mm
    assert 0.0 < step.r_m < step.R_m
    assert step.circumference_share == pytest.approx(2 * np.pi * step.R_m / step.step_length_m)
    assert {(r.space, r.model) for r in step.rivals} >= {
        ("path", "wheel"),
        ("path", "sinusoid"),
        ("time", "wheel-reversed"),
    }
    assert step.timed.error_mean_mm > step.error_mean_mm
    assert summary.step_to_step_sd is not None
    assert summary.step_to_step_sd.between == "overlapping-steps"
    assert summary.step_to_step_sd.n == 1 + len(summary.overlapping)
    assert summary.ahead == pytest.approx((1.0, 0.0), abs=0.02)
    assert summary.steps_left_out > 0
    assert [w.code for w in summary.warnings].count("one-step") == 1


def test_the_table_of_samples_is_the_wheel(fitted) -> None:  # type: ignore[no-untyped-def]
    """Model minus measurement is the error, the model is r from the hub, and the hub is at z0 and beside the CoM."""
    folder, summary, *_ = fitted
    table = pq.read_table(folder / "wheel.parquet")
    assert tuple(table.column_names) == DECLARED
    c = {name: table[name].to_numpy() for name in DECLARED}
    (step,) = summary.steps
    np.testing.assert_allclose(c["model_x_m"] - c["x_ahead_m"], c["error_x_m"], atol=1e-12)
    np.testing.assert_allclose(c["model_z_m"] - c["z_m"], c["error_z_m"], atol=1e-12)
    radius = np.hypot(c["model_x_m"] - c["hub_x_m"], c["model_z_m"] - c["hub_z_m"])
    np.testing.assert_allclose(radius, step.r_m, rtol=1e-9)
    np.testing.assert_allclose(c["hub_z_m"], step.z0_m, rtol=1e-12)
    assert 1e3 * np.hypot(c["error_x_m"], c["error_z_m"]).mean() == pytest.approx(step.error_mean_mm)
    ahead = np.array(summary.ahead) / np.linalg.norm(summary.ahead)
    away = np.column_stack([c["hub_world_x_m"] - c["x_m"], c["hub_world_y_m"] - c["y_m"]])
    np.testing.assert_allclose(away, np.outer(c["hub_x_m"] - c["x_ahead_m"], ahead), atol=1e-9)
    assert step.fitted_s == pytest.approx((c["time_s"][0], c["time_s"][-1]))


def test_the_table_of_steps_is_the_summary(fitted) -> None:  # type: ignore[no-untyped-def]
    folder, summary, references, progress = fitted
    (row,) = pq.read_table(folder / "steps.parquet").to_pylist()
    (step,) = summary.steps
    for name in ("t0_s", "R_m", "r_m", "z0_m", "omega_rad_s", "error_mean_mm", "step_length_m", "speed_m_s"):
        assert row[name] == pytest.approx(getattr(step, name))
    assert row["sd_R_m"] == pytest.approx(step.sd.R_m)
    assert row["reversed_r_m"] == pytest.approx(step.reversed.r_m)
    assert row["double_support_end_s"] == pytest.approx(step.double_support_s[1])
    assert row["flags"].split() == sorted(step.flags)
    assert pyarrow.csv.read_csv(folder / "steps.csv").column_names == list(row)
    about = read_metadata(folder / "steps.parquet")
    assert about["units"]["omega_rad_s"] == "rad/s"
    assert about["provenance"]["summary"]["steps"] == [step.model_dump(mode="json")]
    assert set(references) <= known_references()
    assert progress.fractions[-1] == 1.0


def test_many_steps_scatter_by_themselves(walkway: Path, tmp_path: Path) -> None:
    summary = summary_of(tmp_path, file=walkway)
    assert len(summary.steps) >= 4
    assert all(step.measured for step in summary.steps)
    assert [step.t0_s for step in summary.steps] == sorted(step.t0_s for step in summary.steps)
    assert summary.step_to_step_sd is not None
    assert summary.step_to_step_sd.between == "steps"
    assert summary.step_to_step_sd.R_m == pytest.approx(np.std([s.R_m for s in summary.steps], ddof=1))
    assert "one-step" not in [w.code for w in summary.warnings]
    lasts_s = [s.double_support_s[1] - s.double_support_s[0] for s in summary.steps]
    assert lasts_s == pytest.approx([0.12] * len(lasts_s), abs=0.04)


def test_all_steps_are_more_and_are_marked_as_not_measured(tmp_path: Path) -> None:
    summary = summary_of(tmp_path, steps="all")
    assert len(summary.steps) >= 4
    assert sum(step.measured for step in summary.steps) == 1


def test_the_geometry_alone_and_the_filter_fit_it_too(tmp_path: Path) -> None:
    geometry = summary_of(tmp_path / "geometry", method="geometry")
    assert geometry.method == "geometry"
    filtered = summary_of(tmp_path / "filter", method="complementary")
    assert filtered.method == "complementary"
    assert filtered.steps[0].R_m == pytest.approx(geometry.steps[0].R_m, rel=0.5)


def test_one_plate_is_refused_with_its_steps(tmp_path: Path) -> None:
    with pytest.raises(NotEstimable, match="Feet stood on plate 1 only") as caught:
        summary_of(tmp_path, plates={2: PlateSwitch(use=False)}, method="complementary")
    assert caught.value.code == "one-plate-only"


def test_standing_without_any_force_is_reported_before_missing_plates(tmp_path: Path) -> None:
    simulation = SimulateRecordingInput(duration_s=2.0, speed_m_s=0.0, seed=5)
    simulate_recording.run(SimulateRecordingTask(input=simulation), tmp_path, quiet)
    off = {index: PlateSwitch(use=False) for index in (1, 2, 3, 4)}
    with pytest.raises(NotEstimable) as caught:
        summary_of(tmp_path / "fit", file=tmp_path / "recording.c3d", plates=off)
    assert caught.value.code == "standing"


def test_walking_without_plates_needs_them_or_the_geometry(tmp_path: Path) -> None:
    off = {index: PlateSwitch(use=False) for index in (1, 2)}
    with pytest.raises(NotEstimable) as caught:
        summary_of(tmp_path / "forceless", plates=off)
    assert caught.value.code == "plates-switched-off"
    assert len(summary_of(tmp_path / "markers", plates=off, method="geometry").steps) >= 4


def test_a_window_that_holds_no_step_and_values_that_make_no_sense(tmp_path: Path) -> None:
    with pytest.raises(NotEstimable) as caught:
        summary_of(tmp_path / "short", window_s=(1.9, 2.35), method="complementary")
    assert caught.value.code == "no-measured-step"
    with pytest.raises(InvalidInput):
        summary_of(tmp_path / "outside", window_s=(90.0, 91.0))
    with pytest.raises(ValidationError):
        FitCycloidInput.model_validate({"recording_id": "r", "steps": "some"})


def test_task_and_outcome_of_the_fit_are_json(tmp_path: Path) -> None:
    staged = task(tmp_path, method="complementary")
    outcome = with_json(fit_cycloid.run)(staged.model_dump(mode="json"), tmp_path, quiet)
    assert FitCycloidSummary.model_validate(outcome["summary"]).method == "complementary"
