"""Sessions over HTTP: grouped by person and day, stated, listed, left and joined again; their values in jobs."""

import asyncio
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import httpx
import pytest
from sqlalchemy import select, update

from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.recordings import TrialClock
from stridelab.schemas.tasks import EstimateComTask
from stridelab.service.kinds import staging
from stridelab.service.recording_sessions import session_id_of
from stridelab.service.storage.tables import recording
from support.recordings.c3d_files import small_trial
from support.service.stored_rows import add_recording, facts
from support.service.web_server import Served, fault_places, refusal_code, upload

RECORDINGS = "/api/v1/recordings"
NOW = datetime(2026, 3, 1, 12, tzinfo=UTC)


@pytest.fixture(scope="module")
def trials(tmp_path_factory: pytest.TempPathFactory) -> list[bytes]:
    """Different files of one laboratory."""
    folder = tmp_path_factory.mktemp("trials")
    return [small_trial(folder / f"{k}.c3d", seconds=1.0 + 0.1 * k).read_bytes() for k in range(3)]


def session_of(http: httpx.Client, content: bytes, **fields: str) -> dict[str, Any]:
    answer = upload(http, content, **fields)
    assert answer.status_code == 201, answer.text
    return dict(answer.json())


def listed(http: httpx.Client, session_id: str) -> set[str]:
    page = http.get(RECORDINGS, params={"session_id": session_id}).json()
    return {item["id"] for item in page["items"]}


def test_trials_of_one_person_and_day_find_each_other(http: httpx.Client, trials: Sequence[bytes]) -> None:
    first, second, other = (
        session_of(http, content, subject_name=name) for content, name in zip(trials, ("P7", "P7", "P8"), strict=True)
    )
    assert first["session_id"] == second["session_id"] != other["session_id"]
    assert not first["session_stated"]
    assert listed(http, first["session_id"]) == {first["id"], second["id"]}
    assert listed(http, "no-such-session") == set()
    assert refusal_code(http.get(RECORDINGS, params={"session_id": "a b"})) == (422, "invalid-request")


def test_height_and_mass_tell_who_it_is_and_nothing_tells_nothing(http: httpx.Client, trials: Sequence[bytes]) -> None:
    body = {"height_m": "1.83", "mass_kg": "77.7"}
    one, same = (session_of(http, content, **body) for content in trials[:2])
    assert one["session_id"] == same["session_id"] is not None
    assert session_of(http, trials[2], **{**body, "mass_kg": "77.8"})["session_id"] != one["session_id"]
    assert session_of(http, trials[2])["session_id"] is None
    assert session_of(http, trials[2], height_m="1.83")["session_id"] is None


def test_a_stated_session_stands_until_it_is_taken_back(http: httpx.Client, trials: Sequence[bytes]) -> None:
    stated = session_of(http, trials[0], session_id="gait-lab.2026-03-01", subject_name="P9")
    assert (stated["session_id"], stated["session_stated"]) == ("gait-lab.2026-03-01", True)
    path = f"{RECORDINGS}/{stated['id']}"
    renamed = http.patch(path, json={"subject": {"name": "P10"}}).json()
    assert renamed["session_id"] == "gait-lab.2026-03-01"
    reset = http.patch(path, json={"session_id": None}).json()
    other = session_of(http, trials[1], subject_name="P10")
    assert (reset["session_id"], reset["session_stated"]) == (other["session_id"], False)
    moved = http.patch(path, json={"session_id": "b"}).json()
    assert (moved["session_id"], moved["session_stated"]) == ("b", True)


@pytest.mark.parametrize("session_id", ["a b", "ä", "x" * 65, "a/b"])
def test_a_session_that_is_no_name_is_refused(http: httpx.Client, trials: Sequence[bytes], session_id: str) -> None:
    answer = upload(http, trials[0], session_id=session_id)
    assert refusal_code(answer) == (422, "invalid-request")
    assert fault_places(answer) == ["session_id"]
    stored = session_of(http, trials[0])
    answer = http.patch(f"{RECORDINGS}/{stored['id']}", json={"session_id": session_id})
    assert refusal_code(answer) == (422, "invalid-request")


def test_the_session_follows_the_person(http: httpx.Client, trials: Sequence[bytes]) -> None:
    unnamed, named = session_of(http, trials[0]), session_of(http, trials[1])
    subject = http.post("/api/v1/subjects", json={"name": "S"}).json()["subject_id"]
    session_ids = {
        http.patch(f"{RECORDINGS}/{one['id']}", json={"subject_id": subject}).json()["session_id"]
        for one in (unnamed, named)
    }
    assert len(session_ids) == 1
    assert session_ids != {None}
    without_subject = http.patch(f"{RECORDINGS}/{unnamed['id']}", json={"subject_id": None}).json()
    assert without_subject["session_id"] is None


def test_a_recording_of_an_earlier_version_is_read_again(http: httpx.Client, service: Served) -> None:
    """Its facts know of no clock; stating or finding its session makes them complete."""
    stored = session_of(http, small_trial(service.data / "old.c3d", seconds=1.5).read_bytes(), subject_name="old")

    async def forget() -> None:
        async with service.parts.engine.begin() as connection:
            mine = recording.c.id == stored["id"]
            known = (await connection.execute(select(recording.c.facts).where(mine))).scalar_one()
            for name in ("clock", "still", "recorded_on", "simulated", "mass_from_force_sd_kg"):
                del known[name]
            await connection.execute(update(recording).where(mine).values(facts=known, session_id=None))

    async def names() -> set[str]:
        async with service.parts.engine.connect() as connection:
            query = select(recording.c.facts).where(recording.c.id == stored["id"])
            return set((await connection.execute(query)).scalar_one())

    service.run(forget())
    assert http.get(f"{RECORDINGS}/{stored['id']}").json()["clock"] is None
    again = http.patch(f"{RECORDINGS}/{stored['id']}", json={"session_id": None}).json()
    assert again["session_id"] == stored["session_id"]
    assert {"clock", "still"} <= service.run(names())


def test_another_day_is_another_session() -> None:
    row: dict[str, Any] = {"owner": None, "subject_fields": {"name": "P"}, "facts": facts().model_dump(mode="json")}
    today = session_id_of(row, NOW)
    assert session_id_of(row, NOW + timedelta(hours=11)) == today
    assert session_id_of(row, NOW + timedelta(days=1)) != today
    dated = {**row, "facts": facts(recorded_on="2026-02-03").model_dump(mode="json")}
    assert session_id_of(dated, NOW) == session_id_of(dated, NOW + timedelta(days=40)) != today
    assert session_id_of({**row, "owner": "another"}, NOW) != today


def test_a_simulated_body_has_no_subject_unless_one_is_stated() -> None:
    body = {"subject": {"height_m": 1.7, "mass_kg": 60.0}, "simulated": True}
    row: dict[str, Any] = {"owner": None, "subject_fields": {}, "facts": facts(**body).model_dump(mode="json")}
    assert session_id_of(row, NOW) is None
    assert session_id_of({**row, "facts": {**row["facts"], "simulated": False}}, NOW) is not None
    assert session_id_of({**row, "subject_fields": {"name": "P"}}, NOW) is not None


def task_of(service: Served, recording_id: str, folder: Path) -> EstimateComTask:
    folder.mkdir()

    async def stage() -> Any:
        async with service.parts.engine.begin() as connection:
            job_input = EstimateComInput(recording_id=recording_id)
            return await staging.stage_estimate_com(connection, service.parts.blobs, job_input, folder)

    return EstimateComTask.model_validate(service.run(stage()))


def add_trials(service: Served, session_id: str, latencies_ms: Sequence[float], owner: str | None = None) -> list[str]:
    async def add(latency_ms: float) -> str:
        known = facts(
            clock=TrialClock(latency_s=latency_ms / 1e3, sd_s=0.001), mass_from_force_kg=61.0, mass_from_force_sd_kg=0.6
        )
        columns = {"facts": known.model_dump(mode="json"), "session_id": session_id, "owner": owner}
        return str(await add_recording(service.parts, **columns))

    return [service.run(add(one)) for one in latencies_ms]


def test_a_job_is_given_the_values_of_its_session(service: Served, tmp_path: Path) -> None:
    ids = add_trials(service, "staged", [17.0, 18.0, 19.0])
    add_trials(service, "staged", [40.0], owner="somebody else")
    add_trials(service, "elsewhere", [40.0])
    tasks = [task_of(service, one, tmp_path / one) for one in ids]
    assert all(task.session == tasks[0].session for task in tasks)
    session = tasks[0].session
    assert session is not None
    assert session.session_id == "staged"
    assert session.latency_s == pytest.approx(0.018, abs=1e-9)
    assert session.latency_n_trials == session.mass_n_trials == 3
    assert [one.recording_id for one in session.trials] == sorted(ids)
    assert session.static_recording_id is None
    assert tasks[0].static is None


def test_a_job_of_a_recording_alone_is_given_no_session(service: Served, tmp_path: Path) -> None:
    (alone,) = add_trials(service, "only-one", [17.0])
    assert task_of(service, alone, tmp_path / "task").session is None


def test_the_static_trial_of_the_session_is_fetched_unless_another_is_stated(service: Served, tmp_path: Path) -> None:
    (walk,) = add_trials(service, "with-static", [17.0])
    still = facts(still=True, plates=[], windows_s=[], mass_from_force_kg=None).model_dump(mode="json")

    async def add(**columns: Any) -> str:
        return str(await add_recording(service.parts, facts=still, filename="static.c3d", **columns))

    from_session, stated = service.run(add(session_id="with-static")), service.run(add())
    task = task_of(service, walk, tmp_path / "task")
    assert task.static is not None
    assert task.session is not None
    assert task.session.static_recording_id == from_session
    assert task.session.latency_s is None, "no other recording has a clock"

    async def link() -> None:
        async with service.parts.engine.begin() as connection:
            change = update(recording).where(recording.c.id == walk).values(static_recording_id=stated)
            await connection.execute(change)

    service.run(link())
    task = task_of(service, walk, tmp_path / "stated")
    assert task.static is not None
    assert task.session is None


def test_the_map_may_name_labels_of_the_static_trial(http: httpx.Client, service: Served, tmp_path: Path) -> None:
    walk = session_of(http, small_trial(tmp_path / "walk.c3d", seconds=1.7).read_bytes(), session_id="mapped")
    path, patch = f"{RECORDINGS}/{walk['id']}", {"marker_map": {"l_knee_medial": "LMEPI"}}
    assert refusal_code(http.patch(path, json=patch)) == (422, "invalid-request")
    known = facts(still=True, labels=["LASI", "LMEPI"]).model_dump(mode="json")
    service.run(add_recording(service.parts, facts=known, session_id="mapped"))
    changed = http.patch(path, json=patch)
    assert changed.status_code == 200, changed.text
    assert changed.json()["marker_map"] == patch["marker_map"]
    assert "l_knee_medial" not in changed.json()["landmarks"]
    assert refusal_code(http.patch(path, json={"marker_map": {"l_knee_medial": "NONE"}})) == (422, "invalid-request")


def test_uploads_at_once_are_one_session(service: Served, trials: Sequence[bytes]) -> None:
    async def send() -> list[httpx.Response]:
        async with httpx.AsyncClient(base_url=service.base_url, timeout=60.0, verify=False) as http:
            return await asyncio.gather(
                *(
                    http.post(RECORDINGS, files={"file": ("w.c3d", one)}, data={"subject_name": "at once"})
                    for one in trials
                )
            )

    answers = asyncio.run(send())
    assert [one.status_code for one in answers] == [201] * len(trials)
    assert len({one.json()["session_id"] for one in answers}) == 1
