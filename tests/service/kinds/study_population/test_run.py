"""``study-population`` on simulated people and, where they are here, on the real ones."""

import os
import shutil
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from pydantic import ValidationError

from stridelab.errors import InvalidInput, NotEstimable
from stridelab.pipelines.population.subjects import RecordingSubject, merge_subjects
from stridelab.schemas.cycloid import FitCycloidInput, FitCycloidTask
from stridelab.schemas.jobs import SimulateRecordingInput
from stridelab.schemas.population import (
    PersonFields,
    PopulationMember,
    StudyPopulationInput,
    StudyPopulationSummary,
    StudyPopulationTask,
)
from stridelab.schemas.recordings import SubjectFields
from stridelab.schemas.tasks import RecordingSource, SimulateRecordingTask
from stridelab.service.kinds.simulate_recording import run as simulate_recording
from stridelab.service.kinds.study_population import run as study_population
from support.command_line import quiet

GAIT = Path(os.environ.get("STRIDELAB_TEST_DATA", Path(__file__).parents[5] / "shared")).resolve() / "gait"


def member(folder: Path, file: Path, person: PersonFields) -> PopulationMember:
    name = f"recording-{len(list(folder.glob('recording-*')))}"
    (folder / name).mkdir()
    shutil.copyfile(file, folder / name / "trial")
    source = RecordingSource(file="trial", filename=file.name)
    task = FitCycloidTask(recording=source, input=FitCycloidInput(recording_id=name))
    return PopulationMember(recording_id=name, folder=name, task=task, person=person)


@pytest.fixture(scope="module")
def walks(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """One person of 1.6 m and one of 1.8 m."""
    files = []
    for n, height_m in enumerate((1.6, 1.8)):
        folder = tmp_path_factory.mktemp("walk")
        simulation = SimulateRecordingInput(duration_s=2.5, height_m=height_m, seed=n)
        simulate_recording.run(SimulateRecordingTask(input=simulation), folder, quiet)
        files.append((folder / "recording.c3d").rename(folder / f"walk-{n}.c3d"))
    return files


def test_two_people_have_means_and_recordings_without_a_fit_are_named(walks: list[Path], tmp_path: Path) -> None:
    broken = tmp_path / "broken.c3d"
    broken.write_bytes(b"no recording")
    members = [
        member(tmp_path, walks[0], PersonFields(subject="P01", group="adults")),
        member(tmp_path, walks[1], PersonFields(subject="P02", group="adults")),
        member(tmp_path, broken, PersonFields(subject="P03")),
    ]
    outcome = study_population.run(StudyPopulationTask(members=members), tmp_path, quiet)
    summary = StudyPopulationSummary.model_validate(outcome.summary)
    assert [one.subject for one in summary.subjects] == ["P01", "P02"]
    short, tall = summary.subjects
    assert short.height_m is not None
    assert short.z0_m < tall.z0_m
    assert short.leg_m is not None
    assert tall.leg_m is not None
    assert 0.7 < short.leg_m < tall.leg_m < 1.0
    assert short.n_steps > 1
    assert short.R_sd_m is not None
    assert summary.correlations == []
    codes = {warning.code for warning in summary.warnings}
    assert {"too-few-subjects", "recordings-left-out"} <= codes
    assert [one.filename for one in summary.left_out] == ["broken.c3d"]
    steps = pq.read_table(tmp_path / "steps.parquet")
    assert steps.num_rows == summary.n_steps
    assert set(steps["subject"].to_pylist()) == {"P01", "P02"}
    assert pq.read_table(tmp_path / "correlations.parquet").num_rows == 0
    tables = ("subjects", "steps", "correlations")
    names = {f"{stem}.{end}" for stem in tables for end in ("csv", "parquet")}
    assert {artifact.name for artifact in outcome.artifacts} == names


def test_a_study_without_any_fit_is_refused_with_every_reason(tmp_path: Path) -> None:
    broken = tmp_path / "broken.c3d"
    broken.write_bytes(b"no recording")
    with pytest.raises(NotEstimable) as refused:
        study_population.run(StudyPopulationTask(members=[member(tmp_path, broken, PersonFields())]), tmp_path, quiet)
    assert refused.value.code == "nothing-fitted"
    assert refused.value.faults[0].where == "broken.c3d"


def test_a_person_in_two_recordings_counts_once_and_contradictions_are_remarked() -> None:
    sheets = [
        RecordingSubject("a.c3d", PersonFields(subject="P01", height_m=1.70, age_years=30), 0.80),
        RecordingSubject("b.c3d", PersonFields(subject="P01", height_m=1.80), 0.82),
        RecordingSubject("c.c3d", PersonFields(height_m=1.65)),
        RecordingSubject("d.c3d", PersonFields(height_m=1.30)),
    ]
    people, remarks = merge_subjects(sheets)
    assert [one.person.name for one in people] == ["P01", "c.c3d", "d.c3d"]
    assert people[0].person.height_m == 1.70
    assert people[0].person.leg_m == pytest.approx(0.81)
    assert [one.person.group for one in people] == ["adults", "unknown", "children"]
    assert [remark.code for remark in remarks] == ["subject-differs", "subjects-assumed"]
    assert "1.7, 1.8" in remarks[0].message


def test_a_person_in_two_groups_is_refused() -> None:
    sheets = [
        RecordingSubject("a.c3d", PersonFields(subject="P01", group="adults")),
        RecordingSubject("b.c3d", PersonFields(subject="P01", group="patients")),
    ]
    with pytest.raises(InvalidInput) as refused:
        merge_subjects(sheets)
    assert refused.value.code == "subject-in-two-groups"
    assert [fault.where for fault in refused.value.faults] == ["a.c3d", "b.c3d"]


@pytest.mark.parametrize(
    "fields",
    [
        {"recording_ids": []},
        {"recording_ids": ["a", "a"]},
        {"recording_ids": ["a"], "subjects": [{"recording_id": "b"}]},
        {"recording_ids": ["a"], "subjects": [{"recording_id": "a"}, {"recording_id": "a"}]},
        {"recording_ids": ["a"], "subjects": [{"recording_id": "a", "height_m": 171}]},
        {"recording_ids": [str(n) for n in range(501)]},
    ],
)
def test_invalid_inputs_are_refused_by_the_contract(fields: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        StudyPopulationInput.model_validate(fields)


@pytest.mark.skipif(not GAIT.is_dir(), reason="real recordings are not here (set STRIDELAB_TEST_DATA)")
def test_the_adults_at_their_own_speed(tmp_path: Path) -> None:
    """Eleven people, one trial each: what was measured beforehand, within its intervals."""
    files = sorted((GAIT / "rehazenter-adult-walking").rglob("*_C4_*.c3d"))
    members = [member(tmp_path, file, PersonFields(subject=file.parent.name)) for file in files]
    outcome = study_population.run(StudyPopulationTask(members=members), tmp_path, quiet)
    summary = StudyPopulationSummary.model_validate(outcome.summary)
    assert summary.left_out == []
    assert {one.group for one in summary.subjects} == {"adults"}
    r = {(one.parameter, one.against): one for one in summary.correlations}
    assert r["z0_m", "height_m"].n == 11
    assert r["z0_m", "height_m"].r == pytest.approx(0.99, abs=0.01)
    assert 0.10 <= r["R_m", "step_length_m"].r <= 0.90
    assert 0.48 <= r["r_m", "step_length_m"].r <= 0.96
    for parameter in ("R_m", "r_m"):
        interval = r[parameter, "height_m"].ci95
        assert interval is not None
        assert interval[0] < 0.0 < interval[1]
    assert (r["R_m", "height_m"].thesis, r["z0_m", "height_m"].thesis) == (0.67, 0.87)
    assert r["omega_rad_s", "height_m"].thesis is None


def test_a_contradicted_recording_is_in_no_mean_and_every_trial_has_its_quality(
    walks: list[Path], tmp_path: Path
) -> None:
    members = [
        member(tmp_path, walks[0], PersonFields(subject="P01")),
        member(tmp_path, walks[1], PersonFields(subject="P02")),
    ]
    wrong = members[1].task.recording.model_copy(update={"subject": SubjectFields(mass_kg=75.0)})
    members[1] = members[1].model_copy(update={"task": members[1].task.model_copy(update={"recording": wrong})})
    outcome = study_population.run(StudyPopulationTask(members=members), tmp_path, quiet)
    summary = StudyPopulationSummary.model_validate(outcome.summary)
    assert [one.subject for one in summary.subjects] == ["P01"]
    assert [(one.filename, one.code) for one in summary.left_out] == [("walk-1.c3d", "contradicted")]
    assert "the plates' vertical force and the mass contradict each other" in summary.left_out[0].message
    assert [trial.quality.verdict for trial in summary.trials] == ["good", "contradicted"]
    assert summary.quality is not None
    assert summary.quality.verdict == "good"
