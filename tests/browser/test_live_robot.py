"""The page of a live robot: the scene follows the simulation, which is pushed, changed, paused and rewound."""

import re
from collections.abc import Callable

import numpy as np
from playwright.sync_api import Page, expect

from stridelab.schemas.scenarios import Scenario
from stridelab.service.samples.scenario_bodies import ONE_STEP
from support.browser.accessibility import faults_at_every_size
from support.browser.page import Service, Tab, nodes, until

BASE = "/robot/base_link"


def shown_s(page: Page) -> float:
    return float(page.locator("[data-live-robot]").get_attribute("data-shown") or "nan")


def base_m(page: Page) -> np.ndarray:
    return np.array(nodes(page, BASE)[BASE]["position"])


def push_until_moved(page: Page, before_m: np.ndarray) -> None:
    """Push until the drawn base has moved: a page that draws few pictures may miss what is balanced within a second."""
    for _ in range(6):
        page.click('[data-push="ahead"]')
        for _ in range(20):
            if float(np.linalg.norm(base_m(page) - before_m)) > 0.003:
                return
            page.wait_for_timeout(100)
    raise AssertionError("the robot is not drawn where a push moves it")


def test_a_live_robot_is_pushed_changed_paused_and_rewound(tab: Tab, service: Service) -> None:
    scenario = service.client.add_scenario(Scenario.model_validate(ONE_STEP))
    session = service.client.start_live(scenario.id)
    page = tab.go(session.page)
    robot = page.locator("[data-live-robot]")
    expect(robot).to_have_attribute("data-ready", "true", timeout=90_000)
    expect(robot).to_have_attribute("data-shown", re.compile(r"[1-9]"), timeout=90_000)
    before_s, before_m = shown_s(page), base_m(page)
    assert before_m[2] > 0.8, "TALOS' base is a metre above the floor"
    page.select_option("[name=speed]", "0.2")
    push_until_moved(page, before_m)
    expect(robot).to_have_attribute("data-pushed", re.compile(r"[1-9]"))
    page.locator('[data-setting="payload_kg"]').fill("12")
    expect(page.locator('[data-value="payload_kg"]')).to_have_text("12 kg")
    page.click("[data-reset]")
    expect(page.locator('[data-value="payload_kg"]')).to_have_text("0 kg")
    page.click('[data-order="pause"]')
    expect(page.locator('[data-order="resume"]')).to_be_visible()
    page.wait_for_timeout(200)
    rest_s = shown_s(page)
    page.wait_for_timeout(300)
    assert before_s < rest_s == shown_s(page)
    assert faults_at_every_size(page, "live-robot-paused") == {}
    page.click('[data-order="restart"]')
    until(page, lambda: shown_s(page) < rest_s)
    page.check("[name=drag]")
    expect(page.locator("[data-marks]")).to_have_attribute("data-active", "")
    page.select_option("[name=speed]", "0.6")
    for _ in range(4):
        page.click('[data-push="left"]')
    expect(page.locator("[data-fall]")).to_be_visible(timeout=60_000)
    expect(page.locator("[data-fall-summary]")).to_contain_text("The robot fell at")
    assert faults_at_every_size(page, "live-robot-fallen") == {}
    service.client.end_live(session.session_id)
    expect(page.locator("[data-said]")).to_have_text("This robot is no longer live. Start a new one.")
    service.client.delete_scenario(scenario.id)
    tab.go(session.page)
    expect(page.locator("h1")).to_have_text("This live robot has ended")
    tab.missteps = [misstep for misstep in tab.missteps if "status of 404" not in misstep]


def test_a_live_robot_is_steered_by_the_arrow_keys(open_tab: Callable[..., Tab], service: Service) -> None:
    session = service.client.start_live(robot="talos")
    page = open_tab().go(session.page)
    robot = page.locator("[data-live-robot]")
    expect(robot).to_have_attribute("data-shown", re.compile(r"[1-9]"), timeout=120_000)
    expect(page.locator("[data-steering]")).to_be_visible()
    page.locator("h1").click()
    page.keyboard.down("ArrowUp")
    expect(robot).to_have_attribute("data-doing", "steered", timeout=20_000)
    before_m = base_m(page)
    expect(page.locator('[data-fact="velocity"]')).to_have_text("0.40 m/s ahead", timeout=30_000)
    until(page, lambda: bool(np.linalg.norm(base_m(page) - before_m) > 0.1))
    page.keyboard.up("ArrowUp")
    expect(page.locator('[data-fact="velocity"]')).to_have_text("0.00 m/s ahead", timeout=60_000)
    expect(robot).to_have_attribute("data-doing", "steered")
    expect(page.locator('[data-fact="doing"]')).to_contain_text("stands as steered", timeout=30_000)
    page.locator('[data-setting="payload_kg"]').focus()
    other = open_tab(800, 600).go(session.page)
    other.locator('[data-setting="friction"]:enabled').fill("0.3", timeout=60_000)
    expect(page.locator('[data-value="friction"]')).to_have_text("0.30")
    other.goto("about:blank")
    service.client.end_live(session.session_id)
    expect(page.locator("[data-said]")).to_have_text("This robot is no longer live. Start a new one.")
