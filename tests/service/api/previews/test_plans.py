"""Plans that are answered directly: by a child that is replaced when it dies or hangs; never by the API."""

import asyncio
import os
import signal
from typing import Any

import httpx
import psutil
import pytest

from stridelab.centroidal.native.availability import NativeUnavailable, native_availability
from stridelab.errors import Busy, Unavailable
from stridelab.service.processes import resident as residents
from stridelab.service.processes.pool import IsolatedPool
from stridelab.service.processes.resident import PreviewProcess
from stridelab.service.samples import scenarios
from support.robots.scenario_bodies import one_step, with_contact
from support.service.processes import wait_for_exit, wait_until
from support.service.web_server import Served, fault_places, refusal_code

SOLVERS, PREVIEW = "/api/v1/solvers", "/api/v1/plans/preview"
REQUEST: dict[str, Any] = {"ask": "solvers"}
MISSING = isinstance(native_availability(), NativeUnavailable)


def child_of(service: Served) -> int:
    pid = service.parts.resident.pid
    assert pid is not None
    return pid


def test_the_solvers_of_this_machine_are_listed(http: httpx.Client) -> None:
    solvers = http.get(SOLVERS).json()
    native, *others = solvers["solvers"]
    assert (native["name"], native["available"], native["missing"] is None) == ("native", not MISSING, not MISSING)
    assert [(one["name"], one["available"]) for one in others] == [("ipopt", True), ("fatrop", True)]
    assert solvers["auto"] == ("ipopt" if MISSING else "native")


def test_a_child_that_was_killed_is_replaced(service: Served, http: httpx.Client) -> None:
    assert http.get(SOLVERS).status_code == 200
    first = child_of(service)
    assert first != os.getpid()
    psutil.Process(first).kill()
    answers = [http.get(SOLVERS).status_code for _ in range(2)]
    assert answers[-1] == 200
    assert set(answers) <= {200, 503}
    assert child_of(service) != first


def test_an_invalid_scenario_is_refused_by_name(http: httpx.Client) -> None:
    assert refusal_code(http.post(PREVIEW, json={})) == (422, "invalid-request")
    both = {"scenario": one_step(), "push": {"time_s": 1.0, "velocity_m_s": [0, 0, 0], "force_n": [0, 0, 0]}}
    assert refusal_code(http.post(PREVIEW, json=both)) == (422, "invalid-request")
    assert refusal_code(http.post(PREVIEW, json={"scenario_id": "0" * 32})) == (404, "scenario-not-found")


@pytest.mark.skipif(not MISSING, reason="the C++ solver is on this machine")
def test_a_missing_solver_is_reported(http: httpx.Client) -> None:
    answer = http.post(PREVIEW, json={"scenario": one_step()})
    assert refusal_code(answer) == (422, "solver-unavailable")
    assert "C++ solver" in answer.json()["detail"]


@pytest.mark.skipif(MISSING, reason="the C++ solver is not on this machine")
class TestPreview:
    def test_a_motion_from_rest_to_rest(self, http: httpx.Client) -> None:
        answer = http.post(PREVIEW, json={"scenario": one_step()})
        assert answer.status_code == 200, answer.text
        preview = answer.json()
        motion = preview["motion"]
        assert (preview["solver"], motion["converged"], preview["recovered"]) == ("native", True, None)
        assert motion["time_s"][0] == 0.0
        assert motion["time_s"][-1] == pytest.approx(preview["duration_s"]) == pytest.approx(3.0)
        (x0, y0, _), (x1, y1, _) = motion["com_m"][0], motion["com_m"][-1]
        # Over the soles' mean at both ends: the left foot has gone 0.2 m.
        assert (x0, y0, x1, y1) == pytest.approx((0.0, 0.0, 0.1, 0.0), abs=1e-6)

    def test_a_stored_scenario_by_its_id(self, service: Served, http: httpx.Client) -> None:
        service.run(scenarios.seed_scenarios(service.parts.engine))
        preview = http.post(PREVIEW, json={"scenario_id": "flat-walk"}).json()
        assert preview["motion"]["converged"]

    @pytest.mark.parametrize(
        ("push", "dy_m_s"),
        [
            ({"velocity_m_s": [0.0, 0.05, 0.0]}, 0.05),
            ({"force_n": [0.0, 90.0, 0.0], "duration_s": 0.05}, None),
        ],
    )
    def test_a_push_is_recovered_from(self, http: httpx.Client, push: Any, dy_m_s: float | None) -> None:
        preview = http.post(PREVIEW, json={"scenario": one_step(), "push": {"time_s": 1.4, **push}}).json()
        planned, recovered = preview["motion"], preview["recovered"]
        assert recovered["converged"], recovered["status"]
        assert recovered["time_s"][0] == pytest.approx(1.4 + push.get("duration_s", 0.0))
        assert recovered["time_s"][-1] == pytest.approx(3.0)
        assert recovered["com_m"][-1] == pytest.approx(planned["com_m"][-1], abs=1e-6)
        assert recovered["objective"] != pytest.approx(planned["objective"])
        if dy_m_s is not None:
            k = planned["time_s"].index(pytest.approx(1.4))
            assert recovered["com_m"][0] == pytest.approx(planned["com_m"][k], abs=1e-9)
            h = recovered["time_s"][1] - recovered["time_s"][0]
            went = (recovered["com_m"][1][1] - planned["com_m"][k + 1][1]) / h
            assert went == pytest.approx(dy_m_s, rel=0.5)

    def test_a_push_after_the_end_is_named(self, http: httpx.Client) -> None:
        push = {"time_s": 2.95, "velocity_m_s": [0.0, 0.1, 0.0]}
        answer = http.post(PREVIEW, json={"scenario": one_step(), "push": push})
        assert refusal_code(answer) == (422, "push-too-late")
        assert fault_places(answer) == ["push.time_s"]

    def test_an_infeasible_scenario_has_a_preview_with_the_reason(self, http: httpx.Client) -> None:
        answer = http.post(PREVIEW, json={"scenario": with_contact(0, 1, position_m=[0.0, -0.09, 0.3])})
        preview = answer.json()
        assert (answer.status_code, preview["motion"]["converged"], preview["motion"]["com_m"]) == (200, False, [])
        assert preview["errors"][0]["where"].startswith("phases[0].contacts[right_foot]")
        assert "right_foot" in preview["motion"]["status"]

    def test_a_motion_that_does_not_exist_gives_the_reason(self, http: httpx.Client) -> None:
        preview = http.post(PREVIEW, json={"scenario": one_step(friction=0.003)}).json()
        assert (preview["errors"], preview["motion"]["converged"], preview["motion"]["objective"]) == ([], False, None)
        assert preview["motion"]["status"]


@pytest.mark.anyio
async def test_a_child_that_hangs_is_replaced() -> None:
    async with IsolatedPool() as pool, PreviewProcess(pool, answer_s=0.5) as resident:
        await resident.ask(REQUEST)
        hung = resident.pid
        assert hung is not None
        os.kill(hung, signal.SIGSTOP)
        with pytest.raises(Unavailable) as stuck:
            await resident.ask(REQUEST)
        assert stuck.value.code == "preview-stuck"
        wait_until(lambda: not psutil.pid_exists(hung), 10, "the hanging child is killed and reaped")
        assert (await resident.ask(REQUEST))["solvers"]
        assert resident.pid != hung


@pytest.mark.anyio
async def test_the_answer_of_a_cancelled_request_is_not_given_to_another_request() -> None:
    async with IsolatedPool() as pool, PreviewProcess(pool) as resident:
        await resident.ask(REQUEST)
        given_up = asyncio.create_task(resident.ask({"ask": "preview", "input": {}}))
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        given_up.cancel()
        with pytest.raises(asyncio.CancelledError):
            await given_up
        assert "solvers" in await resident.ask(REQUEST)


@pytest.mark.anyio
async def test_too_many_requests_are_refused_with_retry_after(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(residents, "MAX_WAITING", 1)
    async with IsolatedPool() as pool, PreviewProcess(pool) as resident:
        first = asyncio.create_task(resident.ask(REQUEST))
        await asyncio.sleep(0)
        with pytest.raises(Busy) as busy:
            await resident.ask(REQUEST)
        assert busy.value.code == "preview-busy"
        assert "solvers" in await first


@pytest.mark.anyio
async def test_no_child_process_remains() -> None:
    async with IsolatedPool() as pool, PreviewProcess(pool) as resident:
        await resident.ask(REQUEST)
        child = psutil.Process(resident.pid)
    wait_until(lambda: wait_for_exit(child), 10, "the child ends")
