"""Who may call: hosts, origins, tokens, cookies."""

from collections.abc import Iterator

import httpx
import pytest
from starlette.types import Message, Receive, Scope, Send

from stridelab.errors import InvalidInput
from stridelab.service.api.middleware.authentication import AuthenticationMiddleware, as_internal_app, local_target
from stridelab.service.api.server import build_server
from stridelab.service.api.session_cookies import COOKIE, SESSION_S, SigningKeys
from stridelab.service.settings import Settings
from support.service.database import TestDatabases
from support.service.web_server import Served, served

TOKEN = "a-secret-of-the-lab"
SUBJECTS = "/api/v1/subjects"


@pytest.fixture(scope="module")
def locked(postgres: TestDatabases, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with postgres.fresh() as url, served(url, tmp_path_factory.mktemp("data"), api_token=TOKEN) as running:
        yield running


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8000", "127.0.0.1.evil.example", "", "[::2]:80"])
def test_a_rebound_host_name_is_refused(http: httpx.Client, host: str) -> None:
    answer = http.get("/api/v1/health", headers={"Host": host})
    assert (answer.status_code, answer.json()["code"]) == (403, "foreign-host")


@pytest.mark.parametrize("host", ["127.0.0.1:1", "localhost", "LOCALHOST:99", "[::1]:8000", "localhost."])
def test_names_of_this_machine_are_accepted(http: httpx.Client, host: str) -> None:
    assert http.get("/api/v1/health", headers={"Host": host}).status_code == 200


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1", "https://", ""])
def test_cross_origin_requests_are_refused(http: httpx.Client, origin: str) -> None:
    answer = http.post(SUBJECTS, json={"name": "P1"}, headers={"Origin": origin})
    assert (answer.status_code, answer.json()["code"]) == (403, "foreign-origin")


def test_cross_site_requests_without_origin_are_refused_but_links_work(http: httpx.Client) -> None:
    image = http.get(SUBJECTS, headers={"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "no-cors"})
    assert image.status_code == 403
    link = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "document"}
    assert http.get(SUBJECTS, headers=link).status_code == 200


def test_our_own_pages_may_post(http: httpx.Client, service: Served) -> None:
    answer = http.post(SUBJECTS, json={"name": "P1"}, headers={"Origin": service.base_url})
    assert answer.status_code == 201


@pytest.mark.parametrize(
    ("origin", "host"),
    [
        ("https://lab.example", "lab.example"),
        ("http://lab.example:80", "lab.example"),
        ("https://Lab.example", "lab.example:443"),
    ],
)
def test_the_scheme_of_a_proxy_does_not_matter(locked: Served, origin: str, host: str) -> None:
    headers = {"Origin": origin, "Host": host, "Authorization": f"Bearer {TOKEN}"}
    with locked.http() as http:
        assert http.post(SUBJECTS, json={}, headers=headers).status_code == 201


def test_a_token_is_needed_where_one_is_set(locked: Served) -> None:
    with locked.http() as http:
        for headers in ({}, {"Authorization": "Bearer wrong"}, {"Authorization": TOKEN}, {"Authorization": "Bearer"}):
            answer = http.get(SUBJECTS, headers=headers)
            assert (answer.status_code, answer.json()["code"]) == (401, "login-needed")
            assert answer.headers["www-authenticate"].startswith("Bearer")
        assert http.get("/metrics").status_code == 401
        assert http.get("/api/v1/openapi.json").status_code == 401
        assert http.get("/api/v1/health").status_code == 200
        assert http.get(SUBJECTS, headers={"Authorization": f"bearer {TOKEN}"}).status_code == 200


def test_a_browser_swaps_the_token_for_a_cookie(locked: Served) -> None:
    with locked.http() as http:
        lost = http.get("/metrics?x=1", headers={"Accept": "text/html"})
        assert (lost.status_code, lost.headers["location"]) == (303, "/login?next=/metrics%3Fx%3D1")
        wrong = http.post("/login", data={"token": "no", "next": "/jobs"})
        assert (wrong.status_code, wrong.headers["location"]) == (303, "/login?wrong=1&next=%2Fjobs")
        assert COOKIE not in http.cookies
        right = http.post("/login", data={"token": f" {TOKEN} ", "next": "/jobs"})
        assert (right.status_code, right.headers["location"]) == (303, "/jobs")
        cookie = right.headers["set-cookie"]
        assert "HttpOnly" in cookie
        assert "SameSite=strict" in cookie
        assert "Path=/" in cookie
        assert TOKEN not in cookie
        assert http.get(SUBJECTS).status_code == 200
        http.post("/logout")
        assert http.get(SUBJECTS).status_code == 401


def test_the_cookie_is_marked_secure_behind_tls(locked: Served) -> None:
    with locked.http() as http:
        answer = http.post("/login", data={"token": TOKEN}, headers={"X-Forwarded-Proto": "https"})
        assert "Secure" in answer.headers["set-cookie"]


def test_login_refuses_what_is_no_form(locked: Served) -> None:
    with locked.http() as http:
        assert http.post("/login", json={"token": TOKEN}).status_code == 415
        assert http.post("/login", data={"token": "x" * 9000}).status_code == 413


@pytest.mark.parametrize("target", ["//evil.example", "https://evil.example", "/\\evil.example", "jobs", "", "/a\nb"])
def test_a_login_never_leads_elsewhere(target: str) -> None:
    assert local_target(target) == "/"


def test_a_cookie_expires_and_cannot_be_forged() -> None:
    keys = SigningKeys.from_token(TOKEN)
    cookie = keys.make_cookie(1000.0)
    assert keys.token_of(cookie, 1000.0 + SESSION_S - 1) == "admin"
    assert keys.token_of(cookie, 1000.0 + SESSION_S) is None
    token_id, expires_s, signature = cookie.split(".")
    later = f"{token_id}.{int(expires_s) + 1}.{signature}"
    for forged in (
        later,
        keys.make_cookie(1000.0, "t1").replace("t1", "admin"),
        "",
        ".",
        "9999999999.",
        f"9999999999.{'0' * 64}",
        "\udce4.x",
        SigningKeys.from_token("other").make_cookie(1000.0),
    ):
        assert keys.token_of(forged, 1000.0) is None


def test_only_hashes_of_the_token_are_stored(locked: Served) -> None:
    keys = locked.app.state.keys
    assert TOKEN.encode() not in keys.token_hash + keys.cookie_key
    assert len(keys.token_hash) == len(keys.cookie_key) == 32


def test_an_open_address_needs_a_token() -> None:
    with pytest.raises(InvalidInput, match="STRIDELAB_API_TOKEN") as refused:
        build_server(Settings(host="0.0.0.0"))
    assert refused.value.code == "token-needed"
    config = build_server(Settings(host="0.0.0.0", api_token="t")).config
    assert config.ws_max_size >= 64 * 1024 * 1024


class Recorder:
    """An application that notes what reaches it, and what was sent in its place."""

    def __init__(self) -> None:
        self.reached = False
        self.sent: list[Message] = []

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        self.reached = True

    async def receive(self) -> Message:
        return {"type": "websocket.connect"}

    async def send(self, message: Message) -> None:
        self.sent.append(message)


def websocket(**headers: str) -> Scope:
    raw = [(name.replace("_", "-").encode(), value.encode()) for name, value in headers.items()]
    return {"type": "websocket", "path": "/view", "query_string": b"", "headers": raw, "scheme": "ws"}


@pytest.mark.parametrize(
    ("headers", "code"),
    [
        ({"host": "evil.example"}, 4403),
        ({"host": "127.0.0.1:8000", "origin": "http://evil.example"}, 4403),
        ({"host": "127.0.0.1:8000", "origin": "http://127.0.0.1:8000"}, 4401),
    ],
)
@pytest.mark.anyio
async def test_websockets_pass_the_same_gate(headers: dict[str, str], code: int) -> None:
    app = Recorder()
    gate = AuthenticationMiddleware(app, Settings(allowed_hosts="lab.example"), SigningKeys.from_token(TOKEN))
    await gate(websocket(**headers), app.receive, app.send)
    assert [message["code"] for message in app.sent] == [code]
    assert not app.reached


@pytest.mark.anyio
async def test_a_websocket_with_the_cookie_passes_and_so_do_calls_from_inside() -> None:
    for wrap, headers in (
        (
            lambda gate: gate,
            {"host": "lab.example", "cookie": f"{COOKIE}={SigningKeys.from_token(TOKEN).make_cookie(0.0)}"},
        ),
        (as_internal_app, {"host": "anything"}),
    ):
        app = Recorder()
        gate = AuthenticationMiddleware(
            app, Settings(allowed_hosts="lab.example"), SigningKeys.from_token(TOKEN), clock=lambda: 1.0
        )
        await wrap(gate)(websocket(**headers), app.receive, app.send)
        assert app.reached


FORM = {"Content-Type": "application/x-www-form-urlencoded"}


@pytest.mark.parametrize(
    ("body", "status"),
    [
        (b"&".join(b"%c=1" % letter for letter in b"abcdefghijk"), 400),
        (b"token=\xff\xfe", 400),
        (b"token=" + b"x" * 9000, 413),
        (b"token=<script>alert(1)</script>&next=<img src=x>", 303),
        (b"token=x&next=//[", 303),
        (b"token=%00%ff&next=%0d%0aSet-Cookie:a=b", 303),
        (b"", 303),
    ],
)
def test_invalid_posts_to_the_login_are_refused_with_a_problem(locked: Served, body: bytes, status: int) -> None:
    with locked.http() as http:
        answer = http.post("/login", content=body, headers=FORM)
    assert answer.status_code == status
    assert "set-cookie" not in answer.headers
    if status == 303:
        assert answer.headers["location"].startswith("/login?wrong=1&next=%2F")
