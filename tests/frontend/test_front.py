"""The front door: pages and interface on one port, each answering for its own addresses."""

from collections.abc import Iterator

import httpx
import pytest

from stridelab.service.api.app import create_app
from stridelab.service.settings import Settings
from support.fakes.web_app import Caller
from support.service.database import TestDatabases
from support.service.web_server import served

PAGE = {"Accept": "text/html"}


@pytest.fixture(scope="module")
def door() -> Caller:
    return Caller(create_app(Settings()))


@pytest.fixture(scope="module")
def locked_door(postgres: TestDatabases, tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """With a database, where tokens are looked up and refusals noted."""
    with (
        postgres.fresh() as url,
        served(url, tmp_path_factory.mktemp("data"), api_token="open sesame") as running,
        running.http() as client,
    ):
        yield client


def test_interface_answers_its_own_mistakes_as_problems(door: Caller) -> None:
    for method, address, status in (
        ("GET", "/api/v1/nothing", 404),
        ("PUT", "/api/v1/recordings", 405),
        ("GET", "/api/v2/", 404),
    ):
        answer = door.request(method, address)
        assert answer.status_code == status
        assert answer.headers["content-type"] == "application/problem+json"


def test_pages_answer_theirs_as_pages(door: Caller) -> None:
    answer = door.get("/nothing")
    assert answer.status_code == 404
    assert answer.headers["content-type"].startswith("text/html")


def test_pages_and_frame_have_policies_of_their_own(door: Caller) -> None:
    page = door.get("/login").headers["content-security-policy"]
    assert "script-src 'self'" in page
    assert "unsafe" not in page
    frame = door.get("/view/scene/recording/some/-/").headers["content-security-policy"]
    assert "script-src 'self' 'wasm-unsafe-eval'" in frame
    assert "'unsafe-eval'" not in frame


def test_without_login_a_page_sends_to_the_login_and_back(locked_door: httpx.Client) -> None:
    answer = locked_door.get("/view/?recording=1&t=2", headers=PAGE)
    assert answer.status_code == 303
    assert answer.headers["location"] == "/login?next=/view/%3Frecording%3D1%26t%3D2"
    login = locked_door.get(answer.headers["location"], headers=PAGE)
    assert login.status_code == 200
    assert '<input type="hidden" name="next" value="/view/?recording=1&amp;t=2">' in login.text
    assert locked_door.get("/static/css/app.css").status_code == 200


def test_wrong_token_is_reported_and_the_right_one_opens(locked_door: httpx.Client) -> None:
    form = {"token": "guess", "next": "/jobs"}
    answer = locked_door.request("POST", "/login", data=form)
    again = locked_door.get(answer.headers["location"], headers=PAGE)
    assert "This token is not valid." in again.text
    answer = locked_door.request("POST", "/login", data={**form, "token": "open sesame"})
    assert answer.status_code == 303
    assert answer.headers["location"] == "/jobs"
    cookie = answer.headers["set-cookie"].partition(";")[0]
    assert locked_door.get("/nothing", headers={**PAGE, "Cookie": cookie}).status_code == 404
    locked_door.cookies.clear()
    assert locked_door.get("/nothing", headers=PAGE).status_code == 303
