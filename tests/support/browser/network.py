"""The network between a browser and a service, which a test interrupts: connections refused, or silent."""

import asyncio
import contextlib
import threading
from collections.abc import Callable, Coroutine, Iterator
from dataclasses import dataclass, field
from typing import Any

PIECE = 65536


@dataclass
class Network:
    """A door to a service on the loopback; ``url`` is the address of the service behind it."""

    port: int
    loop: asyncio.AbstractEventLoop
    outside_port: int = 0
    server: asyncio.Server | None = None
    lets_through: asyncio.Event = field(default_factory=asyncio.Event)
    connections: "Connections" = field(default_factory=lambda: Connections())

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.outside_port}"

    def cut(self) -> None:
        """End all connections and refuse new ones, as where the service has stopped."""
        self._run(self._cut())

    def silence(self) -> None:
        """Carry nothing, neither bytes nor the end of a connection, as where a radio link is lost."""
        self.loop.call_soon_threadsafe(self.lets_through.clear)

    def restore(self) -> None:
        """Carry again what the connections that remain have sent, and accept new ones."""
        self._run(self._listen())

    def _run(self, work: Coroutine[Any, Any, None]) -> None:
        asyncio.run_coroutine_threadsafe(work, self.loop).result(10)

    async def _listen(self) -> None:
        self.lets_through.set()
        if self.server is None:
            self.server = await asyncio.start_server(self._connect, "127.0.0.1", self.outside_port)
            self.outside_port = self.server.sockets[0].getsockname()[1]

    async def _cut(self) -> None:
        self.lets_through.set()
        if self.server is not None:
            server, self.server = self.server, None
            await stop_listening(server)
        self.connections.abort_all()

    async def _connect(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await self.connections.carry_both_ways(self._open_inside, self._carry, self._carry, reader, writer)

    async def _open_inside(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        await self.lets_through.wait()
        return await asyncio.open_connection("127.0.0.1", self.port)

    async def _carry(self, source: asyncio.StreamReader, sink: asyncio.StreamWriter) -> None:
        try:
            while piece := await source.read(PIECE):
                await self.lets_through.wait()
                sink.write(piece)
                await sink.drain()
        finally:
            await self.lets_through.wait()
            sink.close()


@contextlib.contextmanager
def network_to(port: int) -> Iterator[Network]:
    """A network to the service on the loopback ``port``, in a thread of its own."""
    with loop_in_thread() as loop:
        network = Network(port, loop)
        network.restore()
        try:
            yield network
        finally:
            network.cut()
            asyncio.run_coroutine_threadsafe(network.connections.end_all(), loop).result(10)


@contextlib.contextmanager
def loop_in_thread() -> Iterator[asyncio.AbstractEventLoop]:
    """An event loop that runs in a thread of its own."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()
    try:
        yield loop
    finally:
        loop.call_soon_threadsafe(loop.stop)
        thread.join(10)
        loop.close()


Carry = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Coroutine[Any, Any, None]]
"""Copies what one side sends to the other side, and closes that one."""
Open = Callable[[], Coroutine[Any, Any, tuple[asyncio.StreamReader, asyncio.StreamWriter]]]


class Connections:
    """What a proxy has open. None is left open at the end: garbage with an open socket fails a later test."""

    def __init__(self) -> None:
        self._writers: set[asyncio.StreamWriter] = set()

    async def carry_both_ways(
        self, connect: Open, up: Carry, down: Carry, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        """Carry an accepted connection both ways until both sides are closed."""
        mine = {writer}
        self._writers.add(writer)
        try:
            with contextlib.suppress(OSError):
                inside, outside = await connect()
                mine.add(outside)
                self._writers.add(outside)
                await asyncio.gather(up(reader, outside), down(inside, writer), return_exceptions=True)
        finally:
            for one in mine:
                one.close()
            for one in mine:  # what it has not sent yet is sent before it is closed
                with contextlib.suppress(OSError):
                    await one.wait_closed()
            self._writers -= mine

    def abort_all(self) -> None:
        """Close every connection at once, whatever it has not sent yet."""
        for writer in list(self._writers):
            writer.transport.abort()

    async def end_all(self) -> None:
        """Abort until all tasks have ended by themselves: one that is cancelled before it begins closes nothing."""
        while others := asyncio.all_tasks() - {asyncio.current_task()}:
            self.abort_all()
            await asyncio.wait(others, timeout=0.02)


async def stop_listening(server: asyncio.Server) -> None:
    """Close ``server`` once what it has accepted is a connection; in Python 3.11 the other ones are never closed."""
    loop = asyncio.get_running_loop()
    for listening in server.sockets:
        loop.remove_reader(listening.fileno())
    await asyncio.sleep(0)
    server.close()
