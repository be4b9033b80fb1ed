"""A person from the first entry to the last: added, changed, given a recording, parted from it, deleted."""

import pytest
from playwright.sync_api import expect

from support.browser.page import Tab
from support.fakes.web_app import Lab

pytestmark = pytest.mark.usefixtures("lab")


def test_a_person_is_stored_with_recordings(tab: Tab, lab: Lab) -> None:
    recording = lab.fake.add_recording("walk.c3d")
    page = tab.go("/subjects")
    page.get_by_label("Pseudonym").fill("P07")
    page.get_by_label("Height").fill("1.71")
    page.get_by_role("button", name="Add").press("Enter")
    page.wait_for_url("**/subjects/s*")
    (person,) = lab.fake.subjects.stored.values()
    assert (person.name, person.height_m, person.sex) == ("P07", 1.71, None)

    page.get_by_role("spinbutton", name="Age").fill("31")
    with page.expect_navigation():
        page.get_by_role("button", name="Save").click()
    assert lab.fake.subjects.stored[person.subject_id].age_years == 31

    with page.expect_navigation():
        page.get_by_role("button", name="Add to this subject").click()
    assert lab.fake.recordings[recording.id].subject_id == person.subject_id
    page.get_by_role("button", name="Remove from this subject").click()
    expect(page.locator("[data-said-unlink]")).to_have_text("Choose recordings first.")
    page.get_by_label("Choose walk.c3d").check()
    with page.expect_navigation():
        page.get_by_role("button", name="Remove from this subject").click()
    assert lab.fake.recordings[recording.id].subject_id is None

    page.get_by_role("button", name="Delete…").click()
    expect(page.get_by_role("button", name="Keep it")).to_be_focused()
    page.keyboard.press("Escape")
    assert person.subject_id in lab.fake.subjects.stored
    page.get_by_role("button", name="Delete…").click()
    page.get_by_role("button", name="Delete", exact=True).click()
    page.wait_for_url("**/subjects")
    expect(page.get_by_text("No subjects yet.")).to_be_visible()
    assert lab.fake.subjects.stored == {}
