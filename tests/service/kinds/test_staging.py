"""Rows and blobs become a task; a finished simulation becomes a recording. On a real database and a real store."""

import asyncio
import hashlib
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import insert, select
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncEngine

from stridelab.errors import NotFound
from stridelab.schemas.comparison import CompareEstimatorsInput, CompareEstimatorsTask
from stridelab.schemas.cycloid import FitCycloidInput, FitCycloidTask
from stridelab.schemas.jobs import EstimateComInput, SimulateRecordingInput
from stridelab.schemas.plans import PlanContactsInput, PlanContactsTask, PlanMotionInput, PlanMotionTask
from stridelab.schemas.receding import PlanRecedingInput, PlanRecedingTask
from stridelab.schemas.recordings import EventDelay, EventDelays, RecordingFacts, SubjectFields, TrialClock
from stridelab.schemas.robots import LearnReachabilityInput, LearnReachabilityTask
from stridelab.schemas.tasks import EstimateComTask, SimulateRecordingTask
from stridelab.service.filenames import LINKS_FILE, SIMULATED_FACTS_FILE
from stridelab.service.kinds import staging
from stridelab.service.kinds.registry import KINDS
from stridelab.service.kinds.simulate_recording.kind import publish
from stridelab.service.samples.scenario_bodies import ONE_STEP, STANDING, STANDING_AHEAD
from stridelab.service.source_hash import cached_files_prefix
from stridelab.service.storage.blobs import BlobStore
from stridelab.service.storage.tables import job, recording, scenario, subject
from support.robots.plans import short_walk
from support.service import database

FACTS = RecordingFacts(
    duration_s=1.0,
    n_frames=100,
    marker_rate_hz=100.0,
    force_rate_hz=1000.0,
    marker_set="isb",
    n_markers=1,
    subject=SubjectFields(),
    plates=[],
    windows_s=[],
    up_axis="+z",
    walking_direction=None,
    labels=["A"],
    landmarks={},
    missing_landmarks=[],
    warnings=[],
)


@pytest.fixture
def blobs(tmp_path: Path) -> BlobStore:
    return BlobStore.from_url((tmp_path / "blobs").as_uri())


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "task").mkdir()
    return tmp_path / "task"


def within(url: str, act: Callable[[AsyncConnection], Awaitable[Any]]) -> Any:
    async def in_transaction(engine: AsyncEngine) -> Any:
        async with engine.begin() as connection:
            return await act(connection)

    return database.run_with_engine(url, in_transaction)


async def store_recording(connection: AsyncConnection, blobs: BlobStore, source: Path, key: str, **fields: Any) -> None:
    source.write_bytes(key.encode())
    await blobs.put_file(f"recordings/{key}/file", source)
    values: dict[str, Any] = {
        "id": key,
        "filename": f"{key}.c3d",
        "sha256": hashlib.sha256(key.encode()).hexdigest(),
        "bytes": 1,
        "blob_key": f"recordings/{key}/file",
        "tracks_key": f"recordings/{key}/tracks.parquet",
        "facts": FACTS.model_dump(mode="json"),
        "subject_fields": {},
    }
    await connection.execute(insert(recording).values(values | fields))


def test_the_task_holds_files_switches_and_the_stated_subject(
    database_url: str, blobs: BlobStore, folder: Path, tmp_path: Path
) -> None:
    async def act(connection: AsyncConnection) -> Any:
        await connection.execute(
            insert(subject).values(id="s1", fields={"name": "S1", "height_m": 1.6, "mass_kg": 70.0})
        )
        await store_recording(connection, blobs, tmp_path / "a", "still")
        await store_recording(
            connection,
            blobs,
            tmp_path / "a",
            "walk",
            subject_id="s1",
            subject_fields={"height_m": 1.71, "mass_kg": None},
            static_recording_id="still",
            marker_map={"l_asis": "X"},
            plate_switches={"2": {"use": False}},
        )
        job_input = EstimateComInput(recording_id="walk", latency="apply")
        return await staging.stage_estimate_com(connection, blobs, job_input, folder)

    task = EstimateComTask.model_validate(within(database_url, act))
    assert (folder / task.recording.file).read_bytes() == b"walk"
    assert task.static is not None
    assert (folder / task.static.file).read_bytes() == b"still"
    assert task.recording.filename == "walk.c3d"
    assert task.recording.subject == SubjectFields(name="S1", height_m=1.71, mass_kg=70.0)
    assert task.recording.marker_map == {"l_asis": "X"}
    assert task.recording.plates[2].use is False
    assert task.input.latency == "apply"


def test_members_name_the_session_of_their_recording(
    database_url: str, blobs: BlobStore, folder: Path, tmp_path: Path
) -> None:
    async def act(connection: AsyncConnection) -> Any:
        for key, session_id in {"one": "day", "two": "day", "three": None}.items():
            await store_recording(connection, blobs, tmp_path / "a", key, session_id=session_id)
        return await staging.stage_members(connection, blobs, ["one", "two", "three"], None, folder)

    members = within(database_url, act)
    assert [one.session_id for one in members] == ["day", "day", None]
    assert len({one.folder for one in members}) == 3


def test_members_get_the_delays_of_marker_events_from_the_rest_of_their_session(
    database_url: str, blobs: BlobStore, folder: Path, tmp_path: Path
) -> None:
    """Without the latency of the force: that of the session, or of a file with other equipment. Copies count once."""
    delays = EventDelays(strike=EventDelay(late_s=0.004, sd_s=0.003))
    facts = FACTS.model_copy(update={"event_delays": delays, "clock": TrialClock(latency_s=0.010, sd_s=0.001)})
    slower = facts.model_copy(update={"force_rate_hz": facts.force_rate_hz / 2, "clock": None})

    async def act(connection: AsyncConnection) -> Any:
        stored = {"one": FACTS, "two": facts, "copy": facts, "slow": slower}
        for key, of in stored.items():
            fields = {"session_id": "day", "facts": of.model_dump(mode="json")}
            if key == "copy":
                fields["sha256"] = hashlib.sha256(b"two").hexdigest()
            await store_recording(connection, blobs, tmp_path / "a", key, **fields)
        await store_recording(connection, blobs, tmp_path / "a", "other", facts=facts.model_dump(mode="json"))
        alone = await staging.stage_members(connection, blobs, ["one"], None, folder)
        both = await staging.stage_members(connection, blobs, ["one", "two", "slow", "other"], None, folder)
        return alone, both

    ((alone,), both) = within(database_url, act)
    late_s = [one.strike.late_s for one in alone.session_delays]
    assert late_s == pytest.approx([0.014, 0.004])
    assert all(one.lift_off is None for one in alone.session_delays)
    assert [one.session_delays for one in both] == [[], [], [], []], "members measure their own"


def test_a_recording_deleted_meanwhile_is_named(database_url: str, blobs: BlobStore, folder: Path) -> None:
    async def act(connection: AsyncConnection) -> Any:
        return await staging.stage_estimate_com(connection, blobs, EstimateComInput(recording_id="gone"), folder)

    with pytest.raises(NotFound) as refusal:
        within(database_url, act)
    assert refusal.value.code == "recording-not-found"


def test_a_simulation_becomes_a_recording_once_however_often_it_is_tried(
    database_url: str, blobs: BlobStore, folder: Path, tmp_path: Path
) -> None:
    (folder / "recording.c3d").write_bytes(b"c3d")
    (folder / "tracks.parquet").write_bytes(b"tracks")
    (folder / SIMULATED_FACTS_FILE).write_text(FACTS.model_dump_json())
    job_input = SimulateRecordingInput(seed=7)
    outcome = {"summary": {"speed_m_s": 1.2, "n_steps": 4}, "references": [], "artifacts": []}
    job_row = {"id": "j1", "owner": "lab", "input": job_input.model_dump(mode="json")}

    async def lost(connection: AsyncConnection) -> None:
        await connection.execute(insert(job).values(id="j1", kind="simulate-recording", input={}, input_hash="h"))
        await publish(connection, blobs, job_row, outcome, folder)
        raise ConnectionError("the worker died before the commit")

    async def act(connection: AsyncConnection) -> Any:
        staged = await staging.stage_input(connection, blobs, job_input, folder)
        assert SimulateRecordingTask.model_validate(staged).input == job_input
        await connection.execute(insert(job).values(id="j1", kind="simulate-recording", input={}, input_hash="h"))
        summary = await publish(connection, blobs, job_row, outcome, folder)
        stored = (await connection.execute(select(recording))).mappings().all()
        for key in ("blob_key", "tracks_key"):
            await blobs.get_file(stored[0][key], tmp_path / key)
        keys = [info.key async for info in blobs.list_prefix("recordings")]
        return summary, [dict(row) for row in stored], keys

    with pytest.raises(ConnectionError):
        within(database_url, lost)
    summary, stored, keys = within(database_url, act)
    assert len(stored) == 1
    assert len(keys) == 2, "the attempt that was lost leaves no file without an owner behind"
    assert summary == {"speed_m_s": 1.2, "n_steps": 4, "recording_id": stored[0]["id"]}
    assert stored[0]["truth_job_id"] == "j1"
    assert stored[0]["owner"] == "lab"
    assert stored[0]["bytes"] == 3
    assert stored[0]["sha256"] == hashlib.sha256(b"c3d").hexdigest()
    assert RecordingFacts.model_validate(stored[0]["facts"]) == FACTS
    assert (tmp_path / "blob_key").read_bytes() == b"c3d"
    assert (tmp_path / "tracks_key").read_bytes() == b"tracks"


@pytest.mark.parametrize("known", [True, False])
def test_a_comparison_gets_the_truth_of_a_recording_that_has_one(
    database_url: str, blobs: BlobStore, folder: Path, tmp_path: Path, known: bool
) -> None:
    async def act(connection: AsyncConnection) -> Any:
        await connection.execute(
            insert(job).values(id="j1", kind="simulate-recording", input={}, input_hash="h", blob_prefix="results/j1/1")
        )
        (tmp_path / "truth").write_bytes(b"truth")
        await blobs.put_file("results/j1/1/truth.parquet", tmp_path / "truth")
        await store_recording(connection, blobs, tmp_path / "a", "walk", truth_job_id="j1" if known else None)
        job_input = CompareEstimatorsInput(recording_id="walk", latency="apply")
        return await KINDS["compare-estimators"].stage(connection, blobs, job_input, folder)

    task = CompareEstimatorsTask.model_validate(within(database_url, act))
    assert task.input.latency == "apply"
    assert (folder / task.recording.file).read_bytes() == b"walk"
    if known:
        assert task.truth is not None
        assert (folder / task.truth).read_bytes() == b"truth"
    else:
        assert task.truth is None


def test_the_wheel_s_fit_gets_the_recording_and_its_own_options(
    database_url: str, blobs: BlobStore, folder: Path, tmp_path: Path
) -> None:
    async def act(connection: AsyncConnection) -> Any:
        await store_recording(connection, blobs, tmp_path / "a", "walk")
        job_input = FitCycloidInput(recording_id="walk", steps="all", latency=0.01)
        return await staging.stage_fit_cycloid(connection, blobs, job_input, folder)

    task = FitCycloidTask.model_validate(within(database_url, act))
    assert (task.input.steps, task.input.latency) == ("all", 0.01)
    assert (folder / task.recording.file).read_bytes() == b"walk"


def test_a_stored_scenario_becomes_part_of_the_task(database_url: str, blobs: BlobStore, folder: Path) -> None:
    async def act(connection: AsyncConnection) -> Any:
        await connection.execute(insert(scenario).values(id="s1", body=short_walk().model_dump(mode="json")))
        return await KINDS["plan-motion"].stage(
            connection, blobs, PlanMotionInput(scenario_id="s1", replay=True), folder
        )

    task = PlanMotionTask.model_validate(within(database_url, act))
    assert task.scenario == short_walk()
    assert task.input.replay


def test_a_scenario_in_the_input_needs_no_row(database_url: str, blobs: BlobStore, folder: Path) -> None:
    async def act(connection: AsyncConnection) -> Any:
        return await KINDS["plan-motion"].stage(connection, blobs, PlanMotionInput(scenario=short_walk()), folder)

    assert PlanMotionTask.model_validate(within(database_url, act)).scenario == short_walk()


def test_a_plan_of_the_whole_body_gets_the_stored_meshes_of_its_robot(
    database_url: str, blobs: BlobStore, folder: Path, tmp_path: Path
) -> None:
    (tmp_path / "stored").write_bytes(b"meshes")
    bodiless = PlanMotionInput(scenario=short_walk(), whole_body=False)

    async def act(connection: AsyncConnection) -> None:
        stage = KINDS["plan-motion"].stage
        await stage(connection, blobs, PlanMotionInput(scenario=short_walk()), folder)
        assert not any(folder.iterdir()), "not stored yet"
        await blobs.put_file(f"{cached_files_prefix(short_walk().robot)}/links.glb", tmp_path / "stored")
        await stage(connection, blobs, bodiless, folder)
        assert not any(folder.iterdir()), "without a body there is no file that shows it"
        await stage(connection, blobs, PlanMotionInput(scenario=short_walk()), folder)

    within(database_url, act)
    assert (folder / LINKS_FILE).read_bytes() == b"meshes"


def test_meshes_that_are_stored_while_a_plan_runs_reach_it(blobs: BlobStore, folder: Path, tmp_path: Path) -> None:
    (tmp_path / "stored").write_bytes(b"meshes")
    later, walk = KINDS["plan-motion"].stage_later, short_walk()

    def task(whole_body: bool) -> dict[str, Any]:
        request = PlanMotionInput(scenario=walk, whole_body=whole_body)
        return PlanMotionTask(scenario=walk, input=request).model_dump(mode="json")

    async def act() -> None:
        assert later is not None
        await asyncio.wait_for(later(blobs, task(whole_body=False), folder), 5.0)
        waiting = asyncio.ensure_future(later(blobs, task(whole_body=True), folder))
        done, _ = await asyncio.wait({waiting}, timeout=0.2)
        assert not done, "nothing is stored yet"
        await blobs.put_file(f"{cached_files_prefix(walk.robot)}/links.glb", tmp_path / "stored")
        await asyncio.wait_for(waiting, 10.0)

    asyncio.run(act())
    assert [path.name for path in folder.iterdir()] == [LINKS_FILE], "no half-written file beside it"
    assert (folder / LINKS_FILE).read_bytes() == b"meshes"


def test_a_scenario_deleted_meanwhile_is_named(database_url: str, blobs: BlobStore, folder: Path) -> None:
    async def act(connection: AsyncConnection) -> Any:
        return await KINDS["plan-motion"].stage(connection, blobs, PlanMotionInput(scenario_id="gone"), folder)

    with pytest.raises(NotFound) as refusal:
        within(database_url, act)
    assert refusal.value.code == "scenario-not-found"
    assert [fault.where for fault in refusal.value.faults] == ["scenario_id"]


def test_a_receding_horizon_takes_the_scenario_as_it_is_now(database_url: str, blobs: BlobStore, folder: Path) -> None:
    async def act(connection: AsyncConnection) -> Any:
        return await KINDS["plan-receding"].stage(connection, blobs, PlanRecedingInput(scenario=short_walk()), folder)

    assert PlanRecedingTask.model_validate(within(database_url, act)).scenario == short_walk()


def test_planning_contacts_stages_nothing(database_url: str, blobs: BlobStore, folder: Path) -> None:
    async def act(connection: AsyncConnection) -> Any:
        job_input = PlanContactsInput(robot="talos", terrain=ONE_STEP["terrain"], start=STANDING, goal=STANDING_AHEAD)
        return await staging.stage_input(connection, blobs, job_input, folder)

    assert PlanContactsTask.model_validate(within(database_url, act)).input.goal.contacts[0].position_m[0] == 0.5
    assert list(folder.iterdir()) == []


def test_learning_stages_nothing(database_url: str, blobs: BlobStore, folder: Path) -> None:
    async def act(connection: AsyncConnection) -> Any:
        job_input = LearnReachabilityInput(robot="talos", samples=500)
        return await staging.stage_input(connection, blobs, job_input, folder)

    assert LearnReachabilityTask.model_validate(within(database_url, act)).input.samples == 500
    assert list(folder.iterdir()) == []


def test_the_recordings_own_statement_wins_over_the_linked_subject() -> None:
    stated = staging.stated_subject({"sex": "male", "height_m": None}, {"height_m": 1.8, "sex": "female"})
    assert stated == SubjectFields(sex="male", height_m=1.8)
    assert staging.stated_subject({}, None) == SubjectFields()
