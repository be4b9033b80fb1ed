"""Answers that are text are compressed for clients that accept it; stored tables and streams of events are not."""

import httpx
import pytest

from support.service.stored_rows import add_job
from support.service.web_server import Served


def sent_bytes(http: httpx.Client, path: str, encoding: str) -> tuple[httpx.Response, int]:
    with http.stream("GET", path, headers={"Accept-Encoding": encoding}) as answer:
        count = sum(map(len, answer.iter_raw()))
    return answer, count


@pytest.mark.parametrize(
    "path", ["/api/v1/openapi.json", "/", "/static/js/viewer/frame_decoder.js", "/static/css/app.css"]
)
def test_text_is_compressed(http: httpx.Client, path: str) -> None:
    plain, length = sent_bytes(http, path, "identity")
    assert "content-encoding" not in plain.headers
    packed, packed_length = sent_bytes(http, path, "gzip")
    assert packed.headers["content-encoding"] == "gzip"
    assert "accept-encoding" in packed.headers["vary"].lower()
    assert packed_length < 0.5 * length


def test_an_event_stream_arrives_event_by_event(http: httpx.Client, service: Served) -> None:
    job_id = service.run(add_job(service.parts))
    with http.stream("GET", f"/api/v1/jobs/{job_id}/events", headers={"Accept-Encoding": "gzip"}) as answer:
        assert "content-encoding" not in answer.headers
        assert next(answer.iter_lines())


def test_small_answers_are_not_compressed(http: httpx.Client) -> None:
    answer, _ = sent_bytes(http, "/api/v1/health", "gzip")
    assert "content-encoding" not in answer.headers
