"""``stridelab study-population``: what is read, what is written and shown, and how it ends; here and on a service."""

import csv
import hashlib
import io
import json
import shutil
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from stridelab.cli import remote
from stridelab.client import ProblemError
from stridelab.errors import StridelabError, Unavailable
from stridelab.pipelines.progress import ProgressCallback
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.population import RecordingBatch, RefusedFile, StudyPopulationSummary, StudyPopulationTask
from stridelab.service.kinds.base import ArtifactFile, Outcome
from stridelab.service.kinds.study_population import run as study_population
from support.command_line import SAMPLE, Run, ScriptedService, problem
from support.fakes import results

TABLES = {f"{stem}.{end}" for stem in ("subjects", "steps", "correlations") for end in ("csv", "parquet")}
WRITTEN = TABLES | {"result.json", "references.bib"}


@pytest.fixture
def run(run: Run, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run the command in a window wide enough for a table's cells."""
    monkeypatch.setenv("COLUMNS", "160")
    return partial(run, "study-population")


@dataclass
class FakeStudy:
    """Stands in for the job's function: records its task and the files of its folder."""

    task: StudyPopulationTask | None = None
    files: Mapping[str, bytes] | None = None
    fails: StridelabError | None = None

    def __call__(self, task: StudyPopulationTask, folder: Path, progress: ProgressCallback) -> Outcome:
        self.task = task
        self.files = {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
        progress(0.5, "half")
        if self.fails is not None:
            raise self.fails
        for name in TABLES:
            (folder / name).write_bytes(b"x")
        summary = results.population_summary().model_dump(mode="json")
        return Outcome(summary, ("carpentier2017thesis",), tuple(ArtifactFile(n, "text/csv") for n in sorted(TABLES)))


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> FakeStudy:
    fake_study = FakeStudy()
    monkeypatch.setattr(study_population, "run", fake_study)
    return fake_study


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    """Three files of a lab; the content of each is its name."""
    for name in ("day-1/a.c3d", "day-2/b.C3D", "standing.c3d", "notes.txt"):
        path = tmp_path / "lab" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(name)
    return tmp_path / "lab"


def table(folder: Path, text: str) -> Path:
    (folder / "who.csv").write_text(text)
    return folder / "who.csv"


def test_a_study_of_two_walks_and_a_broken_file_names_the_broken_one(run: Run, tmp_path: Path) -> None:
    """The job itself: the sample walk, and the same walk with more padding behind it, as two people."""
    trial = (SAMPLE / "recording.c3d").read_bytes()
    for name, content in (("a.c3d", trial), ("b.c3d", trial + bytes(512)), ("broken.c3d", b"no recording")):
        (tmp_path / name).write_bytes(content)
    who = table(tmp_path, "file,subject,group,height_m\na.c3d,P01,adults,1.61\nb.c3d,P02,adults,1.82\n")
    files = [tmp_path / name for name in ("a.c3d", "b.c3d", "broken.c3d")]
    ran = run(*files, "--subjects", who, "--method", "complementary", "--out", "people", "--json")
    assert ran.code == 0, ran.err
    result = JobResult.model_validate_json(ran.out)
    assert {path.name for path in (tmp_path / "people").iterdir()} == WRITTEN
    assert json.loads((tmp_path / "people" / "result.json").read_text()) == json.loads(ran.out)
    summary = StudyPopulationSummary.model_validate(result.summary)
    one, other = summary.subjects
    assert [(s.subject, s.group, s.height_m) for s in summary.subjects] == [
        ("P01", "adults", 1.61),
        ("P02", "adults", 1.82),
    ]
    assert one.n_steps == other.n_steps > 0
    assert one.recordings == ["a.c3d"]
    assert [left_out.filename for left_out in summary.left_out] == ["broken.c3d"]
    assert summary.method == "complementary"
    assert "carpentier2017thesis" in (tmp_path / "people" / "references.bib").read_text()
    rows = list(csv.DictReader(io.StringIO((tmp_path / "people" / "subjects.csv").read_text())))
    assert [row["subject"] for row in rows] == ["P01", "P02"]


def test_tables_of_people_and_pairs(run: Run, fake: FakeStudy, lab: Path, tmp_path: Path) -> None:
    ran = run(lab)
    assert ran.code == 0, ran.err
    for text in ("P01", "C02", "children", "100.0 ± 4.0", "adults R", "height", "+0.10 to +0.90", "0.67", "turn.c3d"):
        assert text in ran.out
    assert "(turning)" in ran.out
    assert "(groups-apart)" in ran.out
    assert "written population: correlations.csv" in ran.out
    assert {path.name for path in (tmp_path / "population").iterdir()} == WRITTEN


def test_json_is_the_result_and_the_options_arrive(run: Run, fake: FakeStudy, lab: Path) -> None:
    ran = run(lab, "--json", "--pooled", "--seed", 7, "--steps", "all", "--method", "rts")
    assert ran.code == 0, ran.err
    result = JobResult.model_validate_json(ran.out)
    assert result.kind == "study-population"
    expected = {"pooled": True, "seed": 7, "steps": "all", "method": "rts"}
    assert {name: result.input[name] for name in expected} == expected
    assert fake.task is not None
    assert (fake.task.pooled, fake.task.seed) == (True, 7)
    assert {(one.task.input.steps, one.task.input.method) for one in fake.task.members} == {("all", "rts")}


def test_a_folder_is_searched_and_the_table_names_people_and_static_trials(
    run: Run, fake: FakeStudy, lab: Path, tmp_path: Path
) -> None:
    who = table(tmp_path, "file;subject;height_m;static\na.c3d;P01;1.71;standing.c3d\nday-2/b.C3D;P02;;\n")
    ran = run(lab, "--subjects", who)
    assert ran.code == 0, ran.err
    assert fake.task is not None
    assert fake.files is not None
    one, other = fake.task.members
    assert [m.task.recording.filename for m in (one, other)] == ["day-1/a.c3d", "day-2/b.C3D"]
    assert [m.person.subject for m in (one, other)] == ["P01", "P02"]
    assert one.task.recording.subject.height_m == 1.71
    assert fake.files[f"{one.folder}/trial"] == b"day-1/a.c3d"
    assert fake.files[f"{one.folder}/static-trial"] == b"standing.c3d"
    assert other.task.static is None


def zipped(path: Path, members: Mapping[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return path


def test_trc_files_of_a_folder_and_of_a_zip_are_studied(run: Run, fake: FakeStudy, lab: Path, tmp_path: Path) -> None:
    for name in ("day-1/a.trc", "day-1/c.trc"):
        (lab / name).write_text(name)
    batch = zipped(tmp_path / "lab.zip", {"d.trc": b"d", "e.trc": b"e"})
    ran = run(lab, batch)
    assert ran.code == 0, ran.err
    assert fake.task is not None
    studied = [member.task.recording.filename for member in fake.task.members]
    assert studied == ["day-1/a.c3d", "day-1/c.trc", "day-2/b.C3D", "standing.c3d", "d.trc", "e.trc"]


def test_a_zip_brings_its_files_and_its_table(run: Run, fake: FakeStudy, tmp_path: Path) -> None:
    batch = zipped(tmp_path / "lab.zip", {"lab/a.c3d": b"a", "lab/who.csv": b"file,subject\na.c3d,P01\n"})
    ran = run(batch)
    assert ran.code == 0, ran.err
    assert fake.task is not None
    assert [(m.task.recording.filename, m.person.subject) for m in fake.task.members] == [("lab/a.c3d", "P01")]
    again = run(batch, "--subjects", table(tmp_path, "file\na.c3d\n"), "--force")
    assert (again.code, "(subject-table-twice)" in again.err) == (2, True)


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("file,height_m\na.c3d,171\n", "line 2, column height_m"),
        ("file,shoe\na.c3d,42\n", "line 1, column 2"),
        ("file\nz.c3d\n", "line 2, column file"),
        ("", "line 1"),
    ],
)
def test_a_bad_table_is_named_by_line_and_column(
    run: Run, fake: FakeStudy, lab: Path, tmp_path: Path, text: str, where: str
) -> None:
    ran = run(lab, "--subjects", table(tmp_path, text))
    assert ran.code == 2
    assert "(subject-table-invalid)" in ran.err
    assert f"  {where}: " in ran.err
    assert ran.out == ""
    assert fake.task is None
    assert {path.name for path in tmp_path.iterdir()} == {"lab", "who.csv"}


def test_missing_empty_and_repeated_files_are_refused(run: Run, fake: FakeStudy, lab: Path, tmp_path: Path) -> None:
    missing = run(tmp_path / "missing.c3d")
    assert missing.code == 3
    assert "missing.c3d" in missing.err
    assert run(lab, "--subjects", tmp_path / "missing.csv").code == 3
    (tmp_path / "empty").mkdir()
    empty = run(tmp_path / "empty")
    assert (empty.code, "(no-recordings)" in empty.err) == (2, True)
    shutil.copyfile(lab / "standing.c3d", tmp_path / "copy.c3d")
    twice = run(lab, tmp_path / "copy.c3d")
    assert (twice.code, "(recording-twice)" in twice.err) == (2, True)
    assert fake.task is None
    assert not (tmp_path / "population").exists()


def test_an_earlier_result_is_replaced_only_by_force(run: Run, fake: FakeStudy, lab: Path, tmp_path: Path) -> None:
    assert run(lab).code == 0
    again = run(lab)
    assert (again.code, "(output-exists)" in again.err) == (6, True)
    assert run(lab, "--force").code == 0
    assert run(lab, "--seed", -1, "--force").code == 2
    assert {path.name for path in (tmp_path / "population").iterdir()} == WRITTEN


def test_a_study_that_fails_leaves_nothing(run: Run, fake: FakeStudy, lab: Path, tmp_path: Path) -> None:
    fake.fails = Unavailable("out-of-something", "There is no more of it.")
    ran = run(lab)
    assert (ran.code, "(out-of-something)" in ran.err) == (10, True)
    assert {path.name for path in tmp_path.iterdir()} == {"lab"}


def test_a_study_without_any_fit_is_refused(run: Run, tmp_path: Path) -> None:
    (tmp_path / "broken.c3d").write_bytes(b"no recording")
    ran = run(tmp_path / "broken.c3d")
    assert (ran.code, "(nothing-fitted)" in ran.err) == (4, True)
    assert "  broken.c3d: " in ran.err


class LabService(ScriptedService):
    """Takes many files at once and refuses those called ``refused``."""

    refused: tuple[str, ...] = ()

    def upload_batch(
        self, files: Sequence[tuple[str, Path]], table: str | None = None, *, progress: Any = None
    ) -> RecordingBatch:
        accepted = [(name, path) for name, path in files if name not in self.refused]
        self._note("upload_batch", [name for name, _ in files])
        progress(10, 10)
        recordings = []
        for name, path in accepted:
            stored = ScriptedService.upload(self, path)
            digest = hashlib.sha256(path.read_bytes()).hexdigest()
            recordings.append(stored.model_copy(update={"id": f"id-of-{name}", "filename": name, "sha256": digest}))
        refused = [RefusedFile(filename=n, code="c3d-damaged", message="It is damaged.") for n in self.refused]
        return RecordingBatch(recordings=recordings, studied=[r.id for r in recordings], subjects=[], refused=refused)


@pytest.fixture
def service(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> LabService:
    lab_service = LabService()
    lab_service.files = tmp_path / "served"
    lab_service.files.mkdir()
    lab_service.artifact = "subjects.csv"
    (lab_service.files / lab_service.artifact).write_text("subject\n")
    job_input = {"recording_ids": ["a"]}
    summary = results.population_result(job_input).model_dump(mode="json", exclude={"kind", "input"})
    lab_service.done = {"kind": "study-population", "input": job_input, "result": summary}
    monkeypatch.setattr(remote, "Client", lab_service)
    return lab_service


def test_on_a_service_files_statics_people_and_options_arrive(
    run: Run, service: LabService, lab: Path, tmp_path: Path
) -> None:
    who = table(tmp_path, "file,subject,static\nday-1/a.c3d,P01,standing.c3d\n")
    ran = run(lab, "--subjects", who, "--server", "http://lab:8000", "--token", "secret", "--pooled", "--out", "there")
    assert ran.code == 0, ran.err
    calls = dict(service.calls)
    assert calls["client"] == ("http://lab:8000", "secret")
    assert calls["upload_batch"] == ["day-1/a.c3d", "day-2/b.C3D", "standing.c3d"]
    assert calls["patch"][0] == "id-of-day-1/a.c3d"
    assert calls["patch"][1].static_recording_id == "id-of-standing.c3d"
    kind, job_input, keyed = calls["submit"]
    assert (kind, keyed, job_input.pooled) == ("study-population", True, True)
    assert job_input.recording_ids == ["id-of-day-1/a.c3d", "id-of-day-2/b.C3D"]
    assert [(row.recording_id, row.subject) for row in job_input.subjects] == [("id-of-day-1/a.c3d", "P01")]
    assert {path.name for path in (tmp_path / "there").iterdir()} == {"subjects.csv", "result.json", "references.bib"}
    assert "P01" in ran.out


def test_on_a_service_refused_files_are_named_and_the_rest_studied(
    run: Run, service: LabService, lab: Path, tmp_path: Path
) -> None:
    service.refused = ("day-1/a.c3d",)
    who = table(tmp_path, "file,subject\nday-1/a.c3d,P01\nday-2/b.C3D,P02\n")
    ran = run(lab, "--subjects", who, "--server", "http://lab:8000", "--json")
    assert ran.code == 0, ran.err
    assert "refused day-1/a.c3d: It is damaged." in ran.err
    assert JobResult.model_validate_json(ran.out).kind == "study-population"
    job_input = dict(service.calls)["submit"][1]
    assert job_input.recording_ids == ["id-of-day-2/b.C3D", "id-of-standing.c3d"]
    assert [row.subject for row in job_input.subjects] == ["P02"]


@pytest.mark.parametrize(
    ("call", "status", "code"), [("upload_batch", 422, 3), ("submit", 422, 2), ("submit", 429, 8), ("submit", 401, 9)]
)
def test_a_refusal_of_the_service_is_an_exit_code(
    run: Run, service: LabService, lab: Path, tmp_path: Path, call: str, status: int, code: int
) -> None:
    service.refuse[call] = ProblemError(problem(status, "some-code"), 3.0)
    ran = run(lab, "--server", "http://lab:8000")
    assert (ran.code, "(some-code)" in ran.err) == (code, True)
    assert not (tmp_path / "population").exists()


def test_a_failed_job_of_the_service_is_an_error(run: Run, service: LabService, lab: Path, tmp_path: Path) -> None:
    service.ends = ("failed", problem(422, "nothing-fitted"))
    ran = run(lab, "--server", "http://lab:8000")
    assert (ran.code, "(nothing-fitted)" in ran.err) == (4, True)
    assert not (tmp_path / "population").exists()
