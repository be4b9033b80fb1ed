"""Uploads that are estimated at once."""

from pathlib import Path

import httpx
import pytest

from stridelab.service.api.recordings import endpoints, parse
from support.service.stored_rows import facts
from support.service.web_server import Served, upload


async def estimable(_parts: object, folder: Path, *_: object, **_options: object) -> parse.Parsed:
    (folder / "tracks.parquet").write_bytes(b"PAR1")
    return parse.Parsed(facts(), folder / "tracks.parquet")


async def not_estimable(_parts: object, folder: Path, *_: object, **_options: object) -> parse.Parsed:
    (folder / "tracks.parquet").write_bytes(b"PAR1")
    return parse.Parsed(facts(marker_set=None), folder / "tracks.parquet")


def test_an_upload_is_estimated_at_once_if_the_settings_say_so(
    service: Served, http: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(endpoints, "parse_recording", estimable)
    assert "stridelab-estimate" not in upload(http, b"not by default").headers
    settings = service.parts.settings.model_copy(update={"estimate_uploads": True})
    parts = service.parts.__class__(**{**vars(service.parts), "settings": settings})
    monkeypatch.setitem(service.app.state._state, "parts", parts)
    answer = upload(http, b"at once")
    job = http.get(f"/api/v1/jobs/{answer.headers['stridelab-estimate']}").json()
    assert (job["kind"], job["recording_id"]) == ("estimate-com", answer.json()["id"])
    # Neither a full queue nor a recording without a method for it refuses an upload.
    monkeypatch.setattr(parts.store, "_queue_limit", 0)
    full = upload(http, b"while the queue is full")
    assert (full.status_code, "stridelab-estimate" in full.headers) == (201, False)
    monkeypatch.undo()
    monkeypatch.setattr(endpoints, "parse_recording", not_estimable)
    monkeypatch.setitem(service.app.state._state, "parts", parts)
    none = upload(http, b"no method")
    assert (none.status_code, "stridelab-estimate" in none.headers) == (201, False)
