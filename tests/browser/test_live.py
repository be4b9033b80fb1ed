"""Plans that follow the mouse: the centre of mass' way is drawn anew while a contact is held and after a push."""

import os
import re

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from stridelab.centroidal.native.availability import NativeUnavailable, native_availability
from stridelab.schemas.previews import PlanPreviewInput, PreviewPush
from stridelab.schemas.scenarios import Scenario
from stridelab_web.scene.contacts import placed_contacts
from stridelab_web.viewer.scenario_scene import RINGS, SIDES
from support.browser.page import Service, Tab, hold, opened, until

if isinstance(native_availability(), NativeUnavailable):
    pytest.skip(f"live plans need the C++ solver ({os.environ.get('STRIDELAB_NATIVE_PATH') or 'not built'})",
                allow_module_level=True)  # fmt: skip

STARTED_WITHIN_MS = 90_000
"""The planner's process imports its libraries with the first question."""
VERTICES = """(name) => {
    const viser = document.querySelector("iframe").contentWindow.__viserMutable;
    const node = viser.nodeRefFromName[name];
    const mesh = node.children.find((part) => part.isMesh);
    return { scale: node.scale.x, vertices: Array.from(mesh.geometry.attributes.position.array) };
}"""


def way_m(page: Page, name: str) -> np.ndarray | None:
    """The middle of each ring of a tube, which is the drawn path; None where it is not shown."""
    seen = page.evaluate(VERTICES, name)
    if seen["scale"] < 0.5:
        return None
    return np.array(seen["vertices"]).reshape(RINGS, SIDES, 3).mean(axis=1)


def test_the_plan_follows_a_contact_that_is_held(tab: Tab, service: Service) -> None:
    stored = service.client.scenario("flat-walk")
    body = Scenario(**{name: getattr(stored, name) for name in Scenario.model_fields})
    scenario = service.client.add_scenario(body)
    third = placed_contacts(scenario)[2]
    x, y, z = third.contact.position_m
    page = opened(tab, f"/view/?scenario={scenario.id}")
    message = page.locator("[data-live-said]")
    expect(message).to_have_text("The centre of mass can move along the drawn path.", timeout=STARTED_WITHIN_MS)
    expect(message).to_have_attribute(
        "title", re.compile(r"cost -?\d+\.\d+, \d+ iterations, solved in \d+\.\d ms; answered in \d+ ms")
    )
    until(page, lambda: way_m(page, "/live/planned") is not None)
    before = way_m(page, "/live/planned")
    planned = service.client.preview_plan(PlanPreviewInput(scenario_id=scenario.id)).motion
    assert before is not None
    np.testing.assert_allclose(before[[0, -1]], np.array(planned.com_m)[[0, -1]], atol=2e-3)

    hold(page, "/contacts/3", (x, y - 0.06, z))
    until(page, lambda: np.abs(np.asarray(way_m(page, "/live/planned")) - before).max() > 2e-3)
    assert service.client.scenario(scenario.id).phases == scenario.phases, "nothing is stored while it is held"
    page.mouse.up()
    expect(page.locator("[data-said]")).to_have_text("Stored.")

    page.get_by_role("checkbox", name="Plan while you drag").uncheck()
    until(page, lambda: way_m(page, "/live/planned") is None)


def test_the_plan_follows_a_length_that_is_typed(tab: Tab, service: Service) -> None:
    stored = service.client.scenario("flat-walk")
    scenario = service.client.add_scenario(Scenario(**{name: getattr(stored, name) for name in Scenario.model_fields}))
    page = opened(tab, f"/view/?scenario={scenario.id}&phase=3")
    expect(page.locator("[data-live-said]")).to_contain_text("can move along", timeout=STARTED_WITHIN_MS)
    until(page, lambda: way_m(page, "/live/planned") is not None)
    before = way_m(page, "/live/planned")
    assert before is not None
    page.get_by_label("lasts").fill(str(scenario.phases[3].duration_s + 0.6))
    until(page, lambda: np.abs(np.asarray(way_m(page, "/live/planned")) - before).max() > 2e-3)
    assert service.client.scenario(scenario.id).phases == scenario.phases, "nothing is stored while it is typed"
    page.locator("h1").click()  # which leaves the field, and so stores
    expect(page.locator("[data-said]").first).to_have_text("Phase 3 stored.")
    changed = service.client.scenario(scenario.id).phases
    assert [k for k, (a, b) in enumerate(zip(scenario.phases, changed, strict=True)) if a != b] == [3]


def test_a_push_and_what_follows_it(tab: Tab, service: Service) -> None:
    page = opened(tab, "/view/?scenario=flat-walk")
    expect(page.locator("[data-live-said]")).to_contain_text("can move along", timeout=STARTED_WITHIN_MS)
    until(page, lambda: way_m(page, "/live/planned") is not None)
    assert way_m(page, "/live/recovered") is None
    page.get_by_text("Apply a push").click()
    form = page.locator("form[data-push]")
    form.locator("[name=time]").fill("3.5")
    form.locator("[name=y]").fill("0.02")
    form.get_by_role("button", name="Push", exact=True).click()
    expect(page.locator("[data-push-said]")).to_contain_text("It recovers")
    push = PreviewPush(time_s=3.5, velocity_m_s=(0.0, 0.02, 0.0))
    truth = service.client.preview_plan(PlanPreviewInput(scenario_id="flat-walk", push=push)).recovered
    assert truth is not None
    until(page, lambda: way_m(page, "/live/recovered") is not None)
    shown = way_m(page, "/live/recovered")
    assert shown is not None
    np.testing.assert_allclose(shown[[0, -1]], np.array(truth.com_m)[[0, -1]], atol=2e-3)
    form.get_by_role("button", name="No push").click()
    until(page, lambda: way_m(page, "/live/recovered") is None)
