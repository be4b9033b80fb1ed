"""Tokens of the table: scopes, expiry, revocation, owners, limits, and the audit log."""

import re
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from typing import Any

import httpx
import psycopg
import pytest

from stridelab.errors import Busy
from stridelab.service.api.middleware.authentication import BURST_S, RateLimiter
from stridelab.service.auth import audit
from stridelab.service.auth.callers import needed_scope
from support.service.database import TestDatabases
from support.service.stored_rows import add_job, add_recording
from support.service.web_server import Served, served

ADMIN = "a-secret-of-the-lab"
TOKENS, SUBJECTS, JOBS = "/api/v1/tokens", "/api/v1/subjects", "/api/v1/jobs"
SIMULATION = f"{JOBS}/simulate-recording"


def bearer(secret: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {secret}"}


@pytest.fixture(scope="module")
def lab(postgres: TestDatabases, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    options = {"api_token": ADMIN, "user_queue_limit": 2, "user_storage_mb": 1}
    with postgres.fresh() as url, served(url, tmp_path_factory.mktemp("data"), **options) as running:
        yield running


@pytest.fixture
def admin(lab: Served) -> Iterator[httpx.Client]:
    with lab.http(headers=bearer(ADMIN)) as client:
        yield client


def make(admin: httpx.Client, name: str, **fields: Any) -> dict[str, Any]:
    answer = admin.post(TOKENS, json={"name": name, **fields})
    assert answer.status_code == 201, answer.text
    return dict(answer.json())


def code(answer: httpx.Response) -> tuple[int, str]:
    return answer.status_code, answer.json()["code"]


def rows_of(lab: Served, query: str) -> list[Any]:
    with psycopg.connect(str(lab.parts.settings.database_url)) as connection:
        return connection.execute(query).fetchall()


def test_a_secret_is_shown_once_and_only_its_hash_is_stored(lab: Served, admin: httpx.Client) -> None:
    token_made = make(admin, "once")
    assert token_made["scope"] == "submit"
    assert re.fullmatch(r"stridelab_[\w-]{43}", token_made["secret"])
    assert token_made["secret"] not in admin.get(TOKENS).text
    assert token_made["secret"] not in str(rows_of(lab, "SELECT * FROM token")) + str(
        rows_of(lab, "SELECT * FROM audit")
    )
    assert code(admin.post(TOKENS, json={"name": "once"})) == (409, "token-name-taken")
    assert code(admin.post(TOKENS, json={"name": "admin"})) == (409, "token-name-taken")
    assert admin.post(TOKENS, json={"name": "no spaces"}).status_code == 422


def test_each_scope_allows_what_it_names(lab: Served, admin: httpx.Client) -> None:
    secrets = {scope: make(admin, f"a-{scope}", scope=scope)["secret"] for scope in ("read", "submit", "admin")}
    allowed: dict[str, list[int]] = {}
    for scope, secret in secrets.items():
        with lab.http(headers=bearer(secret)) as http:
            allowed[scope] = [
                http.get(SUBJECTS).status_code,
                http.post(SUBJECTS, json={}).status_code,
                http.get(TOKENS).status_code,
                http.get("/api/v1/audit").status_code,
            ]
            assert http.get("/api/v1/caller").json() == {"name": f"a-{scope}", "scope": scope}
    assert allowed == {"read": [200, 403, 403, 403], "submit": [200, 201, 403, 403], "admin": [200, 201, 200, 200]}


@pytest.mark.parametrize(
    ("kind", "method", "path", "scope"),
    [
        ("http", "GET", "/api/v1/jobs", "read"),
        ("http", "DELETE", "/api/v1/jobs/1", "submit"),
        ("http", "PATCH", "/api/v1/subjects/1", "submit"),
        ("http", "GET", "/api/v1/tokens", "admin"),
        ("http", "DELETE", "/api/v1/tokens/1", "admin"),
        ("http", "GET", "/api/v1/audit", "admin"),
        ("websocket", "", "/api/v1/stream/com", "submit"),
        ("websocket", "", "/api/v1/stream/markers", "submit"),
        ("websocket", "", "/api/v1/stream/markers/0123456789abcdef", "read"),
        ("http", "POST", "/api/v1/stream/markers/0123456789abcdef", "submit"),
        (
            "websocket",
            "",
            "/view/scene/scenario/1/-",
            "read",
        ),  # drags need more: test_drags.py
        ("http", "GET", "/metrics", "read"),
        ("http", "UNHEARD-OF", "/api/v1/jobs", "submit"),
    ],
)
def test_each_request_needs_its_scope(kind: str, method: str, path: str, scope: str) -> None:
    assert needed_scope(kind, method, path) == scope


def test_a_revoked_token_and_its_cookie_are_refused_at_once(lab: Served, admin: httpx.Client) -> None:
    token_made = make(admin, "leaver")
    with lab.http() as browser, lab.http(headers=bearer(token_made["secret"])) as script:
        assert browser.post("/login", data={"token": token_made["secret"]}).headers["location"] == "/"
        assert browser.get(SUBJECTS).status_code == script.get(SUBJECTS).status_code == 200
        assert code(browser.get(TOKENS)) == (403, "scope-missing")
        assert admin.delete(f"{TOKENS}/{token_made['id']}").json()["revoked_at"] is not None
        assert code(script.get(SUBJECTS)) == (401, "login-needed")
        assert code(browser.get(SUBJECTS)) == (401, "login-needed")
    assert code(admin.delete(f"{TOKENS}/{token_made['id']}")) == (404, "token-not-found")
    make(admin, "leaver")  # the name is free again


def test_a_revocation_elsewhere_and_an_expiry_are_noticed(lab: Served, admin: httpx.Client) -> None:
    for change in ("revoked_at", "expires_at"):
        token_made = make(admin, f"by-{change[:7]}", days=1)
        with lab.http(headers=bearer(token_made["secret"])) as http:
            assert http.get(SUBJECTS).status_code == 200
            with psycopg.connect(str(lab.parts.settings.database_url)) as connection:
                connection.execute(f"UPDATE token SET {change} = now() WHERE id = %s", (token_made["id"],))
            lab.parts.tokens._read_at_s -= 2.0  # instead of waiting for STALE_S
            assert http.get(SUBJECTS).status_code == 401


def test_an_upload_whose_token_is_revoked_meanwhile_stores_nothing(
    lab: Served, admin: httpx.Client, trial: Path
) -> None:
    token_made = make(admin, "leaver-with-a-file")
    head = b'--b\r\nContent-Disposition: form-data; name="file"; filename="walk.c3d"\r\n\r\n'

    def pieces() -> Iterator[bytes]:
        content = trial.read_bytes()
        yield head + content[:5000]
        assert admin.delete(f"{TOKENS}/{token_made['id']}").status_code == 200
        yield content[5000:] + b"\r\n--b--\r\n"

    with lab.http(headers=bearer(token_made["secret"])) as http:
        form = {"Content-Type": "multipart/form-data; boundary=b"}
        assert code(http.post("/api/v1/recordings", content=pieces(), headers=form)) == (401, "login-needed")
    assert not rows_of(lab, "SELECT id FROM recording WHERE owner = 'leaver-with-a-file'")


def test_jobs_and_recordings_belong_to_the_user_that_created_them(lab: Served, admin: httpx.Client) -> None:
    one, other = (make(admin, name)["secret"] for name in ("owner", "colleague"))
    with lab.http(headers=bearer(one)) as mine, lab.http(headers=bearer(other)) as theirs:
        submitted = mine.post(SIMULATION, json={}).json()
        subject = mine.post(SUBJECTS, json={}).json()["subject_id"]
        lab.run(add_recording(lab.parts, "r1"))
        with psycopg.connect(str(lab.parts.settings.database_url)) as connection:
            connection.execute("UPDATE recording SET owner = 'owner' WHERE id = 'r1'")
        body = {"name": "of the owner", "landmarks": {"c7": "A"}, "required": ["c7"]}
        marker_set = mine.post("/api/v1/marker-sets", json=body).headers["location"]
        places = (f"{JOBS}/{submitted['id']}", f"{SUBJECTS}/{subject}", "/api/v1/recordings/r1", marker_set)
        assert submitted["owner"] == "owner"
        for place in places:
            assert theirs.get(place).status_code == 200
            assert code(theirs.delete(place)) == (403, "not-owner")
        assert mine.delete(places[0]).json()["state"] == "cancelled"
        assert [mine.delete(place).status_code for place in places[1:]] == [204, 204, 204]
        nobodys = lab.run(add_job(lab.parts))
        assert theirs.delete(f"{JOBS}/{nobodys}").status_code == 200
        another = mine.post(SIMULATION, json={}).json()["id"]
        assert admin.delete(f"{JOBS}/{another}").json()["state"] == "cancelled"


def test_waiting_jobs_of_one_user_are_limited(lab: Served, admin: httpx.Client) -> None:
    with lab.http(headers=bearer(make(admin, "eager")["secret"])) as http:
        jobs = [http.post(SIMULATION, json={}).json()["id"] for _ in range(2)]
        refused = http.post(SIMULATION, json={})
        assert code(refused) == (429, "user-queue-full")
        assert "2 of your jobs" in refused.json()["detail"]
        assert refused.headers["retry-after"] == "5"
        assert admin.post(SIMULATION, json={}).status_code == 202
        http.delete(f"{JOBS}/{jobs[0]}")
        assert http.post(SIMULATION, json={}).status_code == 202


def test_stored_bytes_of_one_user_are_limited(lab: Served, admin: httpx.Client) -> None:
    with lab.http(headers=bearer(make(admin, "hoarder")["secret"])) as http:
        job_id = http.post(SIMULATION, json={}).json()["id"]
        with psycopg.connect(str(lab.parts.settings.database_url)) as connection:
            connection.execute(
                "UPDATE job SET state = 'cancelled', result = '{\"artifacts\": [{\"bytes\": 700000}]}' WHERE id = %s",
                (job_id,),
            )
        assert http.post(SIMULATION, json={}).status_code == 202
        lab.run(add_recording(lab.parts, "r2"))
        with psycopg.connect(str(lab.parts.settings.database_url)) as connection:
            connection.execute("UPDATE recording SET owner = 'hoarder', bytes = 300000 WHERE id = 'r2'")
        refused = http.post(SIMULATION, json={})
        assert code(refused) == (413, "storage-limit")
        assert "1.0 MB, and 1 MB is the limit" in refused.json()["detail"]


def test_an_upload_belongs_to_its_token_and_counts(lab: Served, admin: httpx.Client, trial: Path) -> None:
    with lab.http(headers=bearer(make(admin, "uploader")["secret"])) as http:
        with trial.open("rb") as file:
            stored = http.post("/api/v1/recordings", files={"file": ("walk.c3d", file)})
        assert stored.json()["owner"] == "uploader"
        with psycopg.connect(str(lab.parts.settings.database_url)) as connection:
            connection.execute("UPDATE recording SET bytes = 1000000 WHERE owner = 'uploader'")
        with trial.open("rb") as file:
            refused = http.post("/api/v1/recordings", files={"file": ("walk.c3d", file)})
        assert code(refused) == (413, "storage-limit")


def test_the_audit_log_records_caller_and_action_and_is_append_only(lab: Served, admin: httpx.Client) -> None:
    token_made = make(admin, "watched")
    with lab.http(headers=bearer(token_made["secret"])) as http:
        http.get(TOKENS)
    admin.delete(f"{TOKENS}/{token_made['id']}")
    entries = [(e["action"], e["caller"], e["what"]) for e in admin.get("/api/v1/audit").json()["items"]]
    of_token = [entry for entry in entries if entry[2] == token_made["id"]]  # newest first
    assert of_token == [("token-revoked", "admin", token_made["id"]), ("token-created", "admin", token_made["id"])]
    between = entries[: entries.index(of_token[1])]  # the refusal, unless its rate limit was reached before
    assert set(between) <= {of_token[0], ("refused", "watched", "scope-missing")}
    with psycopg.connect(str(lab.parts.settings.database_url)) as connection:
        with pytest.raises(psycopg.errors.RaiseException):
            connection.execute("UPDATE audit SET caller = 'somebody-else'")
        connection.rollback()
        connection.execute("INSERT INTO audit (id, action, created_at) VALUES ('old', 'login', '2020-01-01')")

    async def clean() -> None:
        async with lab.parts.engine.connect() as connection:
            await audit.remove_old(connection, timedelta(days=365))

    lab.run(clean())
    assert rows_of(lab, "SELECT count(*) FROM audit WHERE id = 'old'") == [(0,)]
    assert rows_of(lab, "SELECT count(*) > 3 FROM audit") == [(True,)]


def test_a_bucket_empties_and_fills() -> None:
    now_s = [0.0]
    rates = RateLimiter(2.0, clock=lambda: now_s[0])
    for _ in range(int(2 * BURST_S)):
        rates.count_request("a")
    with pytest.raises(Busy) as refused:
        rates.count_request("a")
    assert refused.value.retry_after_s == pytest.approx(0.5)
    rates.count_request("b")
    now_s[0] = 0.5
    rates.count_request("a")
    with pytest.raises(Busy):
        rates.count_request("a")
    for _ in range(1000):
        RateLimiter(0.0).count_request("unlimited")


def test_too_many_requests_are_answered_429(postgres: TestDatabases, tmp_path: Path) -> None:
    with (
        postgres.fresh() as url,
        served(url, tmp_path, api_token=ADMIN, rate_limit_hz=0.5) as running,
        running.http(headers=bearer(ADMIN)) as http,
        running.http() as stranger,
    ):
        answers = [http.get(SUBJECTS) for _ in range(6)]
        assert [answer.status_code for answer in answers] == [200] * 5 + [429]
        assert code(answers[-1]) == (429, "too-many-requests")
        assert answers[-1].headers["retry-after"] in {"1", "2"}, "what is left of 2 s"
        assert [stranger.get(SUBJECTS).status_code for _ in range(2)] == [401, 429]
        assert stranger.post("/login", data={"token": "guessed"}).status_code == 429
        assert stranger.get("/api/v1/health").status_code == 200


def test_without_tokens_no_login_is_required_and_nothing_has_an_owner(service: Served) -> None:
    with service.http() as http:
        assert http.post(SIMULATION, json={}).json()["owner"] is None
        assert http.get(TOKENS).json()["items"] == []
        assert http.get("/api/v1/caller").json() == {"name": None, "scope": "admin"}
