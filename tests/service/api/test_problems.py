"""Every refusal is a problem: stable code, sentence, status; and every answer has its headers."""

import httpx
import pytest
from starlette.types import Message

from stridelab import errors
from stridelab.errors import StridelabError
from stridelab.service.api.middleware.request_context import HEADERS, RequestContextMiddleware
from stridelab.service.api.problems import STATUS, status_of
from stridelab.service.api.strict_json import parse_json
from support.service.web_server import Served

SUBJECTS = "/api/v1/subjects"


def problem(answer: httpx.Response) -> tuple[int, str]:
    """Status and code of an answer that must be a problem."""
    assert answer.headers["content-type"] == "application/problem+json"
    body = answer.json()
    assert body["status"] == answer.status_code
    assert body["detail"].endswith(".")
    assert body["title"]
    assert body["request_id"] == answer.headers["x-request-id"]
    return answer.status_code, body["code"]


@pytest.mark.parametrize("path", ["/api/v1/nothing", "/api/v1/recordings/x/y/z", "/api/", "/api/v1/subjects/"])
def test_an_unknown_path_is_not_found(http: httpx.Client, path: str) -> None:
    assert problem(http.get(path)) == (404, "unknown-path")


def test_a_wrong_method_is_refused_with_the_allowed_ones(http: httpx.Client) -> None:
    answer = http.put("/api/v1/health")
    assert problem(answer) == (405, "method-not-allowed")
    assert answer.headers["allow"] == "GET"


@pytest.mark.parametrize(
    ("content", "status", "code"),
    [
        (b"", 400, "not-json"),
        (b"{", 400, "not-json"),
        (b"height_m=1.7", 400, "not-json"),
        (b'{"height_m": NaN}', 400, "not-json"),
        (b'{"height_m": -Infinity}', 400, "not-json"),
        (b'{"height_m": 1e999}', 422, "invalid-request"),
        (b'{"name": "\xff"}', 400, "not-json"),
        (b"[" * 100_000, 400, "not-json"),
        (b'{"age_years": ' + b"9" * 5000 + b"}", 400, "not-json"),
        (b'{"name": "\\u0000"}', 422, "invalid-text"),
        (b'{"name": "\\ud800"}', 422, "invalid-text"),
        (b"[]", 422, "invalid-request"),
        (b"null", 422, "invalid-request"),
        (b'{"nonsense": 1}', 422, "invalid-request"),
        (b'{"height_m": 171}', 422, "invalid-request"),
        (b'{"name": "' + b"x" * 1_000_001 + b'"}', 413, "body-too-large"),
    ],
)
def test_malformed_bodies_are_refused(http: httpx.Client, content: bytes, status: int, code: str) -> None:
    answer = http.post(SUBJECTS, content=content, headers={"Content-Type": "application/json"})
    assert problem(answer) == (status, code)


def test_a_body_without_announced_length_is_cut_off_at_the_limit(http: httpx.Client) -> None:
    pieces = (b" " * 100_000 for _ in range(50))
    answer = http.post(SUBJECTS, content=pieces, headers={"Content-Type": "application/json"})
    assert problem(answer) == (413, "body-too-large")


@pytest.mark.parametrize("media_type", ["text/plain", "application/x-www-form-urlencoded", "application/xml", ""])
def test_other_content_types_are_refused(http: httpx.Client, media_type: str) -> None:
    answer = http.post(SUBJECTS, content=b"{}", headers={"Content-Type": media_type})
    assert problem(answer) == (415, "unsupported-media-type")


def test_a_refused_field_is_named_and_its_value_is_not_repeated(http: httpx.Client) -> None:
    answer = http.post(SUBJECTS, json={"height_m": 171, "sex": "Jane Doe"})
    faults = answer.json()["errors"]
    assert [fault["where"] for fault in faults] == ["height_m", "sex"]
    assert "Jane" not in answer.text


@pytest.mark.parametrize("what", ["recordings", "subjects", "jobs"])
@pytest.mark.parametrize("identifier", ["nope", "%00", "..", "a%2Fb", "x" * 300, "%F0%9F%A6%B4", "%ff"])
def test_an_unknown_id_is_not_found(http: httpx.Client, what: str, identifier: str) -> None:
    status, code = problem(http.get(f"/api/v1/{what}/{identifier}"))
    assert status == 404
    assert code in {f"{what.removesuffix('s')}-not-found", "unknown-path"}


@pytest.mark.parametrize("cursor", ["x", "%00", "bm9uc2Vuc2U", "MjAyNi0wMS0wMSBhAGI", "%F0%9F%A6%B4"])
@pytest.mark.parametrize("what", ["recordings", "subjects", "scenarios", "jobs"])
def test_a_foreign_cursor_is_refused(http: httpx.Client, what: str, cursor: str) -> None:
    status, code = problem(http.get(f"/api/v1/{what}?cursor={cursor}"))
    assert (status, code) == (422, "invalid-cursor")


@pytest.mark.parametrize("path", ["/api/v1/health", "/api/v1/nothing", "/metrics", "/api/v1/openapi.json"])
def test_every_answer_is_protected(http: httpx.Client, path: str) -> None:
    headers = http.get(path).headers
    assert {name: headers[name] for name in HEADERS} == HEADERS
    policy = headers["content-security-policy"]
    assert "unsafe" not in policy
    assert "frame-ancestors 'self'" in policy


def test_pages_and_scenes_get_no_weaker_policy_from_here(http: httpx.Client) -> None:
    for path in ("/view/", "/view/scene/"):
        assert "unsafe" not in http.get(path).headers["content-security-policy"]


def test_an_unexpected_error_reveals_no_internals(service: Served) -> None:
    def broken() -> None:
        raise RuntimeError("the secret inside")

    service.app.add_api_route("/api/v1/broken", broken)
    with service.http() as http:
        answer = http.get("/api/v1/broken")
    assert problem(answer) == (500, "internal-error")
    assert "secret" not in answer.text
    assert {name: answer.headers[name] for name in HEADERS} == HEADERS


@pytest.mark.anyio
async def test_an_answer_that_breaks_off_is_not_completed() -> None:
    async def app(scope: object, receive: object, send: object) -> None:
        assert callable(send)
        await send({"type": "http.response.start", "status": 200, "headers": []})
        raise RuntimeError("half way")

    messages: list[Message] = []

    async def send(message: Message) -> None:
        messages.append(message)

    async def receive() -> Message:
        return {"type": "http.request"}

    with pytest.raises(RuntimeError, match="half way"):
        await RequestContextMiddleware(app)(
            {"type": "http", "method": "GET", "path": "/", "headers": []}, receive, send
        )
    assert [message["type"] for message in messages] == ["http.response.start"]


def test_every_error_class_has_a_status() -> None:
    classes = {cls for cls in vars(errors).values() if isinstance(cls, type) and issubclass(cls, StridelabError)}
    assert classes - {StridelabError} == set(STATUS)


def test_a_subclass_takes_the_status_of_its_ancestor() -> None:
    class Special(errors.Conflict):
        """An error class that is in no list."""

    assert status_of(Special("c", "m")) == 409
    assert status_of(StridelabError("c", "m")) == 500


def test_plain_json_is_read_as_python_reads_it() -> None:
    assert parse_json('{"a": [1, 2.5, "ü", null, true]}'.encode()) == {"a": [1, 2.5, "ü", None, True]}
