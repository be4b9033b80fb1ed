"""Pages of robots: the list, one robot with its densities, and what is not there."""

import asyncio
import re
from collections.abc import Callable

import httpx
import pytest

from stridelab.client import AsyncClient
from stridelab.schemas.jobs import Job
from stridelab.schemas.robots import RobotPreparation, WalkerFacts
from stridelab_web.pages.robot import unfinished_commission
from support.fakes import reachability, robots
from support.fakes.service import FakeService

Browse = Callable[[str], httpx.Response]


def texts(page: str) -> str:
    """What a reader sees, in one line."""
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", page))


def test_robots_are_reached_from_every_page_and_listed(browse: Browse) -> None:
    assert 'href="/robots"' in browse("/").text
    page = browse("/robots").text
    assert 'data-robot="boxes" data-available="true"' in page
    assert 'data-robot="rare" data-available="false"' in page
    assert "The package &lt;rare&gt; is not installed." in page
    assert 'href="/view/?robot=boxes"' in page
    assert 'href="/view/?robot=rare"' not in page


def test_robot_page_tells_mass_soles_licence_and_what_was_learned(browse: Browse) -> None:
    message = texts(browse("/robots/boxes").text)
    assert "60.00 kg" in message
    assert "200 × 120 mm" in message
    assert "BSD-3-Clause" in message
    assert "0.0700 ± 0.0073" in message
    assert "right hand contact 6 14" in message
    assert "20000 37.5 % of 32000" in message
    assert "Learned on 2026-01-02 with seed 3" in message


def test_scenes_are_offered_to_a_robot_with_legs(browse: Browse, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "data-scene" not in browse("/robots/boxes").text
    legs = WalkerFacts(leg_m=0.4, foot_y_m=0.1, toe_m=0.1, heel_m=0.1)
    facts = robots.robot().model_copy(update={"walker": legs})
    monkeypatch.setattr(robots, "robot", lambda *_: facts)
    page = browse("/robots/boxes").text
    assert re.findall(r'data-scene="([^"]*)"', page) == ["flat-walk", "long-stride", "six-stairs", "stairs-down"]
    assert "scaled to legs of 0.40 m" in texts(page)


def test_the_measure_is_chosen_by_the_address(browse: Browse) -> None:
    shown = browse("/robots/boxes").text
    assert 'aria-current="page">Uniform, used by plans</a>' in shown
    other = browse("/robots/boxes?measure=conditioned").text
    assert 'aria-current="page">Conditioned</a>' in other
    assert "right hand heading 6 14" in texts(other)
    assert 'data-maps="/robots/boxes/reach.json?measure=conditioned"' in other
    assert 'aria-current="page">Uniform' in browse("/robots/boxes?measure=nonsense").text


def test_the_curve_marks_the_chosen_size_and_that_of_the_thesis(browse: Browse) -> None:
    page = browse("/robots/boxes").text
    assert page.count('class="band group') == 6, "two charts"
    assert "left foot, 6: 0.0700 ± 0.0073 nats, chosen" in page
    assert "left foot, 7: 0.0629 ± 0.0069 nats, size of the thesis" in page
    assert "right hand, 14: 0.0534 ± 0.0054 nats, size of the thesis" in page


def test_maps_and_volumes_are_those_of_the_service(browse: Browse) -> None:
    drawn = browse("/robots/boxes/reach.json?measure=conditioned&effector=right_hand").json()
    result = reachability.reach("conditioned").effectors[2]
    assert (drawn["effector"], drawn["frame"], drawn["components"]) == ("right_hand", "heading", 6)
    assert drawn["volumes_m3"] == {f"{m:g}": pytest.approx(4 / 3 * r**3) for m, r in reachability.RADII_M.items()}
    assert drawn["maps"] == [each.model_dump(mode="json") for each in result.projections]
    assert browse("/robots/boxes/reach.json?effector=tail").status_code == 404
    assert browse("/robots/boxes/reach.json").json()["effector"] == "left_foot"


def test_a_robot_of_which_nothing_was_learned_can_be_learned(fake: FakeService, browse: Browse) -> None:
    fake.measures = []
    page = browse("/robots/boxes").text
    assert "No densities have been learned for this robot yet." in page
    assert 'data-learn="boxes"' in page
    assert "data-maps" not in page
    assert browse("/robots/boxes/reach.json").status_code == 404


def test_densities_of_another_description_are_named_and_not_shown(fake: FakeService, browse: Browse) -> None:
    fake.measures, fake.stale_measures = ["conditioned"], ["uniform"]
    page = browse("/robots/boxes").text
    assert "The uniform densities were learned on another description of this robot" in texts(page)
    assert 'aria-current="page">Conditioned</a>' in page
    assert "another description" in browse("/view/?robot=boxes").text
    fake.measures = []
    assert "No densities have been learned" not in browse("/robots/boxes").text


@pytest.mark.parametrize("code", ["robot-data-missing", "robot-not-loaded"])
def test_a_robot_that_is_not_installed_says_what_is_known(fake: FakeService, browse: Browse, code: str) -> None:
    fake.robot_refusal = (503, code, "Its package <b> is missing.")
    answer = browse("/robots/boxes")
    assert answer.status_code == 503
    message = texts(answer.text)
    assert "Its package &lt;b&gt; is missing." in message
    assert "left foot, right foot, right hand" in message


def test_other_refusals_are_shown_as_everywhere(fake: FakeService, browse: Browse) -> None:
    fake.robot_refusal = (404, "robot-not-found", "There is no robot of this name.")
    answer = browse("/robots/nao")
    assert answer.status_code == 404
    assert "There is no robot of this name." in answer.text


def test_a_job_that_learned_shows_the_same(fake: FakeService, browse: Browse) -> None:
    job = fake.add_job("learn-reachability", "succeeded")
    page = browse(f"/jobs/{job.id}").text
    assert "right hand heading 6 14" in texts(page)
    assert f'data-maps="/jobs/{job.id}/reach.json"' in page
    assert browse(f"/jobs/{job.id}/reach.json?effector=right_foot").json()["effector"] == "right_foot"
    assert [key in page for key in ('data-fact="measure"', 'data-fact="tried"')] == [True, False]
    other = fake.add_job(state="succeeded")
    assert browse(f"/jobs/{other.id}/reach.json").status_code == 404


def test_the_viewer_of_a_robot_offers_what_was_learned(fake: FakeService, browse: Browse) -> None:
    page = browse("/view/?robot=boxes&measure=conditioned").text
    assert 'data-scene="/view/scene/robot/boxes/-"' in page
    assert '<option value="conditioned" selected>' in page
    assert """"conditioned": {"left_foot": "contact", "right_foot": "contact", "right_hand": "heading"}""" in page
    fake.measures = []
    assert "No densities have been learned for this robot yet" in browse("/view/?robot=boxes").text
    assert browse("/view/scene/robot/boxes/-/frames.bin").status_code == 404


def test_a_plan_can_show_its_densities_where_there_are_some(fake: FakeService, browse: Browse) -> None:
    job = fake.add_plan()
    assert 'data-show="/reach/"' in browse(f"/view/?plan={job.id}").text
    fake.measures = []
    assert 'data-show="/reach/"' not in browse(f"/view/?plan={job.id}").text
    fake.robot_refusal = (503, "robot-data-missing", "Its package is missing.")
    assert browse(f"/view/?plan={job.id}").status_code == 200


def test_a_viewer_whose_robot_is_being_prepared_tells_how_far_it_is(fake: FakeService, browse: Browse) -> None:
    scenario = fake.add_scenario()
    plan = fake.add_plan(scenario)
    for address in ("/view/?robot=boxes", f"/view/?scenario={scenario.id}", f"/view/?plan={plan.id}"):
        fake.preparation = RobotPreparation(state="preparing", fraction=0.418, message="thinning out its meshes")
        waiting = browse(address)
        assert waiting.status_code == 200
        assert 'data-preparing="boxes"' in waiting.text
        assert 'max="100" value="41"' in waiting.text
        assert "41 %: thinning out its meshes" in texts(waiting.text)
        assert "<iframe" not in waiting.text, "no scene is requested before it can be built"
        fake.preparation = robots.READY
        ready = browse(address).text
        assert "<iframe" in ready
        assert "data-preparing" not in ready


def test_a_viewer_whose_robot_cannot_be_prepared_says_why_at_once(fake: FakeService, browse: Browse) -> None:
    fake.preparation = RobotPreparation(state="failed", fraction=0.0, message="Its data is missing.")
    fake.robot_refusal = (503, "robot-data-missing", "Its data is missing.")
    answer = browse("/view/?robot=boxes")
    assert answer.status_code == 503
    assert "Its data is missing." in answer.text


@pytest.mark.parametrize("state", ["queued", "running", "succeeded", "failed", "cancelled", "timed_out"])
def test_the_newest_commissioning_is_named_unless_it_succeeded(fake: FakeService, state: str) -> None:
    for about, of in (("boxes", "failed"), ("boxes", state), ("rare", "running")):
        job = fake.add_job("commission-robot")
        fake.jobs[job.id] = job.model_copy(update={"about": about, "state": of})
    own = [job.id for job in fake.jobs.values() if job.about == "boxes"]
    shown = asyncio.run(_unfinished_commission(fake, "boxes"))
    assert (shown.id if shown else None) == (None if state == "succeeded" else own[-1])
    assert asyncio.run(_unfinished_commission(fake, "other")) is None


async def _unfinished_commission(fake: FakeService, name: str) -> Job | None:
    async with AsyncClient("http://127.0.0.1", transport=httpx.ASGITransport(fake.app())) as client:
        return await unfinished_commission(client, name)
