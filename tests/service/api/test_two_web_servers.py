"""Two web servers on one database and one store, as behind a proxy: changes through one are visible in the other."""

import json
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import pytest

from support.recordings.c3d_files import small_trial
from support.service.web_server import Served, served, upload

TOKEN = "the-admin-token-of-this-test"


@pytest.fixture
def pair(database_url: str, tmp_path: Path) -> Iterator[tuple[Served, Served]]:
    shared = {"api_token": TOKEN, "blob_url": (tmp_path / "blobs").as_uri()}
    with ExitStack() as stack:
        one, other = (stack.enter_context(served(database_url, tmp_path / name, **shared)) for name in ("one", "other"))
        yield one, other


def client(server: Served, token: str = TOKEN) -> httpx.Client:
    return server.http(headers={"Authorization": f"Bearer {token}"})


def test_events_of_a_job_reach_the_listeners_of_every_web_server(pair: tuple[Served, Served]) -> None:
    with client(pair[0]) as one, client(pair[1]) as other:
        job_id = one.post("/api/v1/jobs/reproduce", json={"item": "fig-2.2"}).raise_for_status().json()["id"]
        events_by_server: dict[int, list[dict[str, Any]]] = {0: [], 1: []}
        listening = threading.Barrier(3, timeout=20)

        def listen(index: int, http: httpx.Client) -> None:
            with http.stream("GET", f"/api/v1/jobs/{job_id}/events") as answer:
                lines = answer.iter_lines()
                for line in lines:
                    if line.startswith("data: "):
                        events_by_server[index].append(json.loads(line.removeprefix("data: ")))
                        if len(events_by_server[index]) == 1:
                            listening.wait()

        threads = [threading.Thread(target=listen, args=(k, http)) for k, http in enumerate((one, other))]
        for thread in threads:
            thread.start()
        listening.wait()
        assert other.delete(f"/api/v1/jobs/{job_id}").status_code == 200
        for thread in threads:
            thread.join(20)
        assert [event["state"] for event in events_by_server[0]] == ["queued", "cancelled"]
        assert events_by_server[0] == events_by_server[1]


def test_logins_tokens_and_recordings_are_those_of_both(pair: tuple[Served, Served], tmp_path: Path) -> None:
    with client(pair[0]) as one, client(pair[1]) as other:
        token = one.post("/api/v1/tokens", json={"name": "lab", "scope": "submit"}).raise_for_status().json()
        with client(pair[1], token["secret"]) as member:
            stored = upload(member, small_trial(tmp_path / "walk.c3d", seconds=1.0).read_bytes()).json()
            recording = f"/api/v1/recordings/{stored['id']}"
            assert one.get(recording).json() == stored
            assert one.get(f"{recording}/file").content == other.get(f"{recording}/file").content
            one.delete(f"/api/v1/tokens/{token['id']}").raise_for_status()
            end_s = time.monotonic() + 10
            while member.get("/api/v1/recordings").status_code != 401 and time.monotonic() < end_s:
                time.sleep(0.1)
            assert member.get("/api/v1/recordings").status_code == 401
    with pair[0].http() as browser:
        answer = browser.post("/login", data={"token": TOKEN}, headers={"Origin": pair[0].base_url})
        cookies = dict(answer.cookies)
    assert cookies
    with pair[1].http(cookies=cookies) as browser:
        assert browser.get("/api/v1/recordings").status_code == 200
