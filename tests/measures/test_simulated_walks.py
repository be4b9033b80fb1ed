"""Measures of a simulated recording beside those of its exact motion, and the job's files."""

import importlib.util
import json
import math
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.compute
import pyarrow.csv
import pytest
from pydantic import ValidationError

import stridelab as sl
from stridelab.errors import NotEstimable, UnreadableFile
from stridelab.pipelines.gait_measures.pooled import gait_measures as measure_members
from stridelab.pipelines.trial import clock_of, event_delays_of
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.measures import GaitMeasuresInput, GaitMeasuresSummary, GaitMeasuresTask, MeasuresMember
from stridelab.schemas.recordings import EventDelays, PlateSwitch, SubjectFields
from stridelab.schemas.tasks import EstimateComTask, RecordingSource
from stridelab.service.kinds.gait_measures import run as gait_measures
from stridelab.simulation.noise import NOISE_FREE
from stridelab.walking.steps import GaitStep
from support.command_line import SAMPLE, quiet
from support.docs.book import ROOT

WORKS = ("positive", "negative")
TRIAL = SAMPLE / "recording.c3d"


def member(folder: Path, file: Path = TRIAL, **source: object) -> MeasuresMember:
    name = f"recording-{len(list(folder.glob('recording-*')))}"
    (folder / name).mkdir()
    shutil.copyfile(file, folder / name / "trial")
    recording = RecordingSource(file="trial", filename=file.name, **source)  # type: ignore[arg-type]
    task = EstimateComTask(recording=recording, input=EstimateComInput(recording_id=name))
    return MeasuresMember(recording_id=name, folder=name, task=task)


def summary_of(folder: Path, *members: MeasuresMember) -> GaitMeasuresSummary:
    outcome = gait_measures.run(GaitMeasuresTask(members=list(members)), folder, quiet)
    return GaitMeasuresSummary.model_validate(outcome.summary)


def compare_walks(lab: str, *seeds: int, exact: bool = False) -> dict[str, np.ndarray]:
    """Rows of value, stated deviation and true value by measure; ``exact`` without noise and with the true events."""
    spec = importlib.util.spec_from_file_location("coverage", ROOT / "scripts" / "make_measures_coverage.py")
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    if exact:
        drawn = script.simulate_walk
        vars(script).update(
            simulate_walk=lambda seed: (drawn(seed)[0], NOISE_FREE),
            events_of_people=lambda contacts, _seed: lambda _r, _l, foot: [c for c in contacts if c.side == foot.side],
        )
    rows: dict[str, list[tuple[float, float, float]]] = {}
    for seed in seeds:
        for name, value, sd, truth in script.compare_walk(seed, lab):
            rows.setdefault(name, []).append((value, np.nan if sd is None else sd, truth))
    return {name: np.array(values) for name, values in rows.items()}


@pytest.fixture(scope="module")
def compared() -> dict[str, np.ndarray]:
    return compare_walks("walkway", 2000, 2001, 2002)


@pytest.fixture(scope="module")
def without_noise() -> dict[str, np.ndarray]:
    return compare_walks("walkway", 2000, 2008, exact=True)


def test_without_noise_the_work_of_every_stance_is_that_of_its_contact_force(
    without_noise: dict[str, np.ndarray],
) -> None:
    """From the file to the measure, segment table and plates included: 1 % at most, 0.2 % as measured."""
    rows = np.concatenate([without_noise[f"limb_work_{s}_{w}"] for s in ("left", "right") for w in WORKS])
    assert len(rows) >= 16
    assert np.abs(rows[:, 0] / rows[:, 2] - 1.0).max() < 0.01


@pytest.mark.parametrize("name", ["ml_min", "ap_contact", "ml_contact"])
def test_without_noise_margins_are_those_of_the_exact_motion(without_noise: dict[str, np.ndarray], name: str) -> None:
    rows = without_noise[f"margin_of_stability_{name}"]
    assert len(rows) >= 8
    assert np.abs(rows[:, 0] - rows[:, 2]).max() < 0.001


@pytest.fixture(scope="module")
def over_two_plates() -> dict[str, np.ndarray]:
    return compare_walks("two_plates", 2001, 2003)


@pytest.mark.parametrize("name", ["margin_of_stability_ml_min", "step_width", "limb_work_left_positive"])
def test_between_two_plates_errors_hold_too(over_two_plates: dict[str, np.ndarray], name: str) -> None:
    rows = over_two_plates[name]
    assert np.mean(np.abs(rows[:, 0] - rows[:, 2]) <= 1.96 * rows[:, 1]) > 0.9


def test_energy_is_not_the_noise_of_a_velocity_without_force(over_two_plates: dict[str, np.ndarray]) -> None:
    """Two plates measure one step: no stride has its force throughout, and none has an energy."""
    assert "margin_of_stability_ml_min" in over_two_plates
    assert not {"energy_recovery", "external_work"} & set(over_two_plates)


def test_stated_errors_hold_the_true_values(compared: dict[str, np.ndarray]) -> None:
    """Every step that counts, over all measures; a deviation that is half as wide as the errors would miss many."""
    rows = np.concatenate(list(compared.values()))
    assert len(rows) > 300
    assert np.isfinite(rows).all()
    assert np.mean(np.abs(rows[:, 0] - rows[:, 2]) <= 1.96 * rows[:, 1]) > 0.93


@pytest.mark.parametrize(
    ("name", "most"),
    [
        ("margin_of_stability_ml_min", 0.004),
        ("margin_of_stability_ap_contact", 0.010),
        ("step_length", 0.004),
        ("step_time", 0.006),
        ("double_support_share", 0.01),
    ],
)
def test_measures_are_near_the_truth(compared: dict[str, np.ndarray], name: str, most: float) -> None:
    assert np.abs(compared[name][:, 0] - compared[name][:, 2]).max() < most


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_work_of_the_legs_is_that_of_the_contact_forces(compared: dict[str, np.ndarray], side: str) -> None:
    for sign in ("positive", "negative"):
        rows = compared[f"limb_work_{side}_{sign}"]
        assert rows[:, 0].mean() == pytest.approx(rows[:, 2].mean(), rel=0.03)


def test_the_files_are_a_row_per_value_and_the_extrapolated_com(tmp_path: Path) -> None:
    task = GaitMeasuresTask(members=[member(tmp_path), member(tmp_path, plates={1: PlateSwitch(use=False)})])
    outcome = gait_measures.run(task, tmp_path, quiet)
    names = [artifact.name for artifact in outcome.artifacts]
    stems = ("measures", "steps", "xcom", "stability")
    assert names == [f"{stem}.{end}" for stem in stems for end in ("parquet", "csv")]
    table = pyarrow.csv.read_csv(tmp_path / "measures.csv")
    assert table.column_names == ["recording", "measure", "side", "step", "value", "sd", "unit", "recording_id"]
    steps = pyarrow.csv.read_csv(tmp_path / "steps.csv")
    assert steps.column_names[:6] == ["recording_id", "recording", "step", "side", "strike_s", "timing"]
    assert {"step_length_m", "sd_step_length_m", "cadence_1_min", "double_support_share"} <= set(steps.column_names)
    narrow = {
        (r["recording_id"], r["step"]): r for r in table.to_pylist() if r["measure"] == "margin_of_stability_ml_min"
    }
    for row in steps.to_pylist():
        margin = narrow.get((row["recording_id"], row["step"]))
        assert row["side_margin_of_stability_ml_min"] == ("" if margin is None else margin["side"])
        assert margin is None or margin["side"] != row["side"]
    in_rows = [v for v in steps["step_length_m"].to_pylist() if v is not None]
    in_long = [r["value"] for r in table.to_pylist() if r["measure"] == "step_length"]
    assert in_rows == pytest.approx(in_long)
    xcom = pyarrow.csv.read_csv(tmp_path / "xcom.csv")
    assert xcom.column_names == ["recording", "time_s", "x_m", "y_m", "sd_x_m", "sd_y_m", "recording_id"]
    summary = GaitMeasuresSummary.model_validate(outcome.summary)
    assert summary.n_recordings == 2
    assert summary.steps == steps.num_rows
    assert summary.steps == sum(summary.sides.values())
    by_name = {(one.name, one.side): one for one in summary.measures}
    lengths = [
        float(v)
        for v, m in zip(table["value"].to_pylist(), table["measure"].to_pylist(), strict=True)
        if m == "step_length"
    ]
    assert by_name["step_length", None].n == len(lengths)
    assert by_name["step_length", None].mean == pytest.approx(np.mean(lengths))
    assert json.dumps(outcome.summary, allow_nan=False)


def test_without_plates_steps_and_margins_come_from_the_markers(tmp_path: Path) -> None:
    off = {index: PlateSwitch(use=False) for index in range(1, 30)}
    summary = summary_of(tmp_path, member(tmp_path, plates=off))
    names = {one.name for one in summary.measures}
    assert summary.method == "geometry"
    assert {"step_length", "margin_of_stability_ml_min", "energy_recovery"} <= names
    assert not any(name.startswith("limb_work") for name in names)
    missing = {one.name: one.code for one in summary.not_measured}
    assert missing["limb_work_left_positive"] == "no-separate-forces"
    assert "force-not-used" in {warning.code for warning in summary.warnings}
    margin = next(one for one in summary.measures if one.name == "margin_of_stability_ml_min")
    assert margin.error_sd == pytest.approx(0.0073, abs=5e-4), "that of people"
    assert margin.error_sd is not None
    assert margin.ci95 is not None
    assert margin.ci95[1] - margin.ci95[0] > 2 * 1.96 * margin.error_sd


def test_a_damaged_recording_is_listed_and_the_others_are_measured(tmp_path: Path) -> None:
    broken = tmp_path / "broken.c3d"
    broken.write_bytes(b"no recording")
    summary = summary_of(tmp_path, member(tmp_path), member(tmp_path, broken))
    assert [one.filename for one in summary.left_out] == ["broken.c3d"]
    assert summary.n_recordings == 1
    with pytest.raises(NotEstimable, match="No recording has a whole step"):
        gait_measures.run(GaitMeasuresTask(members=[member(tmp_path, broken) for _ in range(2)]), tmp_path, quiet)
    with pytest.raises(UnreadableFile) as damaged:
        gait_measures.run(GaitMeasuresTask(members=[member(tmp_path, broken)]), tmp_path, quiet)
    assert damaged.value.code == "unknown-format"


def test_recordings_count_once() -> None:
    with pytest.raises(ValidationError, match="same recording twice"):
        GaitMeasuresInput(recording_ids=["a", "a"])


def test_the_library_gives_the_numbers_of_the_job(tmp_path: Path) -> None:
    measured = sl.gait_measures(TRIAL)
    summary = summary_of(tmp_path, member(tmp_path))
    assert [one.mean for one in measured.summary.measures] == [one.mean for one in summary.measures]
    folder = measured.save(tmp_path / "saved")
    assert {"measures.csv", "xcom.parquet", "result.json"} <= {path.name for path in folder.iterdir()}


def test_feet_that_share_a_plate_have_no_force_of_their_own() -> None:
    """One plate below the whole walk: every double support is on it."""
    loaded = sl.read(TRIAL)
    first = loaded.recording.plates[0]
    corners = np.array([[-10.0, 2.0, 0.0], [10.0, 2.0, 0.0], [10.0, -2.0, 0.0], [-10.0, -2.0, 0.0]])
    force = np.sum([plate.force_n for plate in loaded.recording.plates], axis=0)
    shared = replace(first, corners_m=corners, force_n=force)
    recording = replace(loaded.recording, plates=(shared,))
    from stridelab.measures.walk_motion import forces_by_foot
    from stridelab.recordings.foot_contact import find_feet
    from stridelab.recordings.marker_sets import identify
    from stridelab.walking.gait_events import find_contacts

    landmarks = identify(tuple(recording.markers_m), {}).landmarks
    contacts = find_contacts(recording, landmarks)
    forces = forces_by_foot(recording, landmarks, find_feet(recording, landmarks), contacts, 0.0)
    stances = [c for c in contacts if c.strike_s is not None and c.lift_off_s is not None]
    assert stances
    for contact in stances:
        inside = (recording.time_s > contact.start_s) & (recording.time_s < contact.end_s)
        assert np.isnan(forces[contact.side][inside]).any()


def test_the_stability_table_is_in_the_world_of_the_recording() -> None:
    """A recording turned by 2 rad: the feet that stand are at their markers, and margins end at their outer edges."""
    turn = np.array([[math.cos(2.0), -math.sin(2.0), 0.0], [math.sin(2.0), math.cos(2.0), 0.0], [0.0, 0.0, 1.0]])
    loaded = sl.read(TRIAL)
    (one,) = sl.gait_measures(loaded).result.recordings
    turned = replace(
        one,
        motion=replace(one.motion, frame=one.motion.frame @ turn.T, origin_m=one.motion.origin_m @ turn.T),
    )
    table = gait_measures.stability_columns((turned,))

    def track(name: str) -> np.ndarray:
        return np.column_stack([table[name.format(axis)] for axis in "xyz"])

    np.testing.assert_allclose(track("{}_m"), one.estimate.com_m @ turn.T, atol=1e-9)
    recording = one.prepared.trial.recording
    first = int(np.argmin(np.abs(recording.time_s - one.motion.time_s[0])))
    for side in ("left", "right"):
        heel = recording.markers_m[one.prepared.trial.match.landmarks[f"{side[0]}_heel"]][first:] @ turn.T
        outline = np.stack([track(f"{side}_outline{k}_{{}}_m") for k in range(5)], axis=1)
        stands = np.isfinite(outline[:, 0, 0])
        assert 0.4 < stands.mean() < 0.8
        away = np.linalg.norm(outline[:, :2, :2].mean(axis=1) - heel[: len(outline), :2], axis=1)[stands]
        assert away.max() < 0.05
        margin, edge = table[f"{side}_margin_m"], track(f"{side}_edge_{{}}_m")
        np.testing.assert_array_equal(np.isfinite(margin), stands)
        xcom = track("xcom_{}_m")
        assert np.abs(np.linalg.norm((edge - xcom)[stands], axis=1) - np.abs(margin[stands])).max() < 1e-9
        lateral = one.motion.frame[1] @ turn.T * (1.0 if side == "left" else -1.0)
        reach = np.nanmax(outline[stands] @ lateral, axis=1)
        np.testing.assert_allclose(edge[stands] @ lateral, reach, atol=1e-9)
    spin = np.linalg.norm(track("momentum_{}_m2_s"), axis=1)
    np.testing.assert_allclose(spin, np.linalg.norm(one.motion.momentum_per_kg, axis=1), rtol=1e-9)


def test_the_plates_of_a_session_calibrate_the_events_of_a_recording_without(tmp_path: Path) -> None:
    """Its strikes are nearer to those of the plates of the same walk, and its double support is known better."""
    off = {index: PlateSwitch(use=False) for index in range(1, 30)}
    pair = member(tmp_path, plates=off), member(tmp_path)
    for folder in ("alone", "session"):
        (tmp_path / folder).mkdir()
    results = {}
    for session_id in (None, "day"):
        members = [one.model_copy(update={"session_id": session_id}) for one in pair]
        results[session_id] = measure_members(GaitMeasuresTask(members=members), tmp_path, quiet).recordings
    alone, calibrated = results[None][0], results["day"][0]
    truth = results[None][1]
    assert results["day"][1].steps == truth.steps, "no other recording has plates"
    members = [one.model_copy(update={"session_id": "day"}) for one in (*pair, member(tmp_path))]
    copied = measure_members(GaitMeasuresTask(members=members), tmp_path, quiet).recordings
    assert [one.steps for one in copied] == [calibrated.steps, truth.steps], "a copy adds nothing"
    late = clock_of(truth.prepared.trial)
    assert late is not None
    strike = event_delays_of(truth.prepared.trial, late).strike
    assert strike is not None
    delays = EventDelays(strike=strike.model_copy(update={"late_s": strike.late_s + late.latency_s}))
    by_facts = pair[0].model_copy(update={"session_id": "day", "session_delays": [delays]})
    (known,) = measure_members(GaitMeasuresTask(members=[by_facts]), tmp_path, quiet).recordings
    np.testing.assert_allclose(
        [one.strike_s for one in known.steps], [one.strike_s for one in calibrated.steps], atol=0.001
    )

    def off_s(steps: Sequence[GaitStep]) -> np.ndarray:
        return np.array([one.strike_s - own.strike_s for one, own in zip(steps, truth.steps, strict=True)])

    assert np.abs(off_s(calibrated.steps)).mean() < 0.5 * np.abs(off_s(alone.steps)).mean()
    name = "double_support_share"
    sds = [np.mean([m.sd for m in one.measures if m.name == name]) for one in (alone, calibrated)]
    assert sds[1] < 0.9 * sds[0]


def test_a_copy_of_a_recording_counts_once(tmp_path: Path) -> None:
    """It would narrow the intervals; of other settings it is another recording."""
    summary = summary_of(tmp_path, member(tmp_path), member(tmp_path))
    (copy,) = summary.left_out
    assert (summary.n_recordings, copy.recording_id, copy.code) == (1, "recording-1", "recording-twice")
    assert f"the same file as {TRIAL.name}" in copy.message


def test_recordings_that_cannot_be_of_one_person_are_remarked_on(tmp_path: Path) -> None:
    people = [member(tmp_path, subject=SubjectFields(height_m=height_m)) for height_m in (1.60, 1.80)]
    assert "several-people" in [one.code for one in summary_of(tmp_path, *people).warnings]
    assert "several-people" not in [one.code for one in summary_of(tmp_path, people[0]).warnings]
