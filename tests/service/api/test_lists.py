"""Lists that are searched and sorted, page by page."""

from collections.abc import Iterator
from typing import Any

import httpx
import psycopg
import pytest

from stridelab.service.samples import scenarios
from support.service.stored_rows import add_job, add_recording, facts
from support.service.web_server import Served, refusal_code

API = "/api/v1"
FILES = {"r1": "b walk.c3d", "r2": "A run 100%.c3d", "r3": "c_walk.trc", "r4": "a run.c3d"}


@pytest.fixture(scope="module", autouse=True)
def stocked(service: Served) -> dict[str, str]:
    """Recordings, subjects, scenarios and jobs with names; returns the subjects' ids by name."""
    parts = service.parts
    service.run(scenarios.seed_scenarios(parts.engine))
    with service.http() as http:
        ids = {
            name: http.post(f"{API}/subjects", json={"name": name}).json()["subject_id"]
            for name in ("Zoe", "adam", "Mia")
        }
        ids[""] = http.post(f"{API}/subjects", json={}).json()["subject_id"]
    for recording_id, filename in FILES.items():
        more: dict[str, Any] = {"subject_id": ids["Mia"]} if recording_id == "r1" else {}
        if recording_id == "r3":
            more = {"session_id": "monday", "subject_fields": {"name": "P07"}}
        described = facts(marker_set="ior" if recording_id == "r2" else "plug-in-gait").model_dump(mode="json")
        service.run(add_recording(parts, recording_id, filename=filename, facts=described, **more))
    for recording_id in ("r1", "r2"):
        service.run(add_job(parts, recording_id))
    return ids


def every(http: httpx.Client, path: str, **query: Any) -> Iterator[dict[str, Any]]:
    cursor = None
    while True:
        answer = http.get(f"{API}/{path}", params={"limit": 1, **query, **({"cursor": cursor} if cursor else {})})
        assert answer.status_code == 200, answer.text
        yield from answer.json()["items"]
        cursor = answer.json()["next"]
        if cursor is None:
            return


def list_ids(http: httpx.Client, **query: Any) -> list[str]:
    return [item["id"] for item in every(http, "recordings", **query)]


@pytest.mark.parametrize(
    ("words", "ids"),
    [
        ("walk", ["r3", "r1"]),
        ("RUN c3d", ["r4", "r2"]),
        ("100%", ["r2"]),
        ("c_w", ["r3"]),  # neither % nor _ stands for another character
        ("mia", ["r1"]),
        ("p07 walk", ["r3"]),
        ("monday", ["r3"]),
        ("ior", ["r2"]),
        ("nothing of it", []),
        ("  ", ["r4", "r3", "r2", "r1"]),
    ],
)
def test_words_are_found_in_file_subject_session_and_marker_set(http: httpx.Client, words: str, ids: list[str]) -> None:
    assert list_ids(http, search=words) == ids


def test_recordings_are_sorted_by_time_or_by_name_in_any_case(http: httpx.Client) -> None:
    assert list_ids(http) == list_ids(http, sort="newest") == ["r4", "r3", "r2", "r1"]
    assert list_ids(http, sort="oldest") == ["r1", "r2", "r3", "r4"]
    assert list_ids(http, sort="name") == ["r2", "r4", "r1", "r3"]
    assert list_ids(http, sort="name", search="run") == ["r2", "r4"]
    assert refusal_code(http.get(f"{API}/recordings?sort=mass"))[0] == 422


def test_a_cursor_of_another_order_is_refused(http: httpx.Client) -> None:
    by_name = http.get(f"{API}/recordings?sort=name&limit=1").json()["next"]
    by_time = http.get(f"{API}/recordings?limit=1").json()["next"]
    assert refusal_code(http.get(f"{API}/recordings", params={"cursor": by_name})) == (422, "invalid-cursor")
    assert refusal_code(http.get(f"{API}/recordings", params={"sort": "name", "cursor": by_time})) == (
        422,
        "invalid-cursor",
    )


def test_names_that_are_long_or_equal_lose_no_item(http: httpx.Client, service: Served) -> None:
    name = "\U0001f9b6" * 200 + "x y"
    ids = [service.run(add_recording(service.parts, filename=name)) for _ in range(3)]
    assert sorted(list_ids(http, sort="name", search="\U0001f9b6")) == sorted(ids)
    for one in ids:
        assert http.delete(f"{API}/recordings/{one}").status_code == 204


def test_subjects_are_searched_and_sorted_by_pseudonym(http: httpx.Client, stocked: dict[str, str]) -> None:
    listed = [item["subject_id"] for item in every(http, "subjects", sort="name")]
    assert listed == [stocked[name] for name in ("", "adam", "Mia", "Zoe")]
    assert [item["name"] for item in every(http, "subjects", search="ADA")] == ["adam"]


def test_scenarios_are_searched_by_name_and_robot(http: httpx.Client) -> None:
    stored = http.get(f"{API}/scenarios").json()["items"]
    robot = stored[0]["robot"]
    assert {item["robot"] for item in every(http, "scenarios", search=robot)} == {robot}
    names = [item["name"] for item in every(http, "scenarios", sort="name")]
    assert names == sorted((item["name"] for item in stored), key=str.lower)


def test_jobs_are_searched_by_kind_and_by_the_name_of_their_recording(http: httpx.Client) -> None:
    assert [job["recording_id"] for job in every(http, "jobs", search="estimate")] == ["r2", "r1"]
    assert [job["recording_id"] for job in every(http, "jobs", search="100% estimate")] == ["r2"]
    assert list(every(http, "jobs", search="climb")) == []


@pytest.mark.parametrize(("path", "table"), [("recordings", "recording"), ("subjects", "subject"), ("jobs", "job")])
def test_rows_of_one_moment_are_listed_once_each(service: Served, http: httpx.Client, path: str, table: str) -> None:
    """One row a page: ids decide between rows whose times are equal."""
    key = "subject_id" if path == "subjects" else "id"
    ids = [item[key] for item in every(http, path)]
    assert len(ids) > 1
    with psycopg.connect(str(service.parts.settings.database_url)) as connection:
        connection.execute(f"CREATE TEMPORARY TABLE moments AS SELECT id, created_at FROM {table}")
        try:
            connection.execute(f"UPDATE {table} SET created_at = '2026-01-01T00:00:00.123456Z'")
            connection.commit()
            pages = [[item[key] for item in every(http, path, **query)] for query in ({}, {"limit": 2})]
        finally:
            connection.rollback()
            connection.execute(
                f"UPDATE {table} SET created_at = moments.created_at FROM moments WHERE moments.id = {table}.id"
            )
    for listed in pages:
        assert listed == sorted(set(listed), reverse=True)
        assert set(listed) == set(ids)
