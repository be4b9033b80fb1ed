"""Scenarios, robots and plans through both clients."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import pytest

from stridelab.client import AsyncClient, Client, ProblemError
from stridelab.client.endpoints import LOADING_TIMEOUT_S
from stridelab.schemas.plans import PlanMotionInput
from stridelab.schemas.scenarios import Scenario
from stridelab.service.api.robots.cache import RobotCache
from stridelab.service.processes.pool import IsolatedPool
from stridelab.service.samples import scenarios
from support.robots.scenario_bodies import one_step, with_contact
from support.service.robot_children import FACTS, GLB, REACH
from support.service.web_server import Served


@pytest.fixture
def drawn(service: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Served]:
    """Robots are described and drawn by stand-ins."""
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[1]))
    monkeypatch.setenv("ROBOT_DIARY", str(tmp_path / "diary"))
    before = service.parts
    stubs = {name: f"support.service.robot_children:{name}" for name in ("describe", "draw", "enclose")}
    service.run(before.blobs.delete_prefix("robots"))  # made from the real robots
    shelf = RobotCache(IsolatedPool(), before.blobs, before.spool, 500, sandbox=None, **stubs)
    service.app.state.parts = replace(before, robots=shelf)
    yield service
    service.run(shelf.aclose())
    service.run(before.blobs.delete_prefix("robots"))
    service.app.state.parts = before


def test_a_scenario_from_storing_to_deletion(lab: Client, service: Served) -> None:
    service.run(scenarios.seed_scenarios(service.parts.engine))
    body = Scenario.model_validate(one_step())
    stored = lab.add_scenario(body)
    assert (stored.name, stored.bundled) == ("One step", False)
    assert lab.scenario(stored.id) == stored
    page = lab.scenarios(limit=1)
    assert page.items == [stored]
    assert all(item.bundled for item in lab.scenarios(cursor=page.next).items)

    changed = stored.model_copy(update={"name": "Another"})
    put = lab.put_scenario(stored.id, changed)  # sent back as it came
    assert (put.id, put.name, put.phases) == (stored.id, "Another", stored.phases)
    with pytest.raises(ProblemError) as late:
        lab.put_scenario(stored.id, body, unless_changed=stored)
    assert (late.value.status, late.value.code) == (412, "scenario-changed")
    assert lab.put_scenario(stored.id, changed, unless_changed=put).phases == stored.phases
    copy = lab.add_scenario(lab.scenario(scenarios.EXAMPLE_ID))
    assert copy.bundled is False
    with pytest.raises(ProblemError) as refused:
        lab.put_scenario(scenarios.EXAMPLE_ID, body)
    assert (refused.value.status, refused.value.code) == (409, "scenario-read-only")
    for each in (stored.id, copy.id):
        lab.delete_scenario(each)
        with pytest.raises(ProblemError) as missing:
            lab.scenario(each)
        assert missing.value.code == "scenario-not-found"


def test_a_check_and_a_refusal_name_the_same_places(lab: Client) -> None:
    assert lab.check_scenario(one_step()).valid
    broken = with_contact(0, 1, position_m=[0.0, -0.09, 0.3])
    check = lab.check_scenario(broken)
    assert not check.valid
    with pytest.raises(ProblemError) as refused:
        lab.add_scenario(broken)
    assert refused.value.code == "scenario-invalid"
    assert refused.value.errors == check.errors


def test_a_plan_at_once_needs_the_fast_solver(lab: Client) -> None:
    known = lab.solvers()
    assert known.auto in {solver.name for solver in known.solvers if solver.available}
    if known.auto == "native":
        assert lab.preview_plan({"scenario": one_step()}).motion.converged
        return
    with pytest.raises(ProblemError) as refused:
        lab.preview_plan({"scenario": one_step()})
    assert refused.value.code == "solver-unavailable"


def test_plans_of_a_scenario(lab: Client) -> None:
    stored = lab.add_scenario(one_step())
    job = lab.submit("plan-motion", PlanMotionInput(scenario_id=stored.id))
    assert job.scenario_id == stored.id
    assert lab.jobs(scenario_id=stored.id).items == [job]
    assert lab.jobs(scenario_id=stored.id, state="failed").items == []


def test_facts_meshes_and_reach_of_a_robot_come_as_the_service_has_them(
    lab: Client, drawn: Served, tmp_path: Path
) -> None:
    assert "talos" in [robot.name for robot in lab.robots().items if robot.available]
    assert lab.robot("talos").model_dump(mode="json") == FACTS
    assert lab.robot_links("talos", tmp_path / "talos.glb").read_bytes() == GLB
    assert lab.robot_reachability("talos") == lab.robot_reachability("talos", "uniform")
    assert lab.robot_reachability("talos").model_dump(mode="json") == REACH
    assert (lab.robot_preparation("talos").state, lab.robot_preparation("talos").fraction) == ("ready", 1.0)
    with pytest.raises(ProblemError) as unknown:
        lab.robot_reachability("talos", "conditioned")
    assert unknown.value.code == "reachability-not-learned"
    with pytest.raises(ProblemError) as refused:
        lab.robot_links("../nao", tmp_path / "nao.glb")
    assert refused.value.status == 404
    assert not (tmp_path / "nao.glb").exists()


@pytest.mark.anyio
async def test_the_asynchronous_client_does_the_same(drawn: Served, tmp_path: Path) -> None:
    async with AsyncClient(drawn.base_url) as lab:
        stored = await lab.add_scenario(one_step())
        assert await lab.scenario(stored.id) == stored
        assert (await lab.scenarios(limit=1)).items == [stored]
        assert (await lab.put_scenario(stored.id, one_step(name="Another"))).name == "Another"
        assert (await lab.check_scenario(one_step())).valid
        await lab.delete_scenario(stored.id)
        assert (await lab.jobs(scenario_id=stored.id)).items == []
        assert "talos" in [robot.name for robot in (await lab.robots()).items]
        assert (await lab.robot("talos")).sha256 == FACTS["sha256"]
        assert (await lab.robot_links("talos", tmp_path / "talos.glb")).read_bytes() == GLB
        assert (await lab.robot_reachability("talos")).robot == "talos"
        assert (await lab.robot_preparation("talos")).state == "ready"


def test_a_robot_may_take_longer_than_other_calls() -> None:
    timeouts: list[dict[str, Any]] = []

    def handler(request: httpx.Request) -> httpx.Response:
        timeouts.append(request.extensions["timeout"])
        return httpx.Response(200, json=FACTS)

    with Client("http://lab", timeout_s=5.0, transport=httpx.MockTransport(handler)) as lab:
        lab.robot("talos")
    assert timeouts[0]["read"] == 5.0 + LOADING_TIMEOUT_S
