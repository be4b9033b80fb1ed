"""The real chain in a browser: a foothold of a sample is dragged, its copy is planned, and the robot stands on it."""

import math
from urllib.parse import parse_qs, urlsplit

import numpy as np
from playwright.sync_api import Page, expect

from stridelab.centroidal.native.availability import NativeUnavailable, native_availability
from stridelab.schemas.scenarios import Scenario
from stridelab_web.scene.contacts import placed_contacts
from stridelab_web.scene.plan_frames import read_motion
from support.browser.page import Service, Tab, drag, few_pictures, nodes, opened, until

FOOT = "leg_right_6_link"
PLANNED_WITHIN_MS = 240_000
COM = "/support/com"
GHOST_MESHES = """name => {
    const node = document.querySelector("iframe").contentWindow.__viserMutable.nodeRefFromName[name];
    let shown = 0;
    node.traverse(part => { shown += part.isMesh && part.layers.mask ? 1 : 0; });
    return shown;
}"""

RECORD_MESSAGES = """() => {
    const line = document.querySelector("[data-said]");
    window.messages = [];
    const record = () => window.messages.push(line.textContent);
    new MutationObserver(record).observe(line, { childList: true, characterData: true, subtree: true });
}"""
"""Each message, however short its time on the page is."""
COM_MOVES, BODY_MOVES = "The centre of mass moves as planned, solved in", "The body moves as far as it is solved."


def has_message(page: Page, beginning: str) -> bool:
    return any(beginning in text for text in page.evaluate("() => window.messages"))


def test_from_a_sample_over_a_dragged_foothold_to_the_robot_that_walks_on_it(tab: Tab, service: Service) -> None:
    client = service.client
    page = opened(tab, "/view/?scenario=flat-walk")
    third = placed_contacts(client.scenario("flat-walk"))[2]
    x, y, z = third.contact.position_m
    target = (x + 0.03, y - math.copysign(0.01, y), z)

    drag(page, "/contacts/3", target)
    page.wait_for_url(lambda url: "scenario=" in url and "flat-walk" not in url)
    page.wait_for_selector("[data-ready]", timeout=60_000)
    copy = client.scenario(parse_qs(urlsplit(page.url).query)["scenario"][0])
    stored = placed_contacts(client.scenario(copy.id))[2]
    assert math.dist(stored.contact.position_m, target) < 0.01
    assert math.dist(stored.contact.position_m, third.contact.position_m) > 0.02

    start = nodes(page, COM)[COM]["position"]
    addresses: list[str] = []
    page.on("framenavigated", lambda frame: addresses.append(frame.url))
    page.evaluate(RECORD_MESSAGES)
    page.get_by_role("button", name="Plan", exact=True).click()
    if not isinstance(native_availability(), NativeUnavailable):  # without it there is no motion before the plan
        until(page, lambda: math.dist(nodes(page, COM)[COM]["position"], start) > 0.01)
        until(page, lambda: has_message(page, COM_MOVES))
    with few_pictures(page):
        page.wait_for_selector("[data-playing=body]", timeout=PLANNED_WITHIN_MS)
    before = nodes(page, f"/robot/{FOOT}")[f"/robot/{FOOT}"]["position"]
    until(page, lambda: math.dist(nodes(page, f"/robot/{FOOT}")[f"/robot/{FOOT}"]["position"], before) > 1e-3)
    certificate = page.locator("[data-plan-certificate]")
    with few_pictures(page):
        expect(certificate).to_contain_text("Certified: all", timeout=PLANNED_WITHIN_MS)
        page.wait_for_selector("[data-playing=replay]", timeout=PLANNED_WITHIN_MS)
        assert page.evaluate(GHOST_MESHES, f"/ghost/{FOOT}") > 0
        messages = page.evaluate("() => window.messages")
        if not isinstance(native_availability(), NativeUnavailable):
            order = [next(k for k, text in enumerate(messages) if what in text) for what in (COM_MOVES, BODY_MOVES)]
            assert order[0] < order[1], "the motion of the CoM is shown before the plan is computed"
        page.wait_for_url("**/view/?plan=*", timeout=PLANNED_WITHIN_MS)
    page.wait_for_selector("[data-player][data-ready]", timeout=90_000)
    job_id = page.url.partition("plan=")[2].partition("&")[0]
    assert any(f"planning={job_id}" in address for address in addresses)
    planned = Scenario.model_validate_json(client.read_artifact(job_id, "scenario.json"))
    assert planned.phases == client.scenario(copy.id).phases

    motion = read_motion(*(client.read_artifact(job_id, name) for name in ("poses.json", "poses.f32", "forces.f32")))
    frame = len(motion.time_s) * 2 // 3
    page.get_by_role("slider", name="Time").fill(str(frame))
    expected = motion.poses[frame, motion.links.index(FOOT)].astype(float)

    def stands() -> bool:
        shown = nodes(page, f"/robot/{FOOT}")[f"/robot/{FOOT}"]
        near = np.abs(np.array(shown["position"]) - expected[:3]).max() < 1e-4
        return bool(near and abs(np.dot(shown["wxyz"], expected[3:])) > 1 - 1e-6)

    until(page, stands)
