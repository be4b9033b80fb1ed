"""Markers of QTM over its real-time protocol, and of a DataStream client, to a real service."""

import asyncio
import sys
from collections.abc import Iterator
from contextlib import aclosing
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stridelab.cli.bridges.command import bridge, forward_markers
from stridelab.cli.bridges.sources import open_source
from stridelab.cli.bridges.vicon import stream_of_client
from stridelab.errors import InvalidInput, Unavailable
from stridelab.recordings.reader import read_recording
from stridelab.schemas.streams import MarkerFrame, MarkerPerson
from support.command_line import SAMPLE
from support.service.database import TestDatabases
from support.service.qtm_server import QtmServer
from support.service.web_server import Served, served

PERSON = MarkerPerson(mass_kg=60.0, height_m=1.71, sex="female")
SUCCESS, NO_FRAME = "success", "no-frame"


@pytest.fixture(scope="module")
def service(postgres: TestDatabases, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with postgres.fresh() as url, served(url, tmp_path_factory.mktemp("data")) as running:
        yield running


@pytest.fixture(scope="module")
def walk_mm() -> dict[str, np.ndarray]:
    return {label: 1e3 * track[:60] for label, track in read_recording(SAMPLE / "recording.c3d").markers_m.items()}


async def received(source: str) -> tuple[Any, list[MarkerFrame]]:
    async with open_source(source) as live:
        return live, [frame async for frame in live.frames]


def test_frames_of_qtm_are_those_it_sends(walk_mm: dict[str, np.ndarray]) -> None:
    label = next(iter(walk_mm))
    hidden = walk_mm[label].copy()
    hidden[7] = np.nan
    server = QtmServer({**walk_mm, label: hidden}, 100.0, faster=20.0, up_axis="-Y")

    async def run() -> tuple[Any, list[MarkerFrame]]:
        async with server.listening() as port:
            return await received(f"qualisys://127.0.0.1:{port}")

    live, frames = asyncio.run(run())
    assert live.labels == list(walk_mm)
    assert (live.rate_hz, live.up_axis) == (100.0, "-y")
    assert [frame.t_s for frame in frames] == pytest.approx(np.arange(60) / 100.0)
    assert frames[7].markers[0] is None
    positions_mm = np.array([frame.markers[1:] for frame in frames], dtype=float)
    assert positions_mm == pytest.approx(np.stack(list(walk_mm.values()), axis=1)[:, 1:], abs=1e-3)


def test_a_walk_in_qtm_reaches_the_service(service: Served, walk_mm: dict[str, np.ndarray]) -> None:
    server = QtmServer(walk_mm, 100.0)

    async def run() -> tuple[int, int]:
        async with server.listening() as port:
            source = f"qualisys://127.0.0.1:{port}"
            return await forward_markers(source, PERSON, "Lane 1", None, service.base_url, None)

    count, without = asyncio.run(run())
    assert count == 60
    assert without < count, "some frames have a centre of mass"


def test_the_command_stops_after_the_requested_frames(
    service: Served, walk_mm: dict[str, np.ndarray], capsys: pytest.CaptureFixture[str]
) -> None:
    """The server runs in a thread of its own, as the command has its own event loop."""
    import threading

    server, ready, stop = QtmServer(walk_mm, 100.0), threading.Event(), threading.Event()
    ports: list[int] = []

    async def listen() -> None:
        async with server.listening() as port:
            ports.append(port)
            ready.set()
            await asyncio.to_thread(stop.wait)

    thread = threading.Thread(target=asyncio.run, args=(listen(),))
    thread.start()
    try:
        assert ready.wait(10.0)
        bridge(f"qualisys://127.0.0.1:{ports[0]}", mass=60.0, height=1.71, frames=20, server=service.base_url)
    finally:
        stop.set()
        thread.join()
    output = capsys.readouterr().out
    assert f"{len(walk_mm)} markers at 100 Hz" in output
    assert "20 frames" in output


@pytest.mark.parametrize("address", ["walk.c3d", "http://lab:8000", "qualisys://", "vicon://lab:port"])
def test_another_address_is_refused(address: str) -> None:
    with pytest.raises(InvalidInput) as caught:
        open_source(address)
    assert caught.value.code == "option-invalid"


def test_a_system_that_does_not_answer_is_named() -> None:
    with pytest.raises(Unavailable) as caught:
        asyncio.run(received("qualisys://127.0.0.1:1"))
    assert caught.value.code == "system-unreachable"


def test_a_project_without_markers_is_refused() -> None:
    async def run() -> None:
        async with QtmServer({}, 100.0).listening() as port:
            await received(f"qualisys://127.0.0.1:{port}")

    with pytest.raises(Unavailable) as caught:
        asyncio.run(run())
    assert caught.value.code == "system-unreachable"
    assert "no labelled markers" in caught.value.message


@pytest.mark.parametrize(("scheme", "package"), [("qualisys", "qtm-rt"), ("vicon", "pyvicon-datastream")])
def test_a_missing_package_is_named(scheme: str, package: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, package.replace("-", "_"), None)
    with pytest.raises(Unavailable) as caught:
        asyncio.run(received(f"{scheme}://127.0.0.1"))
    assert caught.value.code == "package-missing"
    assert package in caught.value.message


class FakeDataStream:
    """The calls of ``PyViconDatastream`` over a recorded walk; every second call finds no new frame."""

    def __init__(self, markers_mm: dict[str, np.ndarray], subjects: int = 1) -> None:
        self.markers_mm, self.subjects = markers_mm, subjects
        self.frame, self.n_requests, self.connected, self.enabled = -1, 0, False, False

    def connect(self, ip: str) -> str:
        self.connected = ip == "127.0.0.1:801"
        return SUCCESS if self.connected else "refused"

    def disconnect(self) -> None:
        self.connected = False

    def is_connected(self) -> bool:
        return self.connected

    def enable_marker_data(self) -> str:
        self.enabled = True
        return SUCCESS

    def get_frame(self) -> str:
        self.n_requests += 1
        if self.n_requests % 2:
            return NO_FRAME
        self.frame += 1
        if self.frame == len(next(iter(self.markers_mm.values()))):
            self.connected = False
            return NO_FRAME
        return SUCCESS

    def get_frame_number(self) -> int:
        return self.frame

    def get_frame_rate(self) -> float:
        return 100.0

    def get_subject_count(self) -> int:
        return self.subjects

    def get_subject_name(self, index: int) -> str:
        return f"subject {index}"

    def get_marker_count(self, name: str) -> int:
        return len(self.markers_mm) if self.enabled else 0

    def get_marker_name(self, name: str, index: int) -> str:
        return list(self.markers_mm)[index]

    def get_marker_global_translation(self, subject_name: str, marker_name: str) -> np.ndarray | None:
        position = self.markers_mm[marker_name][self.frame]
        return None if np.isnan(position).any() else position


def test_frames_of_vicon_are_those_it_sends(walk_mm: dict[str, np.ndarray], monkeypatch: pytest.MonkeyPatch) -> None:
    label = next(iter(walk_mm))
    hidden = walk_mm[label].copy()
    hidden[3], hidden[4] = np.nan, 0.0
    client = FakeDataStream({**walk_mm, label: hidden})
    module = ModuleType("pyvicon_datastream")
    module.PyViconDatastream = lambda: client  # type: ignore[attr-defined]
    module.Result = SimpleNamespace(Success=SUCCESS)  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "pyvicon_datastream", module)
    live, frames = asyncio.run(received("vicon://127.0.0.1"))
    assert live.labels == list(walk_mm)
    assert (live.rate_hz, live.up_axis) == (100.0, "+z")
    assert [frame.t_s for frame in frames] == pytest.approx(np.arange(60) / 100.0)
    assert frames[3].markers[0] is None
    assert frames[4].markers[0] is None
    assert np.array(frames[10].markers, dtype=float) == pytest.approx(np.array([t[10] for t in walk_mm.values()]))
    assert not client.connected


def test_a_datastream_without_subject_is_refused(walk_mm: dict[str, np.ndarray]) -> None:
    async def run() -> None:
        async with stream_of_client(FakeDataStream(walk_mm, subjects=0), SUCCESS, "127.0.0.1:801"):
            pass

    with pytest.raises(Unavailable) as caught:
        asyncio.run(run())
    assert caught.value.code == "system-unreachable"


def test_frames_that_the_service_refuses_end_the_bridge(service: Served) -> None:
    from stridelab.client import AsyncClient, ProblemError
    from stridelab.schemas.streams import MarkerStreamConfiguration

    labels = list(read_recording(SAMPLE / "recording.c3d").markers_m)

    async def run() -> None:
        async def frames():  # type: ignore[no-untyped-def]
            yield MarkerFrame(t_s=0.0, markers=[(0.0, 0.0, 1.0)])
            await asyncio.sleep(30.0)

        header = MarkerStreamConfiguration(labels=labels, rate_hz=100.0, person=PERSON)
        async with (
            AsyncClient(service.base_url) as lab,
            lab.stream_markers(header) as opened,
            aclosing(opened.follow(frames())) as estimates,
        ):
            async for _ in estimates:
                pass

    with pytest.raises(ProblemError) as caught:
        asyncio.run(run())
    assert caught.value.problem.code == "invalid-frame"
