"""Pages that lead on: home, sweeps, settings, and the navigation that reaches them all."""

import re
from collections.abc import Callable
from pathlib import Path

import httpx
import pytest
from starlette.routing import Route

from stridelab.schemas.service import ShownSetting
from stridelab_web.app import web_routes
from stridelab_web.pages.home import SAMPLE_RECORDING, SAMPLE_SCENARIO
from support.browser.every_page import every_page
from support.fakes.service import FakeService
from support.fakes.web_app import make_client

Browse = Callable[[str], httpx.Response]


@pytest.fixture
def stairs(fake: FakeService) -> None:
    """The two samples, with newer scenarios in front of them."""
    fake.recordings[SAMPLE_RECORDING] = fake.add_recording(bundled=True).model_copy(update={"id": SAMPLE_RECORDING})
    scenario = fake.add_scenario(bundled=True)
    del fake.scenarios[scenario.id]
    fake.scenarios[SAMPLE_SCENARIO] = scenario.model_copy(update={"id": SAMPLE_SCENARIO, "name": "Six stairs"})
    for _ in range(8):
        fake.add_scenario()


@pytest.mark.usefixtures("stairs")
def test_home_begins_with_the_sample_walk_and_the_stairs(browse: Browse) -> None:
    page = browse("/").text
    assert f'class="button primary" href="/view/?recording={SAMPLE_RECORDING}&amp;play=1"' in page
    plans = re.findall(r'data-plan="([\w-]+)"', page)
    assert plans[0] == SAMPLE_SCENARIO
    assert len(plans) == len(set(plans)) == 4


@pytest.mark.usefixtures("stairs")
def test_home_offers_to_watch_what_was_planned_before(fake: FakeService, browse: Browse) -> None:
    watch = re.compile(r"/view/\?plan=(\w+)&amp;play=1")
    assert not watch.search(browse("/").text)
    bare = fake.add_plan(scenario_id=SAMPLE_SCENARIO, whole_body=False)
    fake.change(bare.id, scenario_id=SAMPLE_SCENARIO)
    assert not watch.search(browse("/").text), "a plan without a body does not move"
    whole = fake.add_plan(scenario_id=SAMPLE_SCENARIO)
    fake.change(whole.id, scenario_id=SAMPLE_SCENARIO)
    assert watch.findall(browse("/").text) == [whole.id]


def test_sweeps_are_listed_by_what_they_found(fake: FakeService, browse: Browse) -> None:
    assert "None yet." in browse("/sweeps").text
    every_page(fake)
    page = browse("/sweeps").text
    assert "Steps over stride: 1 of 3, centre of mass only" in page
    assert page.count("<tr data-job=") == 1


def test_settings_say_what_is_in_force_and_who_one_is(fake: FakeService, browse: Browse) -> None:
    page = browse("/settings").text
    assert 'data-who="loopback"' in page
    assert "http://127.0.0.1/api/v1/recordings" in page
    assert "Bearer" not in page
    token = "correct-horse"
    settings = (ShownSetting(name="STRIDELAB_PORT", value="8123", meaning="the <one> port", changed=True),)
    guarded = make_client(fake, token=token, settings=settings).get("/settings").text
    assert 'data-who="token"' in guarded
    assert "Authorization: Bearer $STRIDELAB_API_TOKEN" in guarded
    assert 'data-setting="STRIDELAB_PORT"' in guarded
    assert "the &lt;one&gt; port" in guarded
    assert token not in guarded
    assert "data-tokens" in guarded
    assert "data-tokens" not in page


def test_every_page_is_reached_from_the_navigation(browse: Browse) -> None:
    page = browse("/").text
    nav = re.findall(r'<a href="([^"]+)"', page.partition("<nav")[2].partition("</nav>")[0])
    assert len(nav) == len(set(nav)) == 11
    for address in nav:
        outcome = browse(address)
        assert outcome.status_code == 200
        assert re.search(rf'<a href="{address}" aria-current="page"', outcome.text), address


def test_every_page_is_documented() -> None:
    message = (Path(__file__).parents[3] / "docs" / "pages.md").read_text(encoding="utf-8")
    documented = set(re.findall(r"`(/[^`?]*)`", message))
    pages = {
        route.path
        for route in web_routes()
        if isinstance(route, Route) and "." not in route.path and not re.search("/scene/|^/static/", route.path)
    }
    assert documented == pages


@pytest.mark.parametrize(
    ("scope", "said"),
    [
        ("centre of mass", "<strong>Centre of mass only</strong>: whether the body can follow was not computed"),
        ("whole body", "<strong>Whole body</strong>: a scenario has a motion where the body follows the plan"),
    ],
)
def test_a_sweep_says_what_it_planned(fake: FakeService, browse: Browse, scope: str, said: str) -> None:
    job = every_page(fake)["sweep"]
    job_id = job.rpartition("/")[2]
    result = fake.results[job_id]
    fake.results[job_id] = result.model_copy(update={"summary": {**result.summary, "scope": scope}})
    assert said in browse(job).text
    assert f"1 of 3, {'centre of mass only' if scope == 'centre of mass' else 'whole body'}" in browse("/sweeps").text
