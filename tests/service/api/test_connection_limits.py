"""Slow and excessive clients are disconnected; proper requests are answered meanwhile."""

import asyncio
import contextlib
import resource
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx
import pytest
import uvicorn
from starlette.requests import ClientDisconnect, Request
from starlette.responses import PlainTextResponse, Response
from starlette.types import Receive, Scope, Send

from stridelab.service.api import connection_limits as module
from stridelab.service.api.connection_limits import ConnectionLimiter, guarded_protocol
from stridelab.service.settings import Settings
from support.service.database import TestDatabases
from support.service.processes import environment, free_port, is_over, wait_until

HALF_HEAD = b"GET / HTTP/1.1\r\nHost: here\r\n"
HALF_BODY = b"POST / HTTP/1.1\r\nHost: here\r\nContent-Length: 1000\r\n\r\nhalf"
LARGE = 20_000_000
STRANGERS = 1100
CROWDS = 8
OPEN_FILES = 1024
"""What many systems allow a program by default."""


async def app(scope: Scope, receive: Receive, send: Send) -> None:
    """Reads a whole body, or sends a large one."""
    request = Request(scope, receive)
    if scope["path"] == "/large":
        await Response(b"x" * LARGE)(scope, receive, send)
        return
    if scope["path"] == "/long":
        await asyncio.sleep(1.5)
    with contextlib.suppress(ClientDisconnect):
        size = len(await request.body())
        await PlainTextResponse(str(size))(scope, receive, send)


@contextlib.contextmanager
def server(limits: ConnectionLimiter, **options: Any) -> Iterator[tuple[str, int]]:
    config = uvicorn.Config(
        app, host="127.0.0.1", port=0, http=guarded_protocol(limits), lifespan="off", log_config=None, **options
    )
    running = uvicorn.Server(config)
    thread = threading.Thread(target=lambda: asyncio.run(running.serve()), daemon=True)
    thread.start()
    wait_until(lambda: running.started, 20, "a server")
    try:
        yield running.servers[0].sockets[0].getsockname()[:2]
    finally:
        running.should_exit = running.force_exit = True
        thread.join(20)


@pytest.fixture(autouse=True)
def fast(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tick is a twentieth of a second, and limits are a few of them."""
    monkeypatch.setattr(module, "TICK_S", 0.05)


def limits(**changes: Any) -> ConnectionLimiter:
    return ConnectionLimiter(**{"connections": 50, "per_address": 50, "head_s": 0.5, "body_s": 0.5, **changes})


def rest_of(client: socket.socket, timeout_s: float = 10.0) -> bytes:
    """All that the server says until it closes."""
    client.settimeout(timeout_s)
    received = b""
    with contextlib.suppress(ConnectionResetError):
        while chunk := client.recv(1 << 16):
            received += chunk
    return received


@pytest.mark.parametrize(
    ("content", "answer"), [(b"", b""), (HALF_HEAD, b"HTTP/1.1 408 "), (HALF_BODY, b"HTTP/1.1 408 ")]
)
def test_an_incomplete_request_is_closed_after_its_time_limit(content: bytes, answer: bytes) -> None:
    with server(limits()) as address, socket.create_connection(address) as client:
        began = time.monotonic()
        client.sendall(content)
        received = rest_of(client)
        assert time.monotonic() - began >= 0.4
    assert received.startswith(answer)
    assert (b'"code":"request-timeout"' in received) == bool(content)


def closed_while_dripping(client: socket.socket) -> bool:
    for _ in range(100):
        try:
            client.sendall(b"x")
        except ConnectionError:
            return True
        time.sleep(0.1)
    return False


def test_bytes_that_drip_do_not_hold_a_request_open() -> None:
    with server(limits()) as address:
        for request in (HALF_HEAD, HALF_BODY):
            with socket.create_connection(address) as client:
                client.sendall(request)
                assert closed_while_dripping(client)


def test_a_body_that_comes_steadily_is_read_to_its_end() -> None:
    with server(limits()) as address, socket.create_connection(address) as client:
        client.sendall(b"POST / HTTP/1.1\r\nHost: here\r\nContent-Length: 2000\r\nConnection: close\r\n\r\n")
        for _ in range(20):  # 2 s, four times the limit of a silence
            client.sendall(b"x" * 100)
            time.sleep(0.1)
        assert rest_of(client).endswith(b"2000")


def test_a_slow_answer_is_not_cut_off() -> None:
    with server(limits()) as (host, port):
        assert httpx.get(f"http://{host}:{port}/long", trust_env=False).text == "0"


def test_a_client_that_takes_nothing_of_its_answer_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_WRITE_PAUSE_S", 0.5)
    with server(limits()) as address, socket.socket() as client:
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        client.connect(address)
        client.sendall(b"GET /large HTTP/1.1\r\nHost: here\r\n\r\n")
        time.sleep(2.0)
        assert len(rest_of(client)) < LARGE


def is_answered(client: socket.socket) -> bool:
    """Whether a request is, on a connection that stays open."""
    client.sendall(b"GET / HTTP/1.1\r\nHost: here\r\n\r\n")
    received = b""
    while not received.endswith(b"\r\n\r\n0"):
        chunk = client.recv(1 << 16)
        assert chunk, received
        received += chunk
    return received.startswith(b"HTTP/1.1 200")


def test_an_idle_connection_is_closed_after_its_time() -> None:
    with server(limits(), timeout_keep_alive=1) as address, socket.create_connection(address) as client:
        for _ in range(2):
            assert is_answered(client)
            time.sleep(0.8)  # longer than a head may take
        began = time.monotonic()
        assert rest_of(client) == b""
        assert not is_over(began, 5.0)


def answered(address: tuple[str, int]) -> bool:
    with socket.create_connection(address, timeout=5) as client:
        client.sendall(b"GET / HTTP/1.1\r\nHost: here\r\nConnection: close\r\n\r\n")
        return rest_of(client).startswith(b"HTTP/1.1 200")


@pytest.mark.parametrize("content", [b"", HALF_HEAD, HALF_BODY])
@pytest.mark.parametrize("limit", [{"connections": 10}, {"per_address": 10}])
def test_at_the_limit_a_new_connection_replaces_a_stalled_one(content: bytes, limit: dict[str, int]) -> None:
    with server(limits(**limit, head_s=60.0, body_s=60.0)) as address, contextlib.ExitStack() as stack:
        strangers = [stack.enter_context(socket.create_connection(address)) for _ in range(25)]
        for stranger in strangers:
            with contextlib.suppress(ConnectionError):
                stranger.sendall(content)
        time.sleep(0.3)
        assert all(answered(address) for _ in range(5))
        assert rest_of(strangers[0]) == b""


def test_requests_that_are_being_answered_are_not_closed_for_others() -> None:
    busy = b"GET /long HTTP/1.1\r\nHost: here\r\nConnection: close\r\n\r\n"
    with server(limits(connections=3)) as address, contextlib.ExitStack() as stack:
        clients = [stack.enter_context(socket.create_connection(address)) for _ in range(3)]
        for client in clients:
            client.sendall(busy)
        time.sleep(0.3)
        with socket.create_connection(address) as newcomer:
            received = rest_of(newcomer)
        assert received.startswith(b"HTTP/1.1 503 ")
        assert b'"code":"too-many-connections"' in received
        assert all(rest_of(client).startswith(b"HTTP/1.1 200") for client in clients)
        assert answered(address)


def test_a_proxy_stands_for_many_clients() -> None:
    with (
        server(limits(per_address=2, is_proxy=lambda host: host == "127.0.0.1", head_s=60.0)) as address,
        contextlib.ExitStack() as stack,
    ):
        clients = [stack.enter_context(socket.create_connection(address)) for _ in range(10)]
        time.sleep(0.3)
        for client in clients:
            assert is_answered(client)
    limiter = ConnectionLimiter.from_settings(Settings(), 1024, "10.0.0.0/8,192.0.2.7")
    assert [limiter.is_proxy(host) for host in ("10.1.2.3", "192.0.2.7", "192.0.2.8", "")] == [True, True, False, False]
    assert limiter.connections == 1024 - module.RESERVED_FILES - module.ROUNDS_TO_CLOSE * module.BACKLOG
    assert ConnectionLimiter.from_settings(Settings(), 65536, None).connections == Settings().connection_limit


def test_the_limit_of_open_files_is_raised() -> None:
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    code = "import resource; from stridelab.service.api import connection_limits as c; print(c.raise_file_limit(), "
    code += "resource.getrlimit(resource.RLIMIT_NOFILE)[0])"

    def lower() -> None:
        resource.setrlimit(resource.RLIMIT_NOFILE, (256, before[1]))

    run = subprocess.run([sys.executable, "-c", code], preexec_fn=lower, capture_output=True, text=True, check=True)
    expected_limit = (
        module.MAX_OPEN_FILES if before[1] == resource.RLIM_INFINITY else min(before[1], module.MAX_OPEN_FILES)
    )
    assert run.stdout.split() == [str(expected_limit)] * 2


@contextlib.contextmanager
def many_files() -> Iterator[None]:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard if hard != resource.RLIM_INFINITY else 4096, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@pytest.fixture(scope="module")
def small(postgres: TestDatabases, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, int, Path]]:
    """The web server as it is started, with as few open files as many systems allow."""
    port, data = free_port(), tmp_path_factory.mktemp("data")
    log = data / "api.log"

    def few_files() -> None:
        resource.setrlimit(resource.RLIMIT_NOFILE, (OPEN_FILES, OPEN_FILES))

    with postgres.fresh() as url, log.open("wb") as written:
        settings = {"DATABASE_URL": url, "DATA_DIR": str(data), "PORT": str(port), "API_TOKEN": "a-token"}
        process = subprocess.Popen(
            [sys.executable, "-m", "support.service.web_server"],
            env=environment(**{f"STRIDELAB_{name}": value for name, value in settings.items()}),
            stdout=written,
            stderr=written,
            preexec_fn=few_files,
        )
        try:
            wait_until(lambda: is_healthy(port), 90, "a web server")
            yield "127.0.0.1", port, log
        finally:
            process.terminate()
            process.wait(20)


def is_healthy(port: int) -> bool:
    try:
        return httpx.get(f"http://127.0.0.1:{port}/api/v1/health", trust_env=False, timeout=5).status_code == 200
    except httpx.TransportError:
        return False


@pytest.mark.parametrize(
    "content",
    [HALF_HEAD, HALF_BODY.replace(b"POST /", b"POST /login").replace(b"here\r\n", b"here\r\n" + b"Content-Type: "
     b"application/x-www-form-urlencoded\r\n")],
    ids=["half a head", "half a body"],
)  # fmt: skip
def test_health_is_answered_while_other_clients_hold_connections_open(
    small: tuple[str, int, Path], content: bytes
) -> None:
    host, port, log = small
    with many_files(), contextlib.ExitStack() as stack:

        def hold(_: int) -> None:
            stranger = stack.enter_context(socket.create_connection((host, port), timeout=20))
            with contextlib.suppress(ConnectionError):
                stranger.sendall(content)

        with ThreadPoolExecutor(CROWDS) as crowds:  # several at once: the server accepts many before it closes one
            list(crowds.map(hold, range(STRANGERS)))
        looks = []
        for _ in range(5):
            time.sleep(0.2)
            looks.append(is_healthy(port))
    assert all(looks)
    text = log.read_text(encoding="utf-8")
    assert "out of system resource" not in text
    assert "Traceback" not in text
    assert text.count("\n") < 3 * STRANGERS
    assert log.stat().st_size < 1_000_000
