"""Two people on one service do not disturb each other, and who may see a scene is decided at the door.

Playback is each page's own; what is dragged is a change of the stored scenario; viser learns nothing of who looks
(docs/viewer.md says why).
"""

import asyncio
import math
from collections.abc import Callable

import pytest
import websockets
from playwright.sync_api import Page, expect

from stridelab_web.scene.documents import Document
from support.browser import page
from support.browser.page import Tab, drag, nodes, opened, until
from support.fakes.web_app import Lab

pytestmark = pytest.mark.usefixtures("lab")

FOOT = "/robot/leg_right_6_link"
FOOT_M_PER_S = 0.12
"""How fast the fake's foot moves along x."""


@pytest.fixture
def two(open_tab: Callable[..., Tab]) -> tuple[Tab, Tab]:
    """Two visitors, each with a store and cookies of their own."""
    return open_tab(700, 560), open_tab(700, 560)


def foot_stands_at(page: Page, t_s: float) -> Callable[[], bool]:
    return lambda: abs(nodes(page, FOOT)[FOOT]["position"][0] - FOOT_M_PER_S * t_s) < 1e-4


def test_two_look_at_one_plan_at_different_times(two: tuple[Tab, Tab], lab: Lab) -> None:
    job = lab.fake.add_plan()
    first, second = (opened(tab, f"/view/?plan={job.id}&t={t}") for tab, t in zip(two, ("1.0", "2.0"), strict=True))
    until(first, foot_stands_at(first, 1.0))
    until(second, foot_stands_at(second, 2.0))
    first.bring_to_front()
    first.get_by_label("Forces").uncheck()
    first.get_by_label("Speed").select_option("0.25")
    first.get_by_role("button", name="Play (space)").click()
    first.wait_for_function("() => Number(document.querySelector('#time').value) > 55")
    assert foot_stands_at(second, 2.0)(), "nobody else's picture moves"
    expect(second.get_by_label("Forces")).to_be_checked()
    expect(second.get_by_role("button", name="Play (space)")).to_have_attribute("aria-pressed", "false")
    second.bring_to_front()
    second.get_by_role("slider", name="Time").fill("150")
    until(second, foot_stands_at(second, 3.0))
    expect(first.get_by_role("button", name="Pause (space)")).to_have_attribute("aria-pressed", "true")
    first.get_by_role("button", name="Pause (space)").click()


def test_one_drags_while_the_other_plays(two: tuple[Tab, Tab], lab: Lab) -> None:
    job, remaining, untouched = lab.fake.add_plan(), lab.fake.add_scenario(), lab.fake.add_scenario()
    before = lab.fake.scenarios[untouched.id]
    player = opened(two[0], f"/view/?plan={job.id}&t=0.5")
    player.get_by_label("Speed").select_option("0.1")
    player.locator("body").press(" ")
    editor = opened(two[1], f"/view/?scenario={remaining.id}")
    drag(editor, "/contacts/5", (0.28, 0.21, 0.1))
    expect(editor.locator("[data-said]")).to_have_text("Stored.")
    stored = next(c for c in lab.fake.scenarios[remaining.id].phases[4].contacts if c.effector == "left_foot")
    assert math.dist(stored.position_m, (0.28, 0.21, 0.1)) < 0.02
    assert lab.fake.scenarios[untouched.id] == before
    expect(player.get_by_role("button", name="Pause (space)")).to_have_attribute("aria-pressed", "true")
    player.bring_to_front()
    at = int(player.get_by_role("slider", name="Time").input_value())
    player.wait_for_function(f"() => Number(document.querySelector('#time').value) !== {at}")
    player.locator("body").press(" ")


def test_reload_keeps_the_instant_and_what_is_seen_through(two: tuple[Tab, Tab], lab: Lab) -> None:
    page = opened(two[0], f"/view/?plan={lab.fake.add_plan().id}&t=0")
    page.get_by_role("slider", name="Time").fill("120")
    page.get_by_label("See through").uncheck()
    page.wait_for_url("**t=2.400*")
    page.reload()
    page.wait_for_selector("[data-ready]", timeout=90_000)
    until(page, foot_stands_at(page, 2.4))
    expect(page.get_by_label("See through")).not_to_be_checked()


def test_the_socket_of_a_scene_is_closed_to_pages_of_other_origins(lab: Lab) -> None:
    """By a real handshake: with our origin the scene is sent, with another one nothing is."""
    address = f"{lab.url.replace('http', 'ws', 1)}{Document('plan', lab.fake.add_plan().id).address}"

    async def first_words(origin: str) -> int:
        options = {
            "subprotocols": ["viser-v1.1.1"],
            "origin": origin,
            "max_size": None,
            "proxy": None,
            "open_timeout": None,
        }
        async with websockets.connect(address, **options) as socket:  # type: ignore[arg-type]
            return len(await asyncio.wait_for(socket.recv(), 60))

    assert page.run(first_words(lab.url)) > 0
    for origin in ("https://elsewhere.example", lab.url.replace("127.0.0.1", "localhost"), f"{lab.url}0", "null"):
        with pytest.raises(websockets.InvalidStatus) as refusal:
            page.run(first_words(origin))
        assert refusal.value.response.status_code == 403


def test_the_frame_of_a_scene_cannot_speak_to_another_host(two: tuple[Tab, Tab], lab: Lab) -> None:
    """viser's socket lives in a worker, where Playwright does not see it; the policy of the frame holds there too."""
    tab = two[0]
    page = opened(tab, f"/view/?plan={lab.fake.add_plan().id}")
    refused = page.evaluate(
        """async (url) => {
            const inside = document.querySelector("iframe").contentWindow;
            const refusals = [];
            inside.document.addEventListener("securitypolicyviolation", (event) => refusals.push(event.blockedURI));
            const text = `try { new WebSocket(${JSON.stringify(url)}); } catch { }
                fetch(${JSON.stringify(url.replace("ws:", "http:"))}).then(() => postMessage("sent"), () => postMessage("refused"));`;
            const worker = new inside.Worker(inside.URL.createObjectURL(new inside.Blob([text], { type: "text/javascript" })));
            const said = await new Promise((done) => { worker.onmessage = (event) => done(event.data); });
            try { new inside.WebSocket(url); } catch { /* Chromium says it as an event as well */ }
            while (!refusals.length) await new Promise((done) => setTimeout(done, 20));
            return [said, refusals[0]];
        }""",  # noqa: E501
        "ws://127.0.0.2:9/",
    )
    assert refused[0] == "refused"
    assert refused[1].startswith("ws://127.0.0.2:9")
    assert not [m for m in tab.missteps if m.startswith("outside") and "127.0.0.2" not in m]
    tab.missteps = [m for m in tab.missteps if "127.0.0.2" not in m]


def test_what_is_gone_is_shown_calmly(two: tuple[Tab, Tab], lab: Lab) -> None:
    """A link to a plan that is gone; and a page that stays open while its recording is deleted plays on."""
    tab = two[0]
    page = tab.go("/view/?plan=gone")
    expect(page.get_by_role("heading", level=1)).to_have_text("Not found")
    expect(page.locator("#main").get_by_role("link", name="Home")).to_be_visible()
    recording = lab.fake.add_recording()
    page = opened(tab, f"/view/?recording={recording.id}&t=0")
    del lab.fake.recordings[recording.id]
    slider = page.get_by_role("slider", name="Time")
    slider.fill("5")
    expect(slider).to_have_value("5")
    page.reload()
    expect(page.get_by_role("heading", level=1)).to_have_text("Not found")
    assert "Traceback" not in page.content()
    tab.missteps = [m for m in tab.missteps if "status of 404" not in m]
