"""The page of a recording with unknown labels proposes names, and stores them as a set for all such recordings."""

from dataclasses import replace
from pathlib import Path

import pytest
from playwright.sync_api import expect

from stridelab.recordings.files.c3d_writer import write_c3d
from stridelab.recordings.reader import read_recording
from support.browser.page import Service, Tab
from support.command_line import SAMPLE


@pytest.fixture
def unknown(tmp_path: Path) -> Path:
    """The sample under labels that no shipped set has."""
    recording = read_recording(SAMPLE / "recording.c3d")
    markers = {f"mk-{label[::-1]}": track for label, track in recording.markers_m.items()}
    write_c3d(tmp_path / "unknown.c3d", replace(recording, markers_m=markers))
    return tmp_path / "unknown.c3d"


def test_names_are_proposed_and_stored_as_a_marker_set(tab: Tab, service: Service, unknown: Path) -> None:
    first, second = (service.client.upload(unknown, filename=f"unknown-{k}.c3d").id for k in (1, 2))
    page = tab.go(f"/recordings/{first}")
    form = page.locator("[data-markers]")
    expect(form.locator("[data-proposed]")).to_contain_text("Proposed: ")
    shown = form.locator("[data-confidence]").all_inner_texts()
    shares = [int(text.split()[0]) for text in shown]
    assert shares == sorted(shares), "the least certain ones come first"
    for width in (390, 800, 1400):
        page.set_viewport_size({"width": width, "height": 900})
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), width
        page.locator("#markers").screenshot(path=unknown.with_name(f"markers-{width}.png"))
    store = page.locator("[data-marker-set]")
    store.get_by_label("Name of a set").fill("Lab of the browser test")
    store.get_by_role("button", name="Store marker set").click()
    expect(page.locator(".facts")).to_contain_text("Lab of the browser test (of a user)")
    assert service.client.recording(second).marker_set == "Lab of the browser test"
