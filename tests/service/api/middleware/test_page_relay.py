"""Pages by a second web server, and by the first one while the second does not answer."""

import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from stridelab.service.api.middleware.page_relay import RELAYED
from support.service.database import TestDatabases
from support.service.web_server import Served, served

TOKEN = "the-token-of-this-test"
PAGES = ("/", "/scenarios", "/jobs", "/recordings", "/subjects", "/population", "/jobs?state=succeeded")


@pytest.fixture(scope="module")
def servers(postgres: TestDatabases, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Served, Served]]:
    """The first web server and the one that renders pages for it."""
    data = tmp_path_factory.mktemp("data")
    with (
        postgres.fresh() as url,
        served(url, data, api_token=TOKEN, language="de") as pages,
        served(url, data, api_token=TOKEN, pages_url=pages.base_url) as first,
    ):
        yield first, pages


def login(server: Served, **headers: str) -> httpx.Client:
    return server.http(headers={"Authorization": f"Bearer {TOKEN}", "Accept-Encoding": "gzip", **headers})


@pytest.mark.parametrize("path", PAGES)
def test_pages_come_from_the_second_server(servers: tuple[Served, Served], path: str) -> None:
    """It speaks German here, so that the two can be told apart."""
    first, pages = servers
    with login(first) as http, login(pages) as direct:
        relayed, rendered = http.get(path), direct.get(path)
    assert (relayed.status_code, relayed.text) == (200, rendered.text)
    assert '<html lang="de">' in relayed.text or path == "/scenarios"
    names = [name.lower() for name, _ in relayed.headers.raw]
    assert len(names) == len(set(names))
    assert relayed.headers["content-encoding"] == "gzip"
    assert relayed.headers["content-security-policy"] == rendered.headers["content-security-policy"]


@pytest.mark.parametrize(
    "path", ["/api/v1/jobs", "/robots", "/live", "/view/", "/scenarios/new", "/settings", "/static/x"]
)
def test_what_depends_on_the_memory_of_a_server_is_not_relayed(path: str) -> None:
    assert not RELAYED.fullmatch(path)


def test_the_second_server_checks_the_login(servers: tuple[Served, Served]) -> None:
    first, _ = servers
    with first.http(headers={"Accept": "text/html"}) as http:
        answer = http.get("/jobs?state=failed")
        assert (answer.status_code, answer.headers["location"]) == (303, "/login?next=/jobs%3Fstate%3Dfailed")
        http.post("/login", data={"token": TOKEN})
        assert http.get("/jobs").status_code == 200  # by the cookie
    with login(first, **{"X-Forwarded-For": "192.0.2.1", "Host": "lab.example"}) as http:
        assert http.get("/jobs").status_code == 200


def test_missing_pages_stay_missing(servers: tuple[Served, Served]) -> None:
    with login(servers[0]) as http:
        assert http.get("/jobs/there-is-none").status_code == 404


def test_without_the_second_server_the_first_one_renders_pages(postgres: TestDatabases, tmp_path: Path) -> None:
    with socket.socket() as reserved:
        reserved.bind(("127.0.0.1", 0))
        nowhere = f"http://127.0.0.1:{reserved.getsockname()[1]}"
        with postgres.fresh() as url, served(url, tmp_path, pages_url=nowhere) as first, first.http() as http:
            assert http.get("/jobs").status_code == 200


def test_a_page_that_breaks_off_is_rendered_by_the_first_server(postgres: TestDatabases, tmp_path: Path) -> None:
    half = b"HTTP/1.1 200 OK\r\nContent-Length: 1000\r\n\r\n<!doctype html>"

    def answer_half(listening: socket.socket) -> None:
        connection, _ = listening.accept()
        with connection:
            connection.recv(65536)
            connection.sendall(half)

    with socket.create_server(("127.0.0.1", 0)) as listening:
        broken = threading.Thread(target=answer_half, args=(listening,), daemon=True)
        broken.start()
        url = f"http://127.0.0.1:{listening.getsockname()[1]}"
        with postgres.fresh() as base, served(base, tmp_path, pages_url=url) as first, first.http() as http:
            answer = http.get("/jobs")
            broken.join(10)
    assert answer.status_code == 200
    assert answer.text.rstrip().endswith("</html>")
