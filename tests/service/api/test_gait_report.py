"""``gait-report`` over HTTP: a session becomes its recordings, and people of the reference group are identified."""

import base64
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import pytest

from stridelab.pipelines.gait_report.report import gait_report
from stridelab.pipelines.trial import examine_trial
from stridelab.recordings.files.c3d_writer import write_c3d
from stridelab.recordings.recording import Subject
from stridelab.schemas.measures import GaitReportInput, GaitReportTask
from stridelab.schemas.recordings import SubjectFields
from stridelab.schemas.tasks import RecordingSource
from stridelab.service.kinds.gait_report.kind import stage, stage_logo
from stridelab.service.kinds.parse_upload import recording_facts
from stridelab.service.local_recordings import ReportWalks, report_task
from stridelab.service.settings import Settings
from stridelab.simulation.human.walker import HumanWalker
from stridelab.simulation.human_recording import record
from stridelab.simulation.noise import MeasurementNoise
from support.command_line import quiet
from support.service.stored_rows import add_recording, facts
from support.service.web_server import Served, fault_places, refusal_code

JOBS = "/api/v1/jobs"


def add(service: Served, filename: str = "walk.c3d", **columns: Any) -> str:
    known = columns.pop("known", {})
    row = {"facts": facts(**known).model_dump(mode="json"), "filename": filename, **columns}
    return service.run(add_recording(service.parts, **row))


def submitted(service: Served, http: httpx.Client, **body: object) -> dict[str, Any]:
    """Input of the stored job."""
    answer = http.post(f"{JOBS}/gait-report", json=body)
    assert answer.status_code == 202, answer.text
    return dict(service.run(service.parts.store.get(answer.json()["id"])).input)


def test_a_session_is_its_walks_in_order_of_their_names(service: Served, http: httpx.Client) -> None:
    second, first = (add(service, name, session_id="walks") for name in ("b.c3d", "a.c3d"))
    add(service, "static.c3d", session_id="walks", known={"still": True})
    add(service, "other.c3d", session_id="walks", owner="somebody else")
    add(service, "elsewhere.c3d", session_id="another")
    task = submitted(service, http, session_id="walks", title="Session")
    assert task == {"recording_ids": [first, second], "title": "Session"}


@pytest.mark.parametrize("session_id", ["nothing-there", "of-another"])
def test_a_session_without_walks_of_the_sender_is_not_found(
    service: Served, http: httpx.Client, session_id: str
) -> None:
    add(service, session_id="of-another", owner="somebody else")
    answer = http.post(f"{JOBS}/gait-report", json={"session_id": session_id})
    assert refusal_code(answer) == (404, "session-not-found")
    assert fault_places(answer) == ["session_id"]


@pytest.mark.parametrize("field", ["reference_recording_ids", "before_recording_ids"])
def test_a_recording_of_the_session_is_in_no_other_group(service: Served, http: httpx.Client, field: str) -> None:
    other, walk = add(service), add(service, session_id=f"twice-{field[:6]}")
    answer = http.post(f"{JOBS}/gait-report", json={"session_id": f"twice-{field[:6]}", field: [other, walk]})
    assert refusal_code(answer) == (422, "recording-twice")
    assert fault_places(answer) == [f"{field}.1"]


@pytest.mark.parametrize(
    "body",
    [
        {},
        {"recording_ids": []},
        {"recording_ids": ["a"], "session_id": "b"},
        {"recording_ids": ["a"], "reference_recording_ids": ["a"]},
        {"recording_ids": ["a"], "title": "two\nlines"},
        {"session_id": "a b"},
    ],
)
def test_a_request_that_names_no_recordings_or_two_ways_is_refused(http: httpx.Client, body: dict[str, object]) -> None:
    assert refusal_code(http.post(f"{JOBS}/gait-report", json=body)) == (422, "invalid-request")


def test_unknown_recordings_are_named_by_their_field(service: Served, http: httpx.Client) -> None:
    known = add(service)
    body = {"recording_ids": [known], "reference_recording_ids": ["f" * 32]}
    answer = http.post(f"{JOBS}/gait-report", json=body)
    assert refusal_code(answer) == (404, "recording-not-found")
    assert fault_places(answer) == ["reference_recording_ids.0"]


def test_the_people_of_the_reference_group_are_distinguished(service: Served, tmp_path: Path) -> None:
    person = add(service)
    twice = [add(service, subject_fields={"name": "P1"}) for _ in range(2)]
    other, unknown = add(service, subject_fields={"name": "P2"}), add(service)
    report_input = GaitReportInput(recording_ids=[person], reference_recording_ids=[twice[0], other, twice[1], unknown])

    async def run() -> Any:
        async with service.parts.engine.begin() as connection:
            return await stage(connection, service.parts.blobs, report_input, tmp_path)

    task = GaitReportTask.model_validate(service.run(run()))
    people = [[one.recording_id for one in group.members] for group in task.reference]
    assert people == [twice, [other], [unknown]]
    folders = [one.folder for group in (task.members, *(other.members for other in task.reference)) for one in group]
    assert len(set(folders)) == 5
    assert all((tmp_path / folder / "trial").is_file() for folder in folders)


def test_the_command_shares_what_the_job_shares(
    service: Served, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Three noisy recordings of a walk and the person standing: pooled latency, pooled mass, static trial, numbers."""
    walk = HumanWalker(mass_kg=64.0, duration_s=3.0, seed=4).walk()
    files = tmp_path_factory.mktemp("files")
    stated = SubjectFields(height_m=1.75)
    rows = []
    for k in range(3):
        noise = MeasurementNoise(marker_m=0.002, mass_model=0.1, latency_s=0.018)
        recording = replace(record(walk, noise, k, lab="two_plates").recording, subject=Subject(), carried={})
        write_c3d(files / f"walk{k}.c3d", recording)
        if k == 0:
            first_frame = {label: track[:1].repeat(30, axis=0) for label, track in recording.markers_m.items()}
            still = replace(recording, markers_m=first_frame, plates=(), events=(), walking_direction=None)
            write_c3d(files / "standing.c3d", still)
    for path in sorted(files.iterdir()):
        known = recording_facts(examine_trial(RecordingSource(file=path.name, filename=path.name), files))
        columns = {"session_id": "shared", "facts": known.model_dump(mode="json"), "filename": path.name}
        fields = stated.model_dump(exclude_none=True)
        added = add_recording(service.parts, content=path.read_bytes(), subject_fields=fields, **columns)
        rows.append(service.run(added))
    request = GaitReportInput(recording_ids=rows, method="complementary")
    (tmp_path / "job").mkdir()
    (tmp_path / "command").mkdir()

    async def run() -> Any:
        async with service.parts.engine.begin() as connection:
            return await stage(connection, service.parts.blobs, request, tmp_path / "job")

    job = GaitReportTask.model_validate(service.run(run()))
    walks = ReportWalks(sorted(files.iterdir()), [], [])
    command = report_task(walks, stated, {"title": None, "method": "complementary"}, None, tmp_path / "command")
    alone = command.model_copy(
        update={
            "members": [
                one.model_copy(update={"task": one.task.model_copy(update={"session": None, "static": None})})
                for one in command.members
            ]
        }
    )
    shared = [one.task.session for one in command.members if one.task.recording.filename.startswith("walk")]
    assert [None if one is None else (one.latency_n_trials, one.mass_n_trials) for one in shared] == [(3, 3)] * 3
    assert all(one.task.static for one in command.members if one.task.recording.filename.startswith("walk"))
    numbers = [
        gait_report(task, tmp_path / folder, quiet).summary.model_dump(include={"measures", "mass_kg"})
        for task, folder in ((job, "job"), (command, "command"), (alone, "command"))
    ]
    assert numbers[0] == numbers[1]
    assert numbers[0] != numbers[2], "the recordings share nothing"


def test_the_logo_of_the_settings_is_fetched(tmp_path: Path) -> None:
    picture = base64.b64decode("iVBORw0KGgo=")
    (tmp_path / "logo.png").write_bytes(picture)
    name = stage_logo(Settings(lab_logo=tmp_path / "logo.png"), tmp_path)
    assert name is not None
    assert (tmp_path / name).read_bytes() == picture
    assert stage_logo(Settings(), tmp_path) is None
