"""``stridelab live``: it uses the service that runs, says the address of the page, and opens it."""

import json
import webbrowser
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar, Self

import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

import stridelab.client
from stridelab.client import Unreachable
from stridelab.schemas.live.messages import LiveSession
from support.command_line import Ran, Run

SESSION = LiveSession(
    session_id="ab12", title="Six stairs", robot="talos", scenario_id="six-stairs", phase="planning", n_watching=0,
    page="/live/robots/ab12", socket="/api/v1/live/ab12",
)  # fmt: skip


class FakeClient:
    """A service that runs at every address but ``http://nowhere``."""

    started: ClassVar[list[tuple[str | None, str | None, tuple[float, float, float] | None]]] = []

    def __init__(self, server: str, token: str | None) -> None:
        self.server = server

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def health(self) -> None:
        if self.server == "http://nowhere":
            raise Unreachable("connection refused")

    def start_live(
        self, scenario_id: str | None, robot: str | None, velocity: tuple[float, float, float] | None
    ) -> LiveSession:
        self.started.append((scenario_id, robot, velocity))
        return SESSION

    def watch_live(self, session_id: str) -> Iterator[str]:
        """Two frames, the first one again as by a slow service, a rewind, and a frame after it."""
        assert session_id == SESSION.session_id
        links = [[0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0]]
        robot = {"links": ["pelvis"], "effectors": ["left_foot", "left_hand"]}
        yield json.dumps({"type": "state", "robot": None})
        yield json.dumps({"type": "state", "robot": robot})
        for time_s in (12.0, 12.02, 12.02, 2.02):
            frame = {"type": "frame", "time_s": time_s, "links": links, "com_m": [time_s, 0.0, 0.9]}
            frame["effectors_m"] = {"left_foot": [0.0, 0.1, 0.0], "left_hand": [0.3, 0.4, 0.9]}
            frame["forces_n"] = {"left_foot": [0.0, 0.0, 400.0], "left_hand": [0.0, 0.0, 0.0]}
            yield json.dumps({**frame, "contacts": ["left_foot"]})
            yield json.dumps({"type": "state", "robot": robot})


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Addresses that were opened in the browser."""
    addresses: list[str] = []
    monkeypatch.setattr(webbrowser, "open", addresses.append)
    monkeypatch.setattr(stridelab.client, "Client", FakeClient)
    FakeClient.started.clear()
    return addresses


def test_the_page_of_the_new_robot_is_opened(run: Run, opened: list[str]) -> None:
    ran: Ran = run("live", "six-stairs", "--server", "http://lab:8000/")
    assert ran.code == 0
    assert "http://lab:8000/live/robots/ab12" in ran.out.replace("\n", "")
    assert opened == ["http://lab:8000/live/robots/ab12"]
    assert FakeClient.started == [("six-stairs", None, None)]


def test_a_robot_walks_at_the_given_velocity(run: Run, opened: list[str]) -> None:
    done: Ran = run("live", "--robot", "talos", "--velocity", "0.3,0,-0.1", "--no-open", "--server", "http://lab:8000")
    assert done.code == 0
    assert not opened
    assert FakeClient.started == [(None, "talos", (0.3, 0.0, -0.1))]


@pytest.mark.parametrize("velocity", ["0.3,0", "fast", "0.5,0,0", "0,0.3,0", "0,0,nan"])
def test_velocities_that_no_robot_can_follow_are_refused(run: Run, opened: list[str], velocity: str) -> None:
    done: Ran = run("live", "--robot", "talos", "--velocity", velocity, "--server", "http://lab:8000")
    assert done.code != 0
    assert "AHEAD,LEFT,TURN" in " ".join(done.err.split())
    assert not FakeClient.started


def test_a_script_gets_the_session_and_no_browser(run: Run, opened: list[str]) -> None:
    ran: Ran = run("live", "--robot", "g1", "--no-open", "--json", "--server", "http://lab:8000")
    session = json.loads(ran.out)
    assert session["url"] == "http://lab:8000/live/robots/ab12"
    assert LiveSession.model_validate({k: v for k, v in session.items() if k != "url"}) == SESSION
    assert not opened
    assert FakeClient.started == [(None, "g1", None)]


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        ((), "option-invalid"),
        (("six-stairs", "--robot", "g1"), "option-invalid"),
        (("six-stairs", "--server", "http://nowhere"), "service-unreachable"),
    ],
)
def test_an_impossible_session_is_refused(run: Run, opened: list[str], arguments: tuple[str, ...], code: str) -> None:
    ran: Ran = run("live", *arguments)
    assert ran.code != 0
    assert code in ran.err.replace("\n", "")
    assert not opened


def test_a_log_that_cannot_be_written_starts_no_robot(run: Run, opened: list[str], tmp_path: Path) -> None:
    ran: Ran = run("live", "six-stairs", "--log", str(tmp_path / "nowhere" / "run.mcap"))
    assert ran.code == 2
    assert "output-not-writable" in ran.err.replace("\n", "")
    assert not opened
    assert not FakeClient.started


@pytest.mark.usefixtures("opened")
def test_a_session_is_recorded_as_a_log_whose_time_does_not_go_back(run: Run, tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    log.write_bytes(b"an earlier log")
    ran: Ran = run("live", "six-stairs", "--no-open", "--log", str(log))
    assert ran.code == 0
    assert "3 frames are in" in ran.err.replace("\n", "")
    of_topic: dict[str, list[tuple[float, Any]]] = {}
    with log.open("rb") as file:
        for _, channel, message, decoded in make_reader(
            file, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            of_topic.setdefault(channel.topic, []).append((message.log_time / 1e9, decoded))
    assert [time_s for time_s, _ in of_topic["/tf"]] == pytest.approx([12.0, 12.02, 12.02])
    assert [one.pose.position.x for _, one in of_topic["/com"]] == pytest.approx([12.0, 12.02, 2.02])
    assert [len(one.arrows) for one in of_topic["/forces"][0][1].entities] == [1, 0]
    assert of_topic["/tf"][0][1].transforms[0].child_frame_id == "pelvis"
