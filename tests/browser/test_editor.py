"""The editor of scenarios on the real service: what moves is judged at once, contacts are planned between ends."""

import re

import numpy as np
import pytest
from playwright.sync_api import Locator, Page, expect

from stridelab.schemas.scenarios import (
    BoxSurface,
    PhaseSupport,
    Scenario,
    ScenarioCheck,
    ScenarioContact,
    ScenarioPhase,
)
from stridelab_web.scene.contacts import placed_contacts
from support.browser.page import Service, Tab, focus_by_tab, hold, nodes, opened, until

PLANNED_WITHIN_MS = 120_000
WARNING = [176, 0, 32]
LOOK = """(name) => {
    const viser = document.querySelector("iframe").contentWindow.__viserMutable;
    const mesh = viser.nodeRefFromName[name].children.find((part) => part.isMesh);
    const { color, opacity } = mesh.material;
    const { array } = mesh.geometry.attributes.position;
    const rgb = color.getStyle().match(/\\d+/g).map(Number);
    return { rgb, opacity, vertices: Array.from(array) };
}"""


def bare(service: Service, scenario_id: str, **changed: object) -> Scenario:
    stored = service.client.scenario(scenario_id)
    return Scenario(**{**{name: getattr(stored, name) for name in Scenario.model_fields}, **changed})


def two_stairs(service: Service, name: str) -> Scenario:
    """The first two of the six stairs, which are judged and drawn in a third of the time."""
    climb = service.client.scenario("six-stairs")
    phases = [*climb.phases[:8], climb.phases[8].model_copy(update={"duration_s": climb.phases[-1].duration_s})]
    return bare(service, "six-stairs", name=name, phases=phases, terrain=climb.terrain[:3])


def bars(page: Page) -> Locator:
    return page.locator("[data-phases] button")


def chosen(page: Page) -> int:
    return int(page.locator("[data-phases] [aria-pressed=true]").inner_text())


def refused(tab: Tab) -> None:
    """The browser reports an answer of 422 as an error, which here is what was to come."""
    tab.missteps = [m for m in tab.missteps if "422" not in m]


def test_a_contact_is_judged_while_it_is_held(tab: Tab, service: Service) -> None:
    remaining = service.client.add_scenario(bare(service, "flat-walk", name="dragged"))
    third = placed_contacts(remaining)[2]
    x, y, z = third.contact.position_m
    page = opened(tab, f"/view/?scenario={remaining.id}")
    editor, verdict = page.locator("[data-editor]"), page.locator("[data-verdict]")
    expect(editor).to_have_attribute("data-judged", "valid")

    hold(page, "/contacts/3", (x + 1.65, y, z))  # two steps beyond the next foothold
    expect(editor).to_have_attribute("data-judged", "invalid")
    expect(verdict).to_contain_text(re.compile(r"^Phase \d+"))
    assert service.client.scenario(remaining.id).phases == remaining.phases, "nothing is stored while it is held"
    until(page, lambda: page.evaluate(LOOK, "/contacts/3")["rgb"] == WARNING)
    row = page.locator("li", has=page.get_by_role("button", name="3 right foot"))
    expect(row.locator("[data-margins]")).to_contain_text("too short")
    expect(bars(page).nth(third.first_phase)).to_have_attribute("data-kind", "invalid")
    expect(bars(page).nth(0)).to_have_attribute("data-kind", "rest")

    page.mouse.up()
    expect(page.locator("[data-said]")).to_contain_text("The robot cannot do this")
    expect(editor).to_have_attribute("data-judged", "valid")
    expect(row.locator("[data-margins]")).to_contain_text("to spare")
    until(page, lambda: page.evaluate(LOOK, "/contacts/3")["rgb"] != WARNING)
    assert service.client.scenario(remaining.id).phases == remaining.phases
    refused(tab)


def test_numbers_are_judged_while_they_are_typed(tab: Tab, service: Service) -> None:
    """By Tab, Enter and digits alone, as by the mouse."""
    remaining = service.client.add_scenario(bare(service, "six-stairs", name="typed"))
    page = opened(tab, f"/view/?scenario={remaining.id}")
    contact = page.get_by_role("button", name="5 right foot")
    focus_by_tab(page, contact)
    page.keyboard.press("Enter")
    height = page.locator("li", has=contact).get_by_label("z")
    focus_by_tab(page, height)
    page.keyboard.press("Control+a")
    page.keyboard.type("0.3")
    expect(page.locator("[data-verdict]")).to_contain_text("right foot: is in the air")
    expect(page.locator("[data-margins]").nth(4)).to_contain_text("10.0 cm above the surface")
    for k in range(placed_contacts(remaining)[4].first_phase, placed_contacts(remaining)[4].last_phase + 1):
        expect(bars(page).nth(k)).to_have_attribute("data-kind", "invalid")
    assert service.client.scenario(remaining.id).phases == remaining.phases
    expect(height).to_be_focused()
    page.keyboard.press("Control+a")
    page.keyboard.type("0.2")
    expect(page.locator("[data-editor]")).to_have_attribute("data-judged", "valid")


def test_phases_are_gone_through_by_keyboard(tab: Tab, service: Service) -> None:
    """What is drawn is what the judge says of the phase; a sample, which cannot be changed, is looked at like any."""
    scenario = bare(service, "stairs-with-rail")
    check = service.client.check_scenario(scenario)
    page = opened(tab, "/view/?scenario=stairs-with-rail")
    expect(bars(page)).to_have_count(len(scenario.phases))
    tightest = min(check.support, key=spare)
    assert chosen(page) == tightest.phase

    page.locator("[data-phases] [aria-pressed=true]").focus()
    page.keyboard.press("Home")
    shows(page, check, 0)
    expect(page.locator("[data-phase-said]")).to_have_text(
        re.compile(r"^Phase 0: left foot, right foot, right hand\. The CoM can rest here with \d+\.\d cm to spare\.$")
    )
    page.keyboard.press("ArrowRight")
    shows(page, check, 1)
    page.keyboard.press("End")
    shows(page, check, len(scenario.phases) - 1)
    page.keyboard.press("ArrowLeft")
    shows(page, check, len(scenario.phases) - 2)
    assert page.evaluate("() => document.activeElement.textContent") == str(len(scenario.phases) - 2)
    assert page.locator("[data-phases] [tabindex='0']").count() == 1, "one stop for the tab key"

    fifth = placed_contacts(scenario)[4]
    page.get_by_role("button", name="5 right foot").click()
    own = check.support[fifth.first_phase : fifth.last_phase + 1]
    shows(page, check, min(own, key=spare).phase)
    until(page, lambda: page.evaluate(LOOK, "/contacts/5")["opacity"] > page.evaluate(LOOK, "/contacts/15")["opacity"])


def spare(support: PhaseSupport) -> float:
    """Room for the CoM, to a tenth of a millimetre: phases that have the same are there in their order."""
    assert support.margin_m is not None
    return round(support.margin_m, 4)


def shows(page: Page, check: ScenarioCheck, phase: int) -> None:
    """The chosen phase, its region and the best place of the CoM."""
    expect(bars(page).nth(phase)).to_have_attribute("aria-pressed", "true")
    com_m = check.support[phase].com_m
    assert com_m is not None
    until(page, lambda: np.abs(np.array(nodes(page, "/support/com")["/support/com"]["position"]) - com_m).max() < 1e-6)
    corners = np.array(page.evaluate(LOOK, "/support/region")["vertices"]).reshape(-1, 3)[:, :2]
    region = np.array(check.support_region_m[phase])
    apart = np.linalg.norm(corners[:, None] - region[None], axis=2)
    assert apart.min(axis=0).max() < 1e-5, "every corner of the region is drawn"
    assert apart.min(axis=1).max() < 1e-5, "and nothing else"


def test_contacts_are_planned_between_the_ends(tab: Tab, service: Service) -> None:
    page = opened(tab, "/view/?scenario=flat-walk")
    page.get_by_role("button", name="Find contacts").click()
    page.wait_for_url(lambda url: "scenario=" in url and "flat-walk" not in url, timeout=PLANNED_WITHIN_MS)
    page.wait_for_selector("[data-ready]", timeout=60_000)
    request, result = service.client.scenario("flat-walk"), service.client.scenario(page.url.rpartition("=")[2])
    assert result.name == "Flat walk: contacts found"
    assert not result.bundled
    for k in (0, -1):
        assert places(result.phases[k]) == pytest.approx(places(request.phases[k]))
    assert len(result.phases) > 2
    expect(page.locator("[data-editor]")).to_have_attribute("data-judged", "valid")

    job = service.client.jobs(kind="plan-contacts").items[0]
    page.goto(f"{service.url}/jobs/{job.id}")
    page.get_by_role("button", name="Save as a scenario").click()
    page.wait_for_url(lambda url: "scenario=" in url)
    again = service.client.scenario(page.url.rpartition("=")[2])
    assert again.id != result.id
    assert (again.name, again.phases) == (result.name, result.phases)


def places(phase: ScenarioPhase) -> dict[str, float]:
    return {
        f"{contact.effector} {axis}": value
        for contact in phase.contacts
        for axis, value in zip("xyz", contact.position_m, strict=True)
    }


def test_why_no_contacts_are_planned_is_shown(tab: Tab, service: Service) -> None:
    """A step of 19 cm, which the judge lets pass and the planner does not take; and a goal on one foot."""
    walk = bare(service, "flat-walk", name="high step")
    ground = next(surface for surface in walk.terrain if isinstance(surface, BoxSurface))
    step = BoxSurface(name="step", kind="box", center_m=(0.75, 0.0, 0.095), size_m=(1.0, 1.0, 0.19))

    def foot(side: str, x: float, z: float) -> ScenarioContact:
        return ScenarioContact(effector=f"{side}_foot", position_m=(x, 0.09 if side == "left" else -0.09, z))

    low, high = [foot("left", 0.0, 0.0), foot("right", 0.0, 0.0)], [foot("left", 0.4, 0.19), foot("right", 0.4, 0.19)]
    stances = [low, low[:1], [low[0], high[1]], high[1:], high]
    phases = [ScenarioPhase(duration_s=2.0, contacts=contacts) for contacts in stances]
    climb = walk.model_copy(update={"terrain": [ground, step], "phases": phases})
    page = opened(tab, f"/view/?scenario={service.client.add_scenario(climb).id}")
    page.get_by_role("button", name="Find contacts").click()
    expect(page.get_by_role("alert").filter(has_text="step")).to_be_visible(timeout=PLANNED_WITHIN_MS)
    expect(page.get_by_role("button", name="Find contacts")).to_be_enabled()

    one_foot = climb.model_copy(update={"phases": phases[:4]})
    page = opened(tab, f"/view/?scenario={service.client.add_scenario(one_foot).id}")
    page.get_by_role("button", name="Find contacts").click()
    expect(page.get_by_role("alert").filter(has_text="A goal needs both feet")).to_have_text(
        "A goal needs both feet, and the last phase lacks the left foot."
    )


def test_terrain_is_changed_by_numbers_and_its_contacts_follow(tab: Tab, service: Service) -> None:
    remaining = service.client.add_scenario(two_stairs(service, "raised"))
    names = [surface.name for surface in remaining.terrain]
    last = placed_contacts(remaining)[-1]
    page = opened(tab, f"/view/?scenario={remaining.id}")
    page.get_by_text("Terrain, friction and name").click()
    surface = page.locator("[data-surfaces] li").nth(len(names) - 1)
    surface.get_by_role("button", name=names[-1]).click()
    top = surface.get_by_label("top")
    before = float(top.input_value())
    top.fill(str(round(before + 0.01, 4)))
    top.press("Enter")
    expect(page.locator("[data-said]")).to_have_text(f"{names[-1]} stored.")
    stored = service.client.scenario(remaining.id)
    assert placed_contacts(stored)[-1].contact.position_m[2] == pytest.approx(last.contact.position_m[2] + 0.01)
    assert placed_contacts(stored)[0].contact.position_m == placed_contacts(remaining)[0].contact.position_m

    page.get_by_role("group", name="Add a surface").get_by_role("button", name="Wall").click()
    expect(page.locator("[data-said]")).to_have_text("Added a wall.")
    assert service.client.scenario(remaining.id).terrain[-1].name == "wall 1"
    for _ in range(2):
        page.get_by_role("button", name="Undo").click()
        expect(page.locator("[data-said]")).to_have_text("Undone.")
        page.evaluate("() => { document.querySelector('[data-said]').textContent = ''; }")
    assert service.client.scenario(remaining.id).terrain == remaining.terrain
    page.get_by_label("Name").fill("Renamed")
    page.get_by_label("Name").press("Enter")
    expect(page.get_by_role("heading", level=1)).to_have_text("Renamed")
    assert service.client.scenario(remaining.id).name == "Renamed"
