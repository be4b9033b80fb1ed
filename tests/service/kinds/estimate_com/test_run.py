"""``estimate-com`` on a recording whose truth is known (the shipped sample), and on broken variants of it."""

from dataclasses import replace
from pathlib import Path

import ezc3d
import numpy as np
import pyarrow.parquet as pq
import pytest
from pydantic import ValidationError

from stridelab.errors import InvalidInput, NotEstimable, StridelabError
from stridelab.estimation.smoother.noise_levels import MAY_BE_ZERO
from stridelab.pipelines.estimate_com import build_smoother
from stridelab.recordings.files.c3d_writer import write_c3d
from stridelab.recordings.reader import read_recording
from stridelab.schemas.jobs import EstimateComInput, EstimateComSummary, SmootherOptions, StatedErrors
from stridelab.schemas.recordings import PlateSwitch, SubjectFields
from stridelab.schemas.tasks import RecordingSource
from stridelab.service.kinds.estimate_com import run as estimate_com
from stridelab.service.kinds.provenance import known_references
from stridelab.service.kinds.result_tables import read_metadata
from stridelab.service.processes.child import with_json
from stridelab.simulation.truth_table import com_errors_mm
from support.command_line import SAMPLE, RecordedProgress, estimate_task, quiet

TRIAL = SAMPLE / "recording.c3d"
AXES = "xyz"


def columns(table: Path, *names: str) -> np.ndarray:
    read = pq.read_table(table)
    return np.column_stack([read[name].to_numpy() for name in names])


def summary_of(folder: Path, **options: object) -> EstimateComSummary:
    outcome = estimate_com.run(estimate_task(TRIAL, folder, **options), folder, quiet)
    return EstimateComSummary.model_validate(outcome.summary)


def filtered(folder: Path, **options: object) -> EstimateComSummary:
    """By the complementary filter, which takes least time."""
    return summary_of(folder, method="complementary", **options)


@pytest.fixture(scope="module")
def result(
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[Path, EstimateComSummary, tuple[str, ...], RecordedProgress]:
    folder, progress = tmp_path_factory.mktemp("result"), RecordedProgress()
    outcome = estimate_com.run(estimate_task(TRIAL, folder, latency="apply"), folder, progress)
    assert {a.name for a in outcome.artifacts} == {"com.parquet", "com.csv", "com.c3d"}
    assert {p.name for p in folder.iterdir()} == {"trial", *(a.name for a in outcome.artifacts)}
    return folder, EstimateComSummary.model_validate(outcome.summary), outcome.references, progress


def test_the_error_against_the_truth_is_that_of_the_table(result) -> None:  # type: ignore[no-untyped-def]
    """The table's error here is 20 % per segment; no estimator may make it worse by more than 1 mm per axis."""
    errors = com_errors_mm(result[0] / "com.parquet", SAMPLE / "truth.parquet")
    assert max(errors["markers only"]) < 10.0
    for fused, geometry in zip(errors["fused"], errors["markers only"], strict=True):
        assert fused < geometry + 1.0


def test_the_injected_latency_is_estimated_and_removed_by_default(result, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    summary = result[1]
    assert summary.latency_s == pytest.approx(0.012, abs=0.003)
    assert summary.latency_applied_s == summary.latency_s
    assert summary.latency_along_s == pytest.approx(0.012, abs=0.006)
    assert summary.latency_vertical_s == pytest.approx(0.012, abs=0.006)
    assert [w.code for w in summary.warnings if w.code.startswith("latency")] == ["latency-applied"]
    by_default = filtered(tmp_path / "default")
    assert by_default.latency_applied_s == summary.latency_applied_s
    reported = filtered(tmp_path / "a", latency="report")
    assert reported.latency_s == pytest.approx(summary.latency_s)
    assert reported.latency_applied_s == 0.0
    assert "latency-not-applied" in {w.code for w in reported.warnings}
    stated = filtered(tmp_path / "b", latency=0.005)
    assert stated.latency_applied_s == 0.005
    assert "latency-applied" in {w.code for w in stated.warnings}


def test_the_force_is_that_of_the_truth_inside_the_window_and_missing_outside(result) -> None:  # type: ignore[no-untyped-def]
    folder, summary, _, _ = result
    force = columns(folder / "com.parquet", *(f"force_{a}_n" for a in AXES))
    true = columns(SAMPLE / "truth.parquet", *(f"f{a}_n" for a in AXES))
    complete = pq.read_table(folder / "com.parquet")["complete"].to_numpy()
    time_s = columns(folder / "com.parquet", "time_s")[:, 0]
    assert np.isnan(force[~complete]).all()
    assert np.sqrt(np.mean((force - true)[complete] ** 2)) < 20.0
    assert time_s[complete].min() == pytest.approx(summary.window_s[0], abs=0.011)
    assert time_s[complete].max() == pytest.approx(summary.window_s[1], abs=0.011)


def test_the_third_input_is_the_foot_of_the_perpendicular_on_the_central_axis(result) -> None:  # type: ignore[no-untyped-def]
    """From the geometry straight to the axis; and against the truth, the axis meets the floor where the plates are
    pressed (nearly: the free moment shifts it by its lever)."""
    folder, _, _, _ = result
    read = {name: columns(folder / "com.parquet", *(f"{name}_{a}_{u}" for a in AXES)) for name, u in _INPUTS}
    complete = pq.read_table(folder / "com.parquet")["complete"].to_numpy()
    assert (np.isfinite(read["axis"]).all(axis=1) == complete).all()
    f, p, g = (read[name][complete] for name in ("force", "axis", "geometry"))
    n = f / np.linalg.norm(f, axis=1, keepdims=True)
    assert np.abs(np.einsum("ij,ij->i", g - p, n)).max() < 1e-9
    true = columns(SAMPLE / "truth.parquet", *(f"f{a}_n" for a in AXES), *(f"m{a}_nm" for a in AXES))[complete]
    on_floor = p + n * (-p[:, 2:] / n[:, 2:])
    pressure = np.column_stack([-true[:, 4], true[:, 3]]) / true[:, 2:3]
    assert np.sqrt(np.mean((on_floor[:, :2] - pressure) ** 2)) < 0.01


_INPUTS = (("force", "n"), ("axis", "m"), ("geometry", "m"))


def test_velocity_and_acceleration_are_derivatives_of_the_position(result) -> None:  # type: ignore[no-untyped-def]
    folder = result[0]
    read = {name: columns(folder / "com.parquet", *(f"{name}{a}_{u}" for a in AXES)) for name, u in _KINDS}
    inside = np.isfinite(read[""]).all(axis=1)
    x, v, a = (read[name][inside] for name in ("", "v", "a"))
    rate_hz = result[1].rate_hz
    assert np.sqrt(np.mean((np.gradient(x, axis=0) * rate_hz - v)[5:-5] ** 2)) < 0.02
    assert np.sqrt(np.mean((np.gradient(v, axis=0) * rate_hz - a)[5:-5] ** 2)) < 0.5
    sd = columns(folder / "com.parquet", *(f"sd_{a}_m" for a in AXES))
    assert (np.isfinite(sd).all(axis=1) == inside).all()
    assert (sd[inside] > 0).all()


_KINDS = (("", "m"), ("v", "m_s"), ("a", "m_s2"))


def test_the_geometry_covers_the_whole_recording(result) -> None:  # type: ignore[no-untyped-def]
    geometry = columns(result[0] / "com.parquet", *(f"geometry_{a}_m" for a in AXES))
    assert np.isfinite(geometry).all()
    assert len(geometry) == 400


def test_the_c3d_is_the_upload_with_two_more_points(result) -> None:  # type: ignore[no-untyped-def]
    before, after = ezc3d.c3d(str(TRIAL)), ezc3d.c3d(str(result[0] / "com.c3d"))
    labels = after["parameters"]["POINT"]["LABELS"]["value"]
    known = before["parameters"]["POINT"]["LABELS"]["value"]
    assert labels == [*known, "COM", "COM_GEOMETRY"]
    np.testing.assert_array_equal(after["data"]["points"][:, : len(known)], before["data"]["points"])
    np.testing.assert_array_equal(after["data"]["analogs"], before["data"]["analogs"])
    fused = columns(result[0] / "com.parquet", "x_m", "y_m", "z_m")
    np.testing.assert_allclose(after["data"]["points"][:3, len(known)].T / 1000.0, fused, atol=1e-6)


def test_a_result_has_provenance(result) -> None:  # type: ignore[no-untyped-def]
    folder, summary, references, progress = result
    about = read_metadata(folder / "com.parquet")
    assert about["provenance"]["file"] == "recording.c3d"
    assert about["provenance"]["summary"]["method"] == summary.method == "smoother"
    assert set(references) <= known_references()
    assert {"carpentier2017thesis", "dumas2007"} <= set(references)
    assert progress.fractions[-1] == 1.0
    assert len(progress.messages) >= 5


def test_the_observability_is_that_of_walking(result) -> None:  # type: ignore[no-untyped-def]
    observability = result[1].observability
    assert (observability["rank_force"], observability["rank_with_geometry"]) == (7, 11)
    assert observability["unobservable"][2] > 0.99
    assert 0.05 < observability["tilt_rad"] < 0.5
    assert observability["flight_s"] == 0.0
    assert "the height comes from the markers" in observability["sentence"]


def test_the_direction_that_the_force_cannot_see_is_given_over_time(result) -> None:  # type: ignore[no-untyped-def]
    """It is the direction of the contact force: two sources, the estimate's acceleration and the plates."""
    folder = result[0]
    n = columns(folder / "com.parquet", *(f"unobservable_{a}" for a in AXES))
    force = columns(folder / "com.parquet", *(f"force_{a}_n" for a in AXES))
    inside = np.isfinite(force).all(axis=1)
    assert (np.isfinite(n).all(axis=1) == inside).all()
    np.testing.assert_allclose(np.linalg.norm(n[inside], axis=1), 1.0)
    along = force[inside] / np.linalg.norm(force[inside], axis=1, keepdims=True)
    apart_deg = np.degrees(np.arccos(np.clip((n[inside] * along).sum(axis=1), -1, 1)))
    assert np.median(apart_deg) < 1.5
    assert apart_deg.max() < 6.0  # at a strike the force has frequencies that a CoM from markers has not
    ranks = columns(folder / "com.parquet", "rank_force", "rank_with_geometry")
    assert np.isnan(ranks[~inside]).all()
    assert np.unique(ranks[inside], axis=0).tolist() == [[7.0, 11.0]]
    assert read_metadata(folder / "com.parquet")["units"]["unobservable_x"] == "1"


def test_a_users_statement_wins_over_the_file_but_not_over_the_plates(tmp_path: Path) -> None:
    stated = filtered(tmp_path / "a", subject=SubjectFields(mass_kg=62.0))
    assert (stated.mass_kg, stated.mass_source) == (62.0, "stated")
    assert filtered(tmp_path / "b").mass_source == "file"
    assert stated.mass_from_force_kg == pytest.approx(60.0, rel=0.02)
    heavy = filtered(tmp_path / "c", subject=SubjectFields(mass_kg=70.0))
    (message,) = (w.message for w in heavy.warnings if w.code == "mass-disagrees-with-force")
    assert "70 kg" in message
    assert f"{heavy.mass_from_force_kg:.1f} ± " in message
    assert heavy.mass_source == "force"
    assert {known.source for known in heavy.masses} == {"stated", "impulse"}


def test_geometry_alone_needs_no_plates(tmp_path: Path) -> None:
    task = estimate_task(TRIAL, tmp_path, method="geometry")
    unplugged = task.recording.model_copy(update={"plates": {1: PlateSwitch(use=False), 2: PlateSwitch(use=False)}})
    outcome = estimate_com.run(task.model_copy(update={"recording": unplugged}), tmp_path, quiet)
    summary = EstimateComSummary.model_validate(outcome.summary)
    assert summary.window_s == pytest.approx((0.0, 3.99))
    assert summary.rms_force_residual_n == []
    assert summary.latency_s is None
    table = pq.read_table(tmp_path / "com.parquet")
    np.testing.assert_allclose(table["x_m"].to_numpy(), table["geometry_x_m"].to_numpy(), atol=1e-12)
    assert np.isnan(table["force_z_n"].to_numpy()).all()
    assert np.isnan(table["axis_x_m"].to_numpy()).all()
    assert not table["complete"].to_numpy().any()


def test_cutoffs_and_window_are_those_requested(tmp_path: Path) -> None:
    whole = filtered(tmp_path / "a")
    start_s, end_s = whole.window_s
    part = filtered(tmp_path / "b", window_s=(start_s + 0.1, end_s - 0.1))
    assert part.window_s == pytest.approx((start_s + 0.1, end_s - 0.1))
    thesis, wide = filtered(tmp_path / "c", cutoffs="thesis"), filtered(tmp_path / "d", cutoffs=(0.2, 1.0))
    assert thesis.bias_m != wide.bias_m


def test_the_best_method_is_the_default(tmp_path: Path) -> None:
    """Cut-offs ask for the filter, which alone has them; options of the smoother ask for the smoother."""
    assert summary_of(tmp_path / "a").method == "smoother"
    assert summary_of(tmp_path / "b", cutoffs="thesis").method == "complementary"
    assert summary_of(tmp_path / "c", smoother={"learn": False}).method == "smoother"
    assert summary_of(tmp_path / "d", method="rts").method == "rts"


def test_if_the_best_method_refuses_another_is_used_with_a_remark(tmp_path: Path) -> None:
    """A window without a whole single support: the smoother refuses it, and so does the job where it was named."""
    short = {"window_s": (2.1, 2.52), "latency": "report"}
    summary = summary_of(tmp_path / "a", **short)
    assert summary.method == "complementary"
    (message,) = (w.message for w in summary.warnings if w.code == "best-method-refused")
    assert "single support" in message
    for k, named in enumerate(({"method": "smoother"}, {"smoother": {}})):
        with pytest.raises(NotEstimable) as refusal:
            summary_of(tmp_path / str(k), **short, **named)
        assert refusal.value.code == "no-single-support"
    plain = summary_of(tmp_path / "b", method="complementary", **short)
    assert plain.bias_m == summary.bias_m
    assert all(w.code != "best-method-refused" for w in plain.warnings)


def test_stated_errors_are_used_by_the_smoother_and_learned_ones_reported(tmp_path: Path) -> None:
    usual = summary_of(tmp_path / "a")
    assert {"marker_mm", "step_hz", "plate_bias_statistic"} <= usual.diagnostics.keys()
    assert usual.diagnostics["step_hz"] == pytest.approx(1.75, abs=0.1)
    stated = {"marker_m": 0.003, "step_hz": 1.6, "momentum_m_s": (0.001, 0.004)}
    diagnostics = summary_of(tmp_path / "b", smoother={"learn": False, "priors": stated}).diagnostics
    assert diagnostics["marker_mm"] == pytest.approx(3.0)
    assert diagnostics["step_hz"] == 1.6
    assert usual.mass_kg is not None
    weight_n = 9.81 * usual.mass_kg
    assert diagnostics["momentum_about_walk_nms"] == pytest.approx(0.001 * weight_n, rel=0.01)
    assert diagnostics["momentum_about_side_nms"] == pytest.approx(0.004 * weight_n, rel=0.01)
    required = {"learn": False, "priors": stated, "segment_momentum": True}
    rest = summary_of(tmp_path / "c", smoother=required).diagnostics
    assert rest["momentum_about_side_nms"] == pytest.approx(0.6 * diagnostics["momentum_about_side_nms"])


def test_a_plate_bias_beyond_the_declared_one_is_remarked(tmp_path: Path) -> None:
    """Loaded plates that add 10 N ahead contradict a declared bias of 1 N, and not one of 20 N."""
    recording = read_recording(TRIAL)
    plates = tuple(
        replace(plate, force_n=plate.force_n + np.outer(plate.loaded, [10.0, 0.0, 0.0])) for plate in recording.plates
    )
    write_c3d(tmp_path / "biased.c3d", replace(recording, plates=plates))
    for k, (declared_n, doubted) in enumerate(((1.0, True), (20.0, False))):
        options = {"priors": {"plate_force_n": declared_n}}
        outcome = estimate_com.run(
            estimate_task(tmp_path / "biased.c3d", tmp_path / str(k), smoother=options), tmp_path / str(k), quiet
        )
        assert ("undeclared-plate-bias" in {w["code"] for w in outcome.summary["warnings"]}) == doubted


@pytest.mark.parametrize(
    "priors",
    [
        {"marker_m": 0.0},
        {"plate_force_n": -1.0},
        {"clock_s": float("nan")},
        {"step_hz": 0.0},
        {"momentum_m_s": (0.001, 0.0)},
        {"moment_nm": float("inf")},
        {"wind": 1.0},
    ],
)
def test_an_error_that_no_input_can_have_is_refused_naming_it(priors: dict[str, object]) -> None:
    with pytest.raises(ValidationError) as refused:
        EstimateComInput.model_validate({"recording_id": "r", "smoother": {"priors": priors}})
    assert {error["loc"][:3] for error in refused.value.errors()} == {("smoother", "priors", *priors)}


@pytest.mark.parametrize("method", ["complementary", "kalman", "rts", "geometry"])
def test_options_of_the_smoother_are_refused_for_other_methods(method: str) -> None:
    with pytest.raises(ValidationError, match=f"the {method} estimator does not use them") as refused:
        EstimateComInput.model_validate({"recording_id": "r", "method": method, "smoother": {}})
    assert [error["loc"] for error in refused.value.errors()] == [("smoother",)]


@pytest.mark.parametrize("name", StatedErrors.model_fields)
def test_every_error_that_can_be_stated_is_one_of_the_smoother(name: str) -> None:
    """And what the contract lets pass the smoother takes: zero where it is no error at all, else very little."""
    least = {"momentum_m_s": (1e-9, 1e-9), "step_hz": 0.1} | dict.fromkeys(MAY_BE_ZERO, 0.0)
    low = least.get(name, 1e-9)
    stated = StatedErrors.model_validate({name: low})
    assert getattr(build_smoother(SmootherOptions(priors=stated)).priors, name) == low


def test_a_table_can_be_chosen(tmp_path: Path) -> None:
    assert filtered(tmp_path / "a").segment_table == "carried"
    assert filtered(tmp_path / "b", segment_table="dumas2007").segment_table == "dumas2007"


@pytest.mark.parametrize(
    ("options", "kind", "code"),
    [
        ({"method": "kalman", "cutoffs": (0.2, 1.0)}, InvalidInput, "cutoffs-not-used"),
        ({"method": "smoother", "cutoffs": "thesis"}, InvalidInput, "cutoffs-not-used"),
        ({"method": "smoother", "cutoffs": (0.2, 1.0)}, InvalidInput, "cutoffs-not-used"),
        ({"method": "geometry", "cutoffs": "thesis"}, InvalidInput, "cutoffs-not-used"),
        ({"smoother": {}, "cutoffs": "thesis"}, InvalidInput, "cutoffs-not-used"),
        ({"method": "smoother", "window_s": (1.9, 2.15)}, NotEstimable, "window-too-short"),
        ({"window_s": (0.0, 1.0)}, InvalidInput, "window-not-measured"),
        ({"window_s": (3.5, 9.0)}, InvalidInput, "window-outside-recording"),
        ({"window_s": (2.6, 1.95)}, InvalidInput, "window-outside-recording"),
        ({"cutoffs": (4.0, 0.4)}, InvalidInput, "cutoffs-out-of-range"),
        ({"cutoffs": (0.2, 60.0)}, InvalidInput, "cutoffs-out-of-range"),
        ({"cutoffs": (0.0, 1.0)}, InvalidInput, "cutoffs-out-of-range"),
        ({"subject": SubjectFields(mass_kg=300.0)}, InvalidInput, "mass-contradicts-force"),
    ],
)
def test_a_refusal_leaves_no_artifact(
    tmp_path: Path, options: dict[str, object], kind: type[StridelabError], code: str
) -> None:
    with pytest.raises(kind) as refusal:
        summary_of(tmp_path, **options)
    assert refusal.value.code == code
    assert [p.name for p in tmp_path.iterdir()] == ["trial"]


def without_labels(target: Path) -> None:
    content = ezc3d.c3d(str(TRIAL))
    labels = content["parameters"]["POINT"]["LABELS"]["value"]
    content["parameters"]["POINT"]["LABELS"]["value"] = [f"Q{i}" for i in range(len(labels))]
    content.write(str(target))


def test_unknown_labels_are_refused_with_the_labels_of_the_file(tmp_path: Path) -> None:
    without_labels(tmp_path / "odd.c3d")
    folder = tmp_path / "task"
    with pytest.raises(NotEstimable) as refusal:
        estimate_com.run(estimate_task(tmp_path / "odd.c3d", folder), folder, quiet)
    assert refusal.value.code == "unknown-marker-set"
    assert any("Q0, Q1, Q2" in fault.message for fault in refusal.value.faults)


def test_a_static_trial_is_read_and_used(tmp_path: Path) -> None:
    """The trial serves as its own static trial: nothing may change."""
    task = estimate_task(TRIAL, tmp_path / "a", method="complementary")
    (tmp_path / "a" / "static").write_bytes(TRIAL.read_bytes())
    with_static = task.model_copy(update={"static": RecordingSource(file="static", filename="static.c3d")})
    one = EstimateComSummary.model_validate(estimate_com.run(with_static, tmp_path / "a", quiet).summary)
    assert one.bias_m == pytest.approx(filtered(tmp_path / "b").bias_m, abs=1e-4)


def test_a_damaged_static_trial_is_named(tmp_path: Path) -> None:
    task = estimate_task(TRIAL, tmp_path)
    (tmp_path / "static").write_bytes(b"")
    with_static = task.model_copy(update={"static": RecordingSource(file="static", filename="standing 1.c3d")})
    with pytest.raises(StridelabError) as refusal:
        estimate_com.run(with_static, tmp_path, quiet)
    assert refusal.value.faults[0].where == "standing 1.c3d"


def test_task_and_outcome_of_the_child_are_json(tmp_path: Path) -> None:
    task = estimate_task(TRIAL, tmp_path)
    outcome = with_json(estimate_com.run)(task.model_dump(mode="json"), tmp_path, quiet)
    assert set(outcome) == {"summary", "references", "artifacts"}
