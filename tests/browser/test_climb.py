"""The real chain in a browser: a foothold of a sample is dragged, its copy is planned, and the robot stands on it."""

import json
import math
from typing import Any
from urllib.parse import parse_qs, urlsplit

import numpy as np
from playwright.sync_api import Page

from stridelab.centroidal.native.availability import NativeUnavailable, native_availability
from stridelab.schemas.scenarios import Scenario
from stridelab_web.scene.contacts import placed_contacts
from stridelab_web.scene.plan_frames import read_motion
from support.browser.page import Service, Tab, drag, few_pictures, nodes, opened, until

FOOT = "leg_right_6_link"
BASE = "/robot/base_link"
PLANNED_WITHIN_MS = 240_000
RECORD_PLANNING = """([ghost, base]) => {
    const record = (name, value) => {
        const list = JSON.parse(sessionStorage.getItem(name) ?? "[]");
        if (list.at(-1) !== value) sessionStorage.setItem(name, JSON.stringify([...list, value]));
    };
    const nodes = () => document.querySelector("iframe").contentWindow.__viserMutable.nodeRefFromName;
    const place = () => record("base", nodes()[base].position.toArray().map(x => x.toFixed(4)).join(" "));
    const shown = () => {
        let meshes = 0;
        nodes()[ghost]?.traverse(part => { meshes += part.isMesh && part.layers.mask ? 1 : 0; });
        return meshes;
    };
    const look = () => {
        record("messages", document.querySelector("[data-said]").textContent);
        record("certificate", document.querySelector("[data-plan-certificate]")?.textContent ?? "");
        const playing = document.querySelector("[data-playing]")?.dataset.playing ?? "";
        record("playing", playing);
        if (playing === "body" || playing === "replay") place();
        if (playing === "replay" && shown()) record("ghosts", shown());
    };
    new MutationObserver(look).observe(document.body,
        { attributes: true, childList: true, characterData: true, subtree: true });
    setInterval(look, 50);
}"""
"""What the page shows while it plans, however short its time; it outlives the page, which another one follows."""
COM_MOVES, BODY_MOVES = "The centre of mass moves as planned, solved in", "The body moves as far as it is solved."


def recorded_values(page: Page, name: str) -> list[Any]:
    """All values that ``RECORD_PLANNING`` has recorded under this name, in their order."""
    values: list[Any] = json.loads(page.evaluate("name => sessionStorage.getItem(name) ?? '[]'", name))
    return values


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

    addresses: list[str] = []
    page.on("framenavigated", lambda frame: addresses.append(frame.url))
    page.evaluate(RECORD_PLANNING, [f"/ghost/{FOOT}", BASE])
    page.get_by_role("button", name="Plan", exact=True).click()
    with few_pictures(page):
        page.wait_for_url("**/view/?plan=*", timeout=PLANNED_WITHIN_MS)
    assert any("Certified: all" in text for text in recorded_values(page, "certificate"))
    assert len(set(recorded_values(page, "base"))) > 1, "the body moves before the plan is complete"
    assert recorded_values(page, "ghosts"), "the replay is a ghost beside the body"
    messages, playing = recorded_values(page, "messages"), recorded_values(page, "playing")
    assert playing.index("body") < playing.index("replay")
    if not isinstance(native_availability(), NativeUnavailable):  # without it there is no motion before the plan
        assert playing.index("path") < playing.index("body")
        order = [next(k for k, text in enumerate(messages) if what in text) for what in (COM_MOVES, BODY_MOVES)]
        assert order[0] < order[1], "the motion of the CoM is shown before the plan is computed"
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
