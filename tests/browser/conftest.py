"""A whole service of its own (database, worker, viewer), and headless Chromium that reports every misstep."""

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import pytest
from playwright.sync_api import Browser, Page, expect, sync_playwright

from stridelab.client import Client
from support.browser.every_page import every_page
from support.browser.page import Service, Tab, prepare_pictures
from support.browser.service_costs import Meter, metered
from support.fakes.web_app import Lab, running_labs
from support.service.database import public_folder
from support.service.processes import share_robot_files

CHROMIUM = next(
    (
        path
        for name in ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
        if (path := shutil.which(name))
    ),
    "",
)
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--webgl-antialiasing-mode=none",  # a picture of a scene in 0.17 s of processor, 0.24 with it
    "--disable-gpu-compositing",  # without a graphics card, 2.5 s of processor per page where it would be 4.5
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-default-apps",
    "--disable-sync",
    "--no-first-run",
)
expect.set_options(timeout=30_000)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Everything here needs a browser, and comes last: Playwright's event loop runs in this thread to the end."""
    items.sort(key=lambda item: Path(__file__).parent in item.path.parents)
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.browser)
            fixtures = getattr(item, "fixturenames", ())
            if "service" in fixtures or "lab" not in fixtures:
                item.add_marker(pytest.mark.whole_service)
            if not CHROMIUM:
                item.add_marker(pytest.mark.skip(reason="no Chromium on the PATH"))


@pytest.fixture(scope="session")
def service() -> Iterator[Service]:
    """Started as a user starts it, with one job at a time, so that a second one waits."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    with public_folder() as folder, (folder / "serve.log").open("w+b") as log:
        environment = {
            **os.environ,
            "STRIDELAB_PORT": str(port),
            "STRIDELAB_DATA_DIR": str(folder / "data"),
            "STRIDELAB_WORKER_SLOTS": "1",
            "STRIDELAB_MIN_FREE_DISK_MB": "0",
            "STRIDELAB_PARSE_TIMEOUT_S": "60",  # the machine may be busy with other things
            "STRIDELAB_JOB_NICENESS": "0",  # and jobs must get on beside them
        }
        share_robot_files(folder / "data")
        command = [sys.executable, "-c", "from stridelab.cli.app import main; main()", "serve"]
        process = subprocess.Popen(command, env=environment, stdout=log, stderr=log, start_new_session=True)
        url = f"http://127.0.0.1:{port}"
        try:
            _wait_until_healthy(url, process, folder / "serve.log")
            with Client(url, transport=httpx.HTTPTransport()) as client:
                yield Service(url, client, process.pid, folder / "data")
        finally:
            process.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(20)
            process.kill()
            process.wait()


def _wait_until_healthy(url: str, process: subprocess.Popen[bytes], log: Path) -> None:
    deadline = time.monotonic() + 90
    while process.poll() is None and time.monotonic() < deadline:
        with contextlib.suppress(httpx.TransportError):
            if httpx.get(f"{url}/api/v1/health", trust_env=False).status_code == 200:
                return
        time.sleep(0.2)
    pytest.fail(f"the service did not start: {log.read_text(errors='replace')[-2000:]}")


@pytest.fixture(scope="session")
def put_new_lab() -> Iterator[Callable[[], Lab]]:
    """Pages and viewer on a fake interface that can be exchanged."""
    with running_labs() as put:
        yield put


@pytest.fixture(scope="module")
def lab(put_new_lab: Callable[[], Lab]) -> Lab:
    """Pages and viewer on a fake interface of this file; a file whose tests all are on it is marked to use it."""
    return put_new_lab()


@pytest.fixture(scope="module")
def addresses(lab: Lab) -> dict[str, str]:
    """Every kind of page of the lab, by a name."""
    return every_page(lab.fake)


@pytest.fixture
def site(request: pytest.FixtureRequest) -> Service:
    """What a tab shows: the lab in a test that uses it, else the whole service."""
    if "lab" not in request.fixturenames:
        whole: Service = request.getfixturevalue("service")
        return whole
    lab: Lab = request.getfixturevalue("lab")
    return Service(lab.url, lab.fake.client())


@pytest.fixture
def meter(service: Service) -> Iterator[Meter]:
    """A door in front of the whole service that counts what passes."""
    with metered(int(urlsplit(service.url).port or 0)) as counting:
        yield counting


@pytest.fixture(scope="session")
def chromium() -> Iterator[Browser]:
    """One browser for all tests; each has contexts of its own."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        yield browser
        browser.close()


@pytest.fixture
def phone(chromium: Browser) -> Iterator[Page]:
    """A page on a phone, whose own scroll bars show only while one scrolls; Playwright hides those of all others."""
    browser = chromium.browser_type.launch(
        executable_path=CHROMIUM, args=list(FLAGS), ignore_default_args=["--hide-scrollbars"]
    )
    context = browser.new_context(viewport={"width": 390, "height": 844}, is_mobile=True, has_touch=True)
    yield context.new_page()
    browser.close()


@pytest.fixture
def drawn() -> None:
    """Scenes are drawn in a test that uses this, because it looks at their pixels; in others only their nodes move."""


@pytest.fixture
def open_tab(chromium: Browser, site: Service, request: pytest.FixtureRequest) -> Iterator[Callable[..., Tab]]:
    """Opens tabs of a given size; at the end none may have logged an error or requested anything of another host.

    Further arguments go to the browser: ``device_scale_factor``, ``has_touch``, ``is_mobile``, ``color_scheme``.
    """
    tabs: list[Tab] = []

    def open_one(width: int = 1400, height: int = 850, **options: Any) -> Tab:
        page = chromium.new_page(viewport={"width": width, "height": height}, **options)
        page.set_default_timeout(30_000)
        prepare_pictures(page, drawn="drawn" in request.fixturenames)
        tab = Tab(page, site.url)
        page.on("console", tab.on_console)
        page.on("pageerror", tab.on_error)
        page.on("request", tab.on_request)
        page.on("websocket", tab.on_websocket)
        tabs.append(tab)
        return tab

    yield open_one
    for tab in tabs:
        tab.page.close()
    assert [misstep for tab in tabs for misstep in tab.missteps] == []


@pytest.fixture
def tab(open_tab: Callable[..., Tab]) -> Tab:
    return open_tab()


@pytest.fixture(scope="session")
def trial(service: Service, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A C3D file as a lab would bring it: a simulated person on plates."""
    job = service.client.submit("simulate-recording", {"duration_s": 3.0, "seed": 3})
    done = service.client.wait(job.id, 120.0)
    assert done.state == "succeeded", done.error
    made = service.client.result(job.id).summary["recording_id"]
    return service.client.download_file(made, tmp_path_factory.mktemp("trial") / "walk 01.c3d")


@pytest.fixture(scope="session")
def estimated(service: Service, trial: Path) -> tuple[str, str]:
    """Ids of a recording and of its estimate."""
    recording = service.client.upload(trial, filename="estimated.c3d")
    job = service.client.submit("estimate-com", {"recording_id": recording.id})
    done = service.client.wait(job.id, 120.0)
    assert done.state == "succeeded", done.error
    return recording.id, job.id
