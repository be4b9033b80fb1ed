"""The editor asks the whole body: what no body can take is not called valid, and the robot takes the posture."""

import json
import re

import numpy as np
from playwright.sync_api import Page, expect

from stridelab.machine.models_folder import models_dir
from stridelab.schemas.scenarios import Scenario
from stridelab_web.scene.contacts import placed_contacts
from support.browser.page import Service, Tab, hold, opened, until

FOOT = 5
"""The touch of the left foot at the stairs' beginning, counted from 0."""
AWAY_M = (-0.857, 0.467)
"""1.03 m from the right foot: the learned reach leaves 5 cm to spare."""


def stairs(name: str) -> Scenario:
    body = json.loads((models_dir() / "scenarios" / "stairs-with-rail-hrp2.json").read_text(encoding="utf-8"))
    return Scenario.model_validate(body | {"name": name})


def base(page: Page) -> np.ndarray:
    """Where the robot's root link is drawn."""
    link = page.evaluate(
        """() => {
            const { nodePoseData } = document.querySelector("iframe").contentWindow.__viserMutable;
            const name = Object.keys(nodePoseData).find((one) => /^\\/robot\\/[^/]+$/.test(one));
            return [nodePoseData["/robot"].position, nodePoseData[name].position];
        }"""
    )
    return np.array(link[0]) + np.array(link[1])


def test_a_stance_that_no_body_can_take_is_shown_and_not_valid(tab: Tab, service: Service) -> None:
    scenario = service.client.add_scenario(stairs("stretched"))
    foot = placed_contacts(scenario)[FOOT]
    assert foot.effector == "left_foot"
    page = opened(tab, f"/view/?scenario={scenario.id}&contact={foot.number}")
    editor, verdict = page.locator("[data-editor]"), page.locator("[data-verdict]")
    expect(editor).to_have_attribute("data-judged", "valid", timeout=60_000)
    expect(verdict).to_contain_text("the body can take the stance of every phase")
    before = base(page)

    hold(page, f"/contacts/{foot.number}", (*AWAY_M, 0.0))
    expect(verdict).to_contain_text(re.compile(r"left foot: the body cannot take this stance: .* left hip"))
    expect(editor).to_have_attribute("data-judged", "invalid")
    expect(verdict).not_to_contain_text("Valid")
    expect(page.locator("[data-phases] button").nth(10)).to_have_attribute("data-kind", "invalid")
    until(page, lambda: float(np.linalg.norm(base(page) - before)) > 0.05)


def test_the_robot_takes_the_posture_of_the_chosen_phase(tab: Tab, service: Service) -> None:
    page = opened(tab, "/view/?scenario=stairs-with-rail-hrp2&phase=0")
    expect(page.locator("[data-editor]")).to_have_attribute("data-judged", "valid", timeout=60_000)
    until(page, lambda: int(page.locator("[data-editor]").get_attribute("data-bodied") or 0) > 0)
    low = base(page)
    page.locator("[data-phases] button").nth(30).click()
    until(page, lambda: float(base(page)[2] - low[2]) > 0.3)
