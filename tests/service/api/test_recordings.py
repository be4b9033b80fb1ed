"""Recordings: what is stored, what is refused, and that nothing is half stored."""

import hashlib
from pathlib import Path

import httpx

from support.service import Served


def upload(http: httpx.Client, content: bytes, name: str = "walk.c3d", **fields: str) -> httpx.Response:
    return http.post("/api/v1/recordings", files={"file": (name, content)}, data=fields)


def test_an_upload_is_understood_when_it_is_answered(http: httpx.Client, service: Served, trial: Path) -> None:
    content = trial.read_bytes()
    answer = upload(http, content, height_m="1.71", sex="female", subject_name="P07", mass_kg="")
    assert answer.status_code == 201, answer.text
    body = answer.json()
    assert answer.headers["location"] == f"/api/v1/recordings/{body['id']}"
    assert body["sha256"] == hashlib.sha256(content).hexdigest()
    assert body["bytes"] == len(content)
    assert body["n_markers"] == 12
    assert body["marker_rate_hz"] == 100.0
    assert body["subject"] == {"name": "P07", "height_m": 1.71, "mass_kg": None, "sex": "female", "age_years": None}
    assert http.get(f"/api/v1/recordings/{body['id']}").json() == body
    assert http.get(f"/api/v1/recordings/{body['id']}/file").content == content
