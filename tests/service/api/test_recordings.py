"""Recordings once they are stored: listed, changed, deleted with all that belongs to them."""

import json
from pathlib import Path

import httpx
import pytest
from sqlalchemy import select

from stridelab.service.storage.tables import job, recording
from support.service.database import TestDatabases
from support.service.stored_rows import add_job, add_recording, facts, publish_result, start_job
from support.service.web_server import Served, fault_places, refusal_code, served, upload

RECORDINGS = "/api/v1/recordings"


@pytest.fixture(scope="module")
def uploaded(service: Served, trial: Path) -> str:
    with service.http() as http:
        answer = upload(http, trial.read_bytes())
    assert answer.status_code == 201, answer.text
    return str(answer.json()["id"])


def test_pages_of_the_list(postgres: TestDatabases, tmp_path: Path) -> None:
    with postgres.fresh() as url, served(url, tmp_path) as service, service.http() as http:
        ids = [service.run(add_recording(service.parts)) for _ in range(5)]
        listed_ids, cursor = [], None
        for _ in range(3):
            page = http.get(RECORDINGS, params={"limit": 2, **({"cursor": cursor} if cursor else {})}).json()
            listed_ids += [item["id"] for item in page["items"]]
            cursor = page["next"]
        assert listed_ids == ids[::-1]
        assert cursor is None
        assert http.get(RECORDINGS, params={"limit": 5}).json()["next"] is None
        for limit in ("0", "201", "x", "-1"):
            assert refusal_code(http.get(RECORDINGS, params={"limit": limit})) == (422, "invalid-request")


def test_stated_fields_win_over_the_subject_and_the_file(http: httpx.Client, service: Served) -> None:
    recording_id = service.run(add_recording(service.parts))
    subject = http.post("/api/v1/subjects", json={"name": "P1", "mass_kg": 61.0, "height_m": 1.6}).json()
    path = f"{RECORDINGS}/{recording_id}"
    assert http.get(path).json()["subject"]["mass_kg"] == 60.0
    http.patch(path, json={"subject_id": subject["subject_id"]})
    assert http.get(path).json()["subject"]["mass_kg"] == 61.0
    stated = http.patch(path, json={"subject": {"mass_kg": 62.0}}).json()
    assert stated["subject"] == {"name": "P1", "height_m": 1.6, "mass_kg": 62.0, "sex": None, "age_years": None}
    assert http.patch(path, json={"subject": {"mass_kg": None}}).json()["subject"]["mass_kg"] == 61.0
    http.delete(f"/api/v1/subjects/{subject['subject_id']}")
    unlinked = http.get(path).json()
    assert (unlinked["subject_id"], unlinked["subject"]["mass_kg"]) == (None, 60.0)


def test_a_name_inside_a_file_is_never_shown(http: httpx.Client, service: Served) -> None:
    leaking = json.loads('{"name": "Real Person", "mass_kg": 60.0}')

    async def leak() -> str:
        recording_id = await add_recording(service.parts)
        async with service.parts.engine.begin() as connection:
            row = (
                await connection.execute(select(recording.c.facts).where(recording.c.id == recording_id))
            ).scalar_one()
            row["subject"] = leaking
            await connection.execute(recording.update().where(recording.c.id == recording_id).values(facts=row))
        return str(recording_id)

    assert "Real Person" not in http.get(f"{RECORDINGS}/{service.run(leak())}").text


@pytest.mark.parametrize(
    ("patch", "where"),
    [
        ({"subject_id": "nope"}, "subject_id"),
        ({"subject_id": "\n"}, "subject_id"),
        ({"static_recording_id": "nope"}, "static_recording_id"),
        ({"marker_map": {"l_asis": "XYZ"}}, "marker_map"),
        ({"plates": {"7": {"use": False}}}, "plates.7"),
        ({"plates": {"1": {"threshold_n": 0}}}, "plates.1.threshold_n"),
        ({"plates": {"1": {"threshold_n": 1e999}}}, "plates.1.threshold_n"),
        ({"plates": {"1": {"belt_speed_m_s": 0}}}, "plates.1.belt_speed_m_s"),
        ({"plates": {"1": {"moment_offset_m": [0, 0, 0.6]}}}, "plates.1.moment_offset_m.2"),
        ({"subject": {"height_m": 17.1}}, "subject.height_m"),
        ({"filename": "x"}, "filename"),
    ],
)
def test_contradictory_changes_are_refused(
    http: httpx.Client, service: Served, patch: dict[str, object], where: str
) -> None:
    recording_id = service.run(add_recording(service.parts))
    before = http.get(f"{RECORDINGS}/{recording_id}").json()
    content = json.dumps(patch).replace("Infinity", "1e999")
    answer = http.patch(f"{RECORDINGS}/{recording_id}", content=content, headers={"Content-Type": "application/json"})
    assert refusal_code(answer) == (422, "invalid-request")
    assert fault_places(answer) == [where]
    assert http.get(f"{RECORDINGS}/{recording_id}").json() == before


def test_a_recording_is_not_its_own_static_trial(http: httpx.Client, service: Served) -> None:
    one, other = (service.run(add_recording(service.parts)) for _ in range(2))
    assert refusal_code(http.patch(f"{RECORDINGS}/{one}", json={"static_recording_id": one}))[0] == 422
    linked = http.patch(f"{RECORDINGS}/{one}", json={"static_recording_id": other}).json()
    assert linked["static_recording_id"] == other
    http.delete(f"{RECORDINGS}/{other}")
    assert http.get(f"{RECORDINGS}/{one}").json()["static_recording_id"] is None


def test_a_plate_switch_makes_the_file_be_read_again(http: httpx.Client, service: Served, uploaded: str) -> None:
    path = f"{RECORDINGS}/{uploaded}"
    before = http.get(path).json()
    assert before["plates"][0]["use"] is True
    files = service.stored_files()
    changed = http.patch(path, json={"plates": {"1": {"use": False}}}).json()
    assert changed["plates"][0]["use"] is False
    assert changed["windows_s"] == []
    assert len(service.stored_files()) == len(files)
    assert http.get(f"{path}/tracks.parquet").status_code == 200
    assert http.patch(path, json={"plates": None}).json() == before


def test_an_offset_of_the_moments_is_returned_and_reset(http: httpx.Client, uploaded: str) -> None:
    path = f"{RECORDINGS}/{uploaded}"
    before = http.get(path).json()
    assert before["plates"][0]["moment_offset_m"] is None
    changed = http.patch(path, json={"plates": {"1": {"moment_offset_m": [0.005, 0.0, -0.06]}}}).json()
    assert changed["plates"][0]["moment_offset_m"] == [0.005, 0.0, -0.06]
    assert http.patch(path, json={"plates": {"1": {"moment_offset_m": None}}}).json() == before


def test_a_belt_speed_is_compared_with_the_feet(http: httpx.Client, service: Served, uploaded: str) -> None:
    path = f"{RECORDINGS}/{uploaded}"
    before = http.get(path).json()
    answer = http.patch(path, json={"plates": {"1": {"belt_speed_m_s": 3.0}}})
    assert refusal_code(answer) == (422, "belt-speed-contradicts-feet")
    assert http.get(path).json() == before


def test_a_sample_is_read_only(http: httpx.Client, service: Served) -> None:
    recording_id = service.run(add_recording(service.parts, bundled=True))
    assert refusal_code(http.delete(f"{RECORDINGS}/{recording_id}")) == (409, "bundled-read-only")
    assert refusal_code(http.patch(f"{RECORDINGS}/{recording_id}", json={"subject": {}})) == (409, "bundled-read-only")


def test_a_deletion_takes_jobs_and_results_along(http: httpx.Client, service: Served) -> None:
    before = service.stored_files()
    recording_id = service.run(add_recording(service.parts))
    finished, running, queued = (service.run(add_job(service.parts, recording_id)) for _ in range(3))
    attempt = service.run(start_job(service.parts, finished))
    service.run(publish_result(service.parts, attempt, [("com.csv", "text/csv", b"time_s\n")]))
    service.run(start_job(service.parts, running))
    assert len(service.stored_files()) == len(before) + 3
    assert http.delete(f"{RECORDINGS}/{recording_id}").status_code == 204
    assert service.stored_files() == before
    for job_id in (finished, running, queued):
        assert refusal_code(http.get(f"/api/v1/jobs/{job_id}")) == (404, "job-not-found")

    async def left() -> int:
        async with service.parts.engine.connect() as connection:
            return len((await connection.execute(select(job.c.id).where(job.c.recording_id == recording_id))).all())

    assert service.run(left()) == 0


def test_a_recording_says_which_methods_can_estimate_it(http: httpx.Client, service: Served) -> None:
    def of(recording_id: str) -> dict[str, str | None]:
        estimates = http.get(f"{RECORDINGS}/{recording_id}").json()["estimates"]
        (listed,) = [one for one in http.get(RECORDINGS).json()["items"] if one["id"] == recording_id]
        assert listed["estimates"] == estimates
        assert all(one["possible"] == (one["reason"] is None) for one in estimates)
        return {one["method"]: one["code"] for one in estimates}

    methods = {"smoother", "complementary", "rts", "kalman", "geometry"}
    window = [(0.2, 0.8)]
    unweighed = facts(subject={}, mass_from_force_kg=None, windows_s=window).model_dump(mode="json")
    plain = service.run(add_recording(service.parts, facts=facts(windows_s=window).model_dump(mode="json")))
    assert of(plain) == dict.fromkeys(methods)
    bare = service.run(add_recording(service.parts, facts=facts(plates=[], windows_s=[]).model_dump(mode="json")))
    assert of(bare) == {**dict.fromkeys(methods, "no-plates"), "geometry": None}
    unknown = service.run(add_recording(service.parts, facts=facts(marker_set=None).model_dump(mode="json")))
    assert of(unknown) == dict.fromkeys(methods, "unknown-marker-set")
    light = service.run(add_recording(service.parts, facts=unweighed))
    assert of(light) == {**dict.fromkeys(methods, "mass-unknown"), "geometry": None}
    http.patch(f"{RECORDINGS}/{light}", json={"subject": {"mass_kg": 61.0}})
    assert of(light) == dict.fromkeys(methods)
    http.patch(f"{RECORDINGS}/{light}", json={"subject": None, "static_recording_id": plain})
    assert of(light) == dict.fromkeys(methods), "the static trial may weigh the person"
