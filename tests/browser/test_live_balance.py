"""The page of a live stream: it finds the stream, draws the body, and says the margins, while frames arrive."""

import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from stridelab.schemas.streams import MarkerFrame, MarkerStreamConfiguration
from support.browser.accessibility import faults_at_every_size
from support.browser.page import Service, Tab
from support.service.streams import frame, header, sample

HEADER = MarkerStreamConfiguration.model_validate(header(title="Lane 3"))
INK = """(canvas) => {
    const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
    let drawn = 0;
    for (let k = 3; k < pixels.length; k += 4) if (pixels[k] > 0) drawn += 1;
    return drawn;
}"""


def frames(first: int, last: int, **fields: object) -> list[MarkerFrame]:
    return [MarkerFrame.model_validate(frame(k, **fields)) for k in range(first, last)]


def watched(service: Service) -> Callable[[], bool]:
    return lambda: any(item.n_watching for item in service.client.marker_streams().items)


def wait_for(page: Page, condition: Callable[[], bool]) -> None:
    for _ in range(200):
        if condition():
            return
        page.wait_for_timeout(50)
    pytest.fail("it did not happen within 10 s")


def test_the_page_follows_a_walk_to_its_end(tab: Tab, service: Service) -> None:
    page = tab.go("/live")
    expect(page.locator("[data-said]")).to_have_text("No stream is open.")
    with service.client.stream_markers(HEADER) as stream:
        wait_for(page, watched(service))
        expect(page.locator("[data-said]")).to_contain_text("Lane 3: 100 frames per second, marker set isb-head.")
        answers = [stream.send(one) for one in frames(0, 120)]
        last = answers[-1]
        expect(page.locator("[data-body]")).to_have_attribute("data-shown", re.compile(r"^1\.1[0-9]*$"))
        page.wait_for_timeout(300)
        stream.send(frames(120, 121)[0])
        expect(page.locator('[data-fact="time"]')).to_have_text("1.20 s")
        assert last.margin_m is not None
        assert last.height_m is not None
        sideways = page.locator('[data-margin="ml"]')
        expect(sideways).to_have_attribute("data-state", "inside")
        expect(sideways.locator("[data-value]")).to_have_text(re.compile(r"^\+\d+\.\d cm$"))
        height_cm = float(page.locator('[data-fact="height"]').inner_text().split()[0])
        assert abs(height_cm - 100.0 * last.height_m) < 1.0
        expect(page.locator('[data-fact="speed"]')).to_have_text(re.compile(r"^1\.[0-9]+ m/s$"))
        for canvas in ("[data-body]", "[data-base]"):
            assert page.locator(canvas).evaluate(INK) > 500
        assert faults_at_every_size(page, "live-walk") == {}
    expect(page.locator("[data-said]")).to_contain_text("The stream has ended")
    expect(page.locator('[data-fact="time"]')).to_have_text("1.20 s")


def test_what_is_missing_is_named_and_no_number_is_made_up(tab: Tab, service: Service) -> None:
    page = tab.go("/live")
    nothing = [None] * len(sample().markers_m)
    with service.client.stream_markers(HEADER) as stream:
        wait_for(page, watched(service))
        for one in [*frames(0, 40), *frames(40, 90, markers=nothing, plates=None)]:
            stream.send(one)
        page.wait_for_timeout(300)
        stream.send(frames(90, 91, markers=nothing, plates=None)[0])
        expect(page.locator("[data-missing]")).to_contain_text("No estimate:")
        expect(page.locator('[data-fact="height"]')).to_have_text("–")
        expect(page.locator('[data-margin="ml"] [data-value]')).to_have_text("–")
        expect(page.locator('[data-margin="ml"]')).to_have_attribute("data-state", "none")


def test_keys_choose_the_view_and_the_picture_changes(tab: Tab, service: Service) -> None:
    page = tab.go("/live")
    with service.client.stream_markers(HEADER) as stream:
        wait_for(page, watched(service))
        for one in frames(0, 30):
            stream.send(one)
        expect(page.locator("[data-body]")).to_have_attribute("data-shown", re.compile(r"^0\.2"))
        before = page.locator("[data-body]").evaluate("(canvas) => canvas.toDataURL()")
        page.get_by_label("the side").focus()
        page.keyboard.press("ArrowRight")
        expect(page.get_by_label("behind")).to_be_checked()
        wait_for(page, lambda: page.locator("[data-body]").evaluate("(canvas) => canvas.toDataURL()") != before)


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 800, 1400])
def test_it_fits_every_screen(
    open_tab: Callable[..., Tab], service: Service, width: int, scheme: str, tmp_path: Path
) -> None:
    tab = open_tab(width, 900, color_scheme=scheme)
    page = tab.go("/live")
    with service.client.stream_markers(HEADER) as stream:
        wait_for(page, watched(service))
        for one in frames(180, 240):
            stream.send(one)
        page.wait_for_timeout(300)
        stream.send(frames(240, 241)[0])
        expect(page.locator('[data-fact="time"]')).to_have_text("2.40 s")
        page.screenshot(
            path=Path(os.environ.get("LIVE_PICTURES", tmp_path)) / f"live-{width}-{scheme}.png", full_page=True
        )
        assert page.evaluate("document.documentElement.scrollWidth") <= width
