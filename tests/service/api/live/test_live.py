"""Live robots over a real websocket: who may watch and push, what is refused, limits, and the end.

The simulation of most tests is a fake that counts time; one test runs a short motion in its own process.
"""

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from stridelab.errors import InvalidInput, problem_of
from stridelab.schemas.live.messages import LiveSettings
from stridelab.service.api.live.endpoints import COMMAND_BYTES
from stridelab.service.api.live.room import MAX_COMMANDS, MAX_VIEWERS, TICK_S
from stridelab.service.api.live.rooms import LiveRooms
from stridelab.service.processes.running_child import IsolatedOutcome
from stridelab.service.samples.scenario_bodies import ONE_STEP
from support.service.database import TestDatabases
from support.service.processes import wait_until
from support.service.streams import receive_close, receive_reply
from support.service.web_server import Served, served

TOKEN = "a-secret-of-the-lab"
ROBOT = {
    "links": ["base"],
    "effectors": [],
    "mass_kg": 90.0,
    "duration_s": 2.0,
    "certified": True,
    "soles_m": {"left_foot": [0.1, 0.06]},
    "may_steer": True,
}


class FakeSimulation:
    """Counts simulated time; a push of 500 N s or more makes it fall, 900 N s kills it, on ``nose`` it is refused."""

    def __init__(self, fails: bool, slow_s: float) -> None:
        self.time_s, self.fallen, self.settings = 0.0, False, LiveSettings()
        self.pushes: list[Mapping[str, Any]] = []
        self.fails, self.slow_s = fails, slow_s

    async def run(self, task: Mapping[str, Any], *, answer_s: float = 0.0, on_progress: Any = None) -> IsolatedOutcome:
        if self.fails:
            error = InvalidInput("scenario-invalid", "A foot is in the air.")
            return IsolatedOutcome("error", None, problem_of(error), "InvalidInput", "")
        if "plan" in task:
            on_progress(0.5, "whole body: 50 %")
            return self.answer(robot=ROBOT)
        refusals, fell = [], self.fallen
        for k, command in enumerate(task["commands"]):
            if command["type"] == "set":
                changed = {name: value for name, value in command.items() if name != "type"}
                self.settings = self.settings.model_copy(update=changed)
            elif command["type"] == "rewind":
                self.time_s, self.fallen = max(0.0, self.time_s - 10.0), False
            elif command["type"] == "push":
                self.pushes.append(command)
                if command["impulse_ns"][0] >= 900.0:
                    return IsolatedOutcome("crashed", None, None, None, "Segmentation fault")
                self.fallen |= command["impulse_ns"][0] >= 500.0
                if command.get("link") == "nose":
                    refusals.append({"command": k, "code": "link-not-found", "message": "There is no nose."})
        await asyncio.sleep(self.slow_s)
        self.time_s += task["advance_s"]
        fall = json.dumps({"type": "fall", "summary": "It fell."}) if self.fallen and not fell else None
        return self.answer(advanced_s=task["advance_s"], fall=fall, refusals=refusals)

    def answer(self, **more: Any) -> IsolatedOutcome:
        value = {
            "frame": json.dumps({"type": "frame", "time_s": round(self.time_s, 3), "pushes": len(self.pushes)}),
            "fallen": self.fallen,
            "stopped": self.fallen,
            "can_rewind_s": min(self.time_s, 10.0),
            "settings": self.settings.model_dump(mode="json"),
            **more,
        }
        return IsolatedOutcome("ok", value, None, None, "")


Fakes = list[FakeSimulation]


@pytest.fixture
def fakes(monkeypatch: pytest.MonkeyPatch) -> Fakes:
    """The simulations that were opened; ``fails`` of the class decides what the next one does."""
    started: Fakes = []

    @asynccontextmanager
    async def open_child(_rooms: LiveRooms, robot: str) -> AsyncIterator[FakeSimulation]:
        started.append(FakeSimulation(fails=robot == "hrp2", slow_s=2.5 * TICK_S if robot == "g1" else 0.0))
        yield started[-1]

    monkeypatch.setattr(LiveRooms, "_open_child", open_child)
    return started


@pytest.fixture(scope="module")
def guarded(postgres: TestDatabases, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A service with a token, room for three robots, two of one user, that waits half a second for viewers."""
    limits = {"live_limit": 3, "user_live_limit": 2, "live_idle_s": 0.5, "api_token": TOKEN}
    with postgres.fresh() as url, served(url, tmp_path_factory.mktemp("data"), **limits) as running:
        yield running


@contextmanager
def watching(service: Served, session: Mapping[str, Any], **headers: str) -> Iterator[ClientConnection]:
    address = service.base_url.replace("http", "ws") + str(session["socket"])
    socket = connect(address, additional_headers=headers, proxy=None, compression=None, close_timeout=1)
    with socket:
        yield socket


def start(service: Served, robot: str = "talos", **headers: str) -> dict[str, Any]:
    with service.http() as http:
        opened = http.post("/api/v1/live", json={"robot": robot}, headers=headers)
    assert opened.status_code == 201, opened.text
    session: dict[str, Any] = opened.json()
    assert opened.headers["Location"] == f"/api/v1/live/{session['session_id']}"
    return session


def end(service: Served, session: Mapping[str, Any]) -> None:
    with service.http() as http:
        assert http.delete(f"/api/v1/live/{session['session_id']}").status_code == 204


def next_with(socket: ClientConnection, kind: str, holds: Callable[[dict[str, Any]], bool] = bool) -> dict[str, Any]:
    """The next message of a kind for which ``holds``."""
    for _ in range(2000):
        message = receive_reply(socket)
        if message.get("type") == kind and holds(message):
            return message
    raise AssertionError(f"no {kind} came")


def order(socket: ClientConnection, **command: Any) -> None:
    socket.send(json.dumps(command))


def test_all_viewers_see_the_same_robot_and_each_can_push_it(service: Served, fakes: Fakes) -> None:
    session = start(service)
    with watching(service, session) as first, watching(service, session) as second:
        state = next_with(first, "state", lambda one: one["phase"] == "running" and one["n_watching"] == 2)
        assert (state["robot"], state["may_push"]) == (ROBOT, True)
        order(second, type="push", impulse_ns=[10.0, 0.0, 0.0], number=1)
        for socket in (first, second):
            next_with(socket, "frame", lambda frame: frame["pushes"] == 1)
        order(first, type="push", impulse_ns=[600.0, 0.0, 0.0])
        for socket in (first, second):
            assert next_with(socket, "fall")["summary"] == "It fell."
        next_with(second, "state", lambda one: one["phase"] == "fallen")
        order(second, type="rewind")
        next_with(first, "state", lambda one: one["phase"] == "running")
    end(service, session)


def test_simulated_time_follows_the_clock_times_the_pace_and_stops_in_a_pause(service: Served, fakes: Fakes) -> None:
    session = start(service)
    with watching(service, session) as socket:
        order(socket, type="set", pace=0.5)
        state = next_with(socket, "state", lambda one: one["settings"]["pace"] == 0.5 and one["pace"] is not None)
        state = next_with(socket, "state", lambda one: one is not state and one["pace"] is not None)
        assert state["pace"] == pytest.approx(0.5, abs=0.1)
        order(socket, type="pause")
        next_with(socket, "state", lambda one: one["phase"] == "paused")
        at_s = fakes[0].time_s
        drain(socket)
        assert fakes[0].time_s == at_s
        order(socket, type="resume")
        next_with(socket, "frame", lambda frame: frame["time_s"] > at_s)
    end(service, session)


def test_a_slow_computer_slows_the_robot_and_reports_it(service: Served, fakes: Fakes) -> None:
    session = start(service, "g1")
    with watching(service, session) as socket:
        states = [next_with(socket, "state", lambda one: one["pace"] is not None) for _ in range(2)]
    assert states[-1]["pace"] == pytest.approx(0.4, abs=0.12), "a frame of 20 ms takes 50 ms"
    end(service, session)


def test_an_invalid_command_is_refused_and_the_robot_continues(service: Served, fakes: Fakes) -> None:
    session = start(service)
    bad = {
        "not-json": ['{"type":"push","impulse_ns":[NaN,0,0]}', "", "push"],
        "invalid-command": [
            '{"type":"push","impulse_ns":[1e9,0,0]}',
            '{"type":"push"}',
            '{"type":"jump"}',
            '{"type":"set","friction":0}',
            '{"type":"set","friction":"slippery"}',
            '{"type":"steer","ahead_m_s":0.5}',
            '{"type":"steer","turn_rad_s":"left"}',
            "[]",
        ],
        "link-not-found": ['{"type":"push","impulse_ns":[1,0,0],"link":"nose"}'],
    }
    with watching(service, session) as socket:
        next_with(socket, "state", lambda one: one["phase"] == "running")
        for code, messages in bad.items():
            for message in messages:
                socket.send(message)
                assert next_with(socket, "refused")["code"] == code, message
        socket.send(b"\x00\x01")
        assert next_with(socket, "refused")["code"] == "wrong-format"
        at_s = next_with(socket, "frame")["time_s"]
        next_with(socket, "frame", lambda frame: frame["time_s"] > at_s)
        assert fakes[0].settings == LiveSettings()
        socket.send(" " * (COMMAND_BYTES + 1))
        assert next_problem(socket) == "message-too-large"
        assert receive_close(socket) == (4413, "message-too-large")
    with watching(service, session) as flood:
        with contextlib.suppress(ConnectionClosed):  # the service may end the connection before the last one
            for _ in range(5 * MAX_COMMANDS):
                flood.send('{"type":"pause"}')
        assert next_problem(flood) == "stream-too-fast"
    end(service, session)


def next_problem(socket: ClientConnection) -> str:
    for _ in range(2000):
        message = receive_reply(socket)
        if "problem" in message and "type" not in message:
            return str(message["problem"]["code"])
    raise AssertionError("no problem came")


def test_a_simulation_that_dies_or_cannot_plan_gives_the_reason(service: Served, fakes: Fakes) -> None:
    for robot, code in (("hrp2", "scenario-invalid"), ("talos", "live-failed")):
        session = start(service, robot)
        with watching(service, session) as socket:
            if robot == "talos":
                next_with(socket, "state", lambda one: one["phase"] == "running")
                order(socket, type="push", impulse_ns=[900.0, 0.0, 0.0])
            state = next_with(socket, "state", lambda one: one["phase"] == "failed")
            assert state["problem"]["code"] == code
        end(service, session)


def test_requests_for_missing_objects_are_refused(service: Served) -> None:
    with service.http() as http:
        for body, status, code in (
            ({"robot": "nobody"}, 404, "robot-not-found"),
            ({"robot": "a\0b"}, 422, "invalid-text"),
            ({"scenario_id": "nothing"}, 404, "scenario-not-found"),
            ({}, 422, "invalid-request"),
            ({"robot": "g1", "scenario_id": "six-stairs"}, 422, "invalid-request"),
        ):
            answer = http.post("/api/v1/live", json=body)
            assert (answer.status_code, answer.json()["code"]) == (status, code)
            assert answer.headers["content-type"] == "application/problem+json"
        assert http.get("/api/v1/live/0123").json()["code"] == "session-not-found"
        assert http.delete("/api/v1/live/0123").status_code == 404
    with watching(service, {"socket": "/api/v1/live/0123"}) as socket:
        assert next_problem(socket) == "session-not-found"
        assert receive_close(socket) == (4404, "session-not-found")


def test_limits_of_the_service_of_a_user_and_of_viewers(guarded: Served, fakes: Fakes) -> None:
    def user(name: str, scope: str = "submit") -> dict[str, str]:
        with guarded.http(headers={"Authorization": f"Bearer {TOKEN}"}) as http:
            token = http.post("/api/v1/tokens", json={"name": name, "scope": scope}).json()
        return {"Authorization": f"Bearer {token['secret']}"}

    ann, bob, reader = user("ann"), user("bob"), user("cat", "read")
    session = start(guarded, **ann)
    with watching(guarded, session, **reader) as socket:
        state = next_with(socket, "state", lambda one: one["phase"] == "running")
        assert not state["may_push"]
        order(socket, type="push", impulse_ns=[1.0, 0.0, 0.0])
        assert next_with(socket, "refused")["code"] == "scope-missing"
        order(socket, type="pause")
        assert next_with(socket, "refused")["code"] == "scope-missing"
        assert not fakes[0].pushes

        with guarded.http() as http, contextlib.ExitStack() as watched:  # what is watched does not end
            second = http.post("/api/v1/live", json={"robot": "talos"}, headers=ann)
            watched.enter_context(watching(guarded, second.json(), **ann))
            refused = [
                http.post("/api/v1/live", json={"robot": "talos"}, headers=ann),
                http.post("/api/v1/live", json={"robot": "talos"}, headers=reader),
                http.delete(f"/api/v1/live/{session['session_id']}", headers=bob),
            ]
            third = http.post("/api/v1/live", json={"robot": "talos"}, headers=bob)
            watched.enter_context(watching(guarded, third.json(), **bob))
            refused.append(http.post("/api/v1/live", json={"robot": "talos"}, headers=bob))
        assert (second.status_code, third.status_code) == (201, 201)
        codes = [(answer.status_code, answer.json()["code"]) for answer in refused]
        assert codes == [(429, "too-many-live"), (403, "scope-missing"), (403, "not-owner"), (429, "too-many-live")]
        assert refused[0].headers["Retry-After"]

    for headers in ({}, {"Authorization": "Bearer wrong"}, {**ann, "Origin": "http://evil.example"}):
        with pytest.raises(InvalidStatus) as rejected, watching(guarded, session, **headers):
            pass
        assert rejected.value.response.status_code == 403
    wait_until(lambda: not guarded.parts.rooms.describe_all(), 10, "there are no viewers: all end")


def test_the_number_of_viewers_of_a_robot_is_limited(service: Served, fakes: Fakes) -> None:
    session = start(service)
    room = service.parts.rooms.require_room(session["session_id"])

    others = contextlib.ExitStack()

    async def fill() -> None:
        for _ in range(MAX_VIEWERS):
            others.enter_context(room.watch(may_push=False))

    service.run(fill())
    with watching(service, session) as socket:
        assert next_problem(socket) == "too-many-watching"
        assert receive_close(socket) == (4429, "too-many-watching")
    end(service, session)


def test_a_short_motion_in_its_own_process(service: Served) -> None:
    standing = {**ONE_STEP, "name": "Stand", "phases": [{**ONE_STEP["phases"][0], "duration_s": 0.6}]}
    with service.http() as http:
        scenario = http.post("/api/v1/scenarios", json=standing).json()
        session = http.post("/api/v1/live", json={"scenario_id": scenario["id"]}).json()
        assert http.get("/api/v1/live").json()["items"][0]["scenario_id"] == scenario["id"]
    with watching(service, session) as socket:
        state = next_with(socket, "state", lambda one: one["phase"] != "planning")
        assert (state["phase"], state["problem"]) == ("running", None)
        assert state["robot"]["mass_kg"] == pytest.approx(90.3, abs=1.0)
        order(socket, type="push", impulse_ns=[0.0, 5.0, 0.0], link="torso_2_link", number=3)
        frame = next_with(socket, "frame", lambda one: one["push"] is not None)
        assert frame["push"]["number"] == 3
        assert len(frame["links"]) == len(state["robot"]["links"])
        end(service, session)
        assert ended(socket) == (1000, "session-ended")


def ended(socket: ClientConnection) -> tuple[int, str]:
    """Code and reason of the end, after the messages that were under way."""
    with contextlib.suppress(ConnectionClosed):
        while True:
            socket.recv(timeout=30)
    return receive_close(socket)


def drain(socket: ClientConnection) -> None:
    """Read until nothing comes for 0.3 s."""
    try:
        while True:
            socket.recv(timeout=0.3)
    except TimeoutError:
        return
