"""A large file on its way up: progress, a way to stop it, nothing left behind, and a server that does not grow."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from support.browser.page import Service
from support.browser.service_costs import Consumption, Meter
from support.service.processes import wait_until

FILE_BYTES = 100_000_000
HELD_AT_BYTES = 40_000_000
MEMORY_MB = 60.0


@pytest.fixture
def page(chromium: Browser) -> Iterator[Page]:
    opened = chromium.new_page(viewport={"width": 800, "height": 600})
    opened.set_default_timeout(60_000)
    yield opened
    opened.close()


@pytest.fixture
def large(tmp_path: Path) -> Path:
    """100 MB of nothing, by a name that would have to be escaped."""
    path = tmp_path / "<b>large & 'bold'.c3d"
    with path.open("wb") as file:
        file.truncate(FILE_BYTES)
    return path


def kept(service: Service) -> tuple[set[str], set[str]]:
    """Recordings, and files of uploads, finished and on their way."""
    assert service.data is not None
    files = [path for name in ("spool", "blobs") for path in (service.data / name).rglob("*") if path.is_file()]
    return {each.id for each in service.client.recordings(100).items}, {str(path) for path in files}


@pytest.fixture(autouse=True)
def robots_are_prepared(service: Service) -> None:
    """The service writes the files of its robots after its start; these tests compare all files."""
    names = [robot.name for robot in service.client.robots().items]
    wait_until(
        lambda: all(service.client.robot_preparation(name).state != "preparing" for name in names), 240, "robots"
    )


def test_a_hundred_megabytes_are_cancelled_halfway_and_leave_nothing(
    page: Page, meter: Meter, service: Service, large: Path
) -> None:
    before = kept(service)
    page.goto(f"{meter.url}/recordings")
    meter.up_at_most = HELD_AT_BYTES
    page.set_input_files("[data-upload] input[type=file]", [large, large])
    rows = page.locator("[data-uploads] li")
    expect(rows).to_have_count(2)
    halfway = "() => document.querySelector('[data-uploads] progress').value"
    page.wait_for_function(f"{halfway} > 0.1")
    assert page.evaluate(halfway) < 0.9
    expect(rows.first).to_contain_text(large.name)
    expect(rows.first).to_contain_text("%")
    assert len(kept(service)[1] - before[1]) >= 1, "the file is on its way to the disk"
    for k in range(2):
        row = rows.nth(k)
        row.get_by_role("button", name=f"Cancel the upload of {large.name}").press("Enter")
        expect(row).to_contain_text("cancelled")
        expect(row.get_by_role("progressbar")).to_be_hidden()
        expect(row.get_by_role("button")).to_have_count(0)
    meter.up_at_most = None
    for _ in range(100):
        if kept(service) == before:
            break
        page.wait_for_timeout(200)
    assert kept(service) == before


def test_a_hundred_megabytes_never_lie_in_memory_and_a_refusal_is_told(
    page: Page, meter: Meter, service: Service, large: Path
) -> None:
    before, consumption = kept(service), Consumption.of(service.pid)
    small_mb = consumption.memory_mb()["web"]
    page.goto(f"{meter.url}/recordings")
    meter.up_at_most = HELD_AT_BYTES
    page.set_input_files("[data-upload] input[type=file]", large)
    page.wait_for_function("() => document.querySelector('[data-uploads] progress').value > 0.1")
    assert consumption.memory_mb()["web"] < small_mb + MEMORY_MB
    meter.up_at_most = None
    row = page.locator("[data-uploads] li")
    expect(row.get_by_role("alert")).to_contain_text("is of no known format", timeout=120_000)
    expect(row.get_by_role("button")).to_have_text(["Dismiss"])
    assert consumption.memory_mb()["web"] < small_mb + MEMORY_MB
    assert kept(service) == before
