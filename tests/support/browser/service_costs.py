"""Costs of a service that answers browsers: traffic, processor time and memory.

What the processes of a running service that answer browsers cost: processor time and memory.

A door beside a service that counts what passes: bytes both ways, and the messages of websockets.

Headers, WebSocket framing and all: what is counted is what a network would carry above TCP.

A service with tokens and its viewer, as two programs that talk over the loopback.
"""

import asyncio
import contextlib
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import psutil

from support.browser.network import Connections, loop_in_thread, stop_listening
from support.service.database import TestDatabases
from support.service.web_server import Served, served

ANSWERING = {"viewer": "stridelab_web.viewer", "web": "stridelab.service.api"}
"""Modules of the processes that serve pages and scenes."""


@dataclass(frozen=True)
class Consumption:
    """The processes below ``stridelab serve`` that answer browsers."""

    processes: dict[str, psutil.Process]

    @staticmethod
    def of(pid: int | None) -> "Consumption":
        """The processes of the service with the process ``pid``."""
        processes: dict[str, psutil.Process] = {}
        for process in psutil.Process(pid).children(recursive=True):
            line = process.cmdline()
            for name, module in ANSWERING.items():
                if line[-2:] == ["-m", module] and "stridelab.service.processes.parent_death" not in line:
                    processes[name] = process
        assert set(processes) == set(ANSWERING), processes
        return Consumption(processes)

    def cpu_s(self) -> float:
        """Processor seconds of all of them so far."""
        return sum(sum(process.cpu_times()[:2]) for process in self.processes.values())

    def memory_mb(self) -> dict[str, float]:
        """Resident memory by process."""
        return {name: process.memory_info().rss / 1e6 for name, process in self.processes.items()}


PIECE = 65536
LOOK_AGAIN_S = 0.05
FINAL_AND_FIRST = (0x0, 0x1, 0x2)
"""Opcodes of WebSocket frames that carry data: continuation, text, bytes. Pings and closings are none of ours."""
LONG = {126: 2, 127: 8}
"""Where the short length says so, so many bytes of length follow."""


@dataclass
class Wire:
    """One connection: data frames of its websocket, ``messages_down`` by the service, ``messages_up`` by the page."""

    down_bytes: int = 0
    up_bytes: int = 0
    messages_down: int = 0
    messages_up: int = 0
    is_socket: bool = False


@dataclass
class Meter:
    """Traffic since the start; ``url`` is the address of the service behind the counting proxy.

    Of a connection that has sent ``up_at_most`` bytes nothing more is let through until the number is taken away.
    """

    url: str = ""
    wires: list[Wire] = field(default_factory=list)
    up_at_most: int | None = None

    @property
    def down_bytes(self) -> int:
        """Bytes by the service."""
        return sum(wire.down_bytes for wire in self.wires)

    @property
    def answer_bytes(self) -> int:
        """Bytes by the service outside websockets, whose keep-alive messages are not of interest."""
        return sum(wire.down_bytes for wire in self.wires if not wire.is_socket)

    @property
    def messages_down(self) -> int:
        """Messages by the service through websockets."""
        return sum(wire.messages_down for wire in self.wires)

    @property
    def messages_up(self) -> int:
        """Messages to the service through websockets."""
        return sum(wire.messages_up for wire in self.wires)


@contextlib.contextmanager
def metered(port: int) -> Iterator[Meter]:
    """A door to the service on the loopback ``port``, in a thread of its own."""
    meter, connections = Meter(), Connections()

    async def through(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        wire = Wire()
        meter.wires.append(wire)
        await connections.carry_both_ways(
            lambda: asyncio.open_connection("127.0.0.1", port),
            lambda source, sink: _carry(source, sink, wire, meter),
            lambda source, sink: _carry(source, sink, wire, None),
            reader,
            writer,
        )

    async def listen() -> asyncio.Server:
        return await asyncio.start_server(through, "127.0.0.1", 0)

    async def end_meter() -> None:
        await stop_listening(server)
        meter.up_at_most = None
        await connections.end_all()

    with loop_in_thread() as loop:
        server = asyncio.run_coroutine_threadsafe(listen(), loop).result(10)
        try:
            meter.url = f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}"
            yield meter
        finally:
            asyncio.run_coroutine_threadsafe(end_meter(), loop).result(10)


async def _carry(source: asyncio.StreamReader, sink: asyncio.StreamWriter, wire: Wire, up: Meter | None) -> None:
    """Towards the service, under the limit of ``up``, or with None from it."""
    frames = Frames()
    try:
        while piece := await source.read(PIECE):
            if up is not None:
                while up.up_at_most is not None and wire.up_bytes >= up.up_at_most and not source.at_eof():
                    await asyncio.sleep(LOOK_AGAIN_S)
                wire.up_bytes += len(piece)
                wire.is_socket = wire.is_socket or b"upgrade: websocket" in piece[:4096].lower()
            else:
                wire.down_bytes += len(piece)
            if wire.is_socket:
                n_frames = frames.count(piece)
                if up is not None:
                    wire.messages_up += n_frames
                else:
                    wire.messages_down += n_frames
            sink.write(piece)
            await sink.drain()
    finally:
        sink.close()


class Frames:
    """Counts the data frames of a websocket in one direction, after the heading that opened it."""

    def __init__(self) -> None:
        self._rest = b""
        self._skip = 0
        self._opened = False

    def count(self, piece: bytes) -> int:
        """Data frames that begin in ``piece``."""
        self._rest += piece
        if not self._opened:
            _, mark, rest = self._rest.partition(b"\r\n\r\n")
            if not mark:
                return 0
            self._opened, self._rest = True, rest
        n_frames = 0
        while True:
            passed = min(self._skip, len(self._rest))
            self._skip, self._rest = self._skip - passed, self._rest[passed:]
            if self._skip or len(self._rest) < 2:
                return n_frames
            first, second = self._rest[0], self._rest[1]
            long = LONG.get(second & 0x7F, 0)
            if len(self._rest) < 2 + long:
                return n_frames
            length = int.from_bytes(self._rest[2 : 2 + long]) if long else second & 0x7F
            self._skip = 2 + long + (4 if second & 0x80 else 0) + length
            n_frames += (first & 0x0F) in FINAL_AND_FIRST


ADMIN = "a-secret-of-the-lab"


@dataclass(frozen=True)
class Lab:
    """A service with its viewer; ``admin`` speaks with the token of the settings."""

    served: Served
    admin: httpx.Client

    def token(self, name: str, scope: str) -> dict[str, Any]:
        answer = self.admin.post("/api/v1/tokens", json={"name": name, "scope": scope})
        assert answer.status_code == 201, answer.text
        return dict(answer.json())

    def http(self, secret: str) -> httpx.Client:
        return self.served.http(headers={"Authorization": f"Bearer {secret}"})

    def wait_until_prepared(self, robot: str) -> None:
        """Until then the viewer's pages show how far the robot's files are."""
        while (preparation := self.admin.get(f"/api/v1/robots/{robot}/preparation").json())["state"] == "preparing":
            time.sleep(0.1)
        assert preparation["state"] == "ready", preparation

    def audited(self, scenario_id: str) -> list[tuple[str, str]]:
        items = self.admin.get("/api/v1/audit").json()["items"]
        return [(item["action"], item["caller"]) for item in items if item["what"] == scenario_id]


@contextmanager
def viewer_lab(postgres: TestDatabases, data: Path, **environment: str) -> Iterator[Lab]:
    """Such a service with an empty database; ``environment`` is the viewer's."""
    with socket.create_server(("127.0.0.1", 0)) as reserved:
        viewer_url = f"http://127.0.0.1:{reserved.getsockname()[1]}"
    with postgres.fresh() as url, served(url, data, api_token=ADMIN, viewer_url=viewer_url) as running:
        variables = {
            **os.environ,
            "STRIDELAB_API_TOKEN": ADMIN,
            "STRIDELAB_HOST": "127.0.0.1",
            "STRIDELAB_PORT": running.base_url.rpartition(":")[2],
            "STRIDELAB_VIEWER_URL": viewer_url,
            **environment,
        }
        viewer = subprocess.Popen([sys.executable, "-m", "stridelab_web.viewer"], env=variables)
        try:
            with running.http(headers={"Authorization": f"Bearer {ADMIN}"}, timeout=120) as admin:
                yield Lab(running, admin)
        finally:
            viewer.terminate()
            viewer.wait(20)
