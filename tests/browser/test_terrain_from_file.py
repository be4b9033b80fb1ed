"""A scenario from the file of a terrain on the real service: from the file to planned contacts."""

from pathlib import Path

import pytest
from playwright.sync_api import expect

from support.browser.page import Service, Tab
from support.browser.places import click_at_place
from support.service.terrain_files import RISE_M, STAIRS, stairs

PLANNED_WITHIN_MS = 120_000


@pytest.mark.timeout(300)
def test_a_file_in_millimetres_becomes_a_scenario(tab: Tab, service: Service, tmp_path: Path) -> None:
    """The page, the file, the unit that is offered, two clicks on the plan, and the feet."""
    file = tmp_path / "my stairs.stl"
    file.write_bytes(stairs(1000.0))
    page = tab.go("/scenarios/new")
    page.get_by_role("link", name="From a file").click()
    page.locator("input[type=file]").set_input_files(file)
    page.get_by_role("button", name="Read it in millimetres").click()
    expect(page.locator("[data-plan-view] polygon.floor")).to_have_count(len(STAIRS))
    expect(page.locator("[data-summary]")).to_have_text(f"4 surfaces, 0.00 to {3 * RISE_M:.2f} m high.")
    click_at_place(page, 0.0, 0.0)
    click_at_place(page, 1.8, 0.0)
    expect(page.locator("[data-placed]")).to_have_text(
        f"Start point: 0.00 m high. Goal point: {3 * RISE_M:.2f} m high."
    )
    page.get_by_label("Robot").select_option("talos")
    page.get_by_role("button", name="Place the feet only").click()
    page.wait_for_url("**/view/?scenario=*", timeout=PLANNED_WITHIN_MS)
    stored = service.client.scenario(page.url.rpartition("=")[2])
    assert (stored.name, stored.robot, len(stored.terrain)) == ("my stairs", "talos", len(STAIRS))
    for phase, height_m in ((stored.phases[0], 0.0), (stored.phases[-1], 3 * RISE_M)):
        assert [contact.position_m[2] for contact in phase.contacts] == pytest.approx([height_m] * 2, abs=1e-4)
    tab.missteps = [misstep for misstep in tab.missteps if "status of 422" not in misstep]


def test_a_file_that_is_no_terrain_is_refused_with_its_name(tab: Tab, service: Service, tmp_path: Path) -> None:
    file = tmp_path / "walk.stl"
    file.write_bytes(b"\x02\x50" + bytes(600))
    page = tab.go("/scenarios/new/file")
    page.locator("input[type=file]").set_input_files(file)
    expect(page.locator("[data-file-said]")).to_contain_text("walk.stl: The mesh of the terrain cannot be used.")
    expect(page.locator("[data-found]")).to_be_hidden()
    tab.missteps = [misstep for misstep in tab.missteps if "status of 422" not in misstep]
