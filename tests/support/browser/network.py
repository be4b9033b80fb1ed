"""The network between a browser and a service, which a test interrupts: connections refused, or silent."""

import asyncio
import contextlib
import threading
from collections.abc import Coroutine, Iterator
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
    writers: set[asyncio.StreamWriter] = field(default_factory=set)

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
            self.server.close()
            self.server = None
        for writer in list(self.writers):
            writer.transport.abort()

    async def _connect(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError, asyncio.CancelledError):
            await self.lets_through.wait()
            inside, outside = await asyncio.open_connection("127.0.0.1", self.port)
            self.writers |= {writer, outside}
            await asyncio.gather(self._carry(reader, outside), self._carry(inside, writer), return_exceptions=True)
            self.writers -= {writer, outside}
        writer.close()

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
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()
    network = Network(port, loop)
    network.restore()
    try:
        yield network
    finally:
        network.cut()
        asyncio.run_coroutine_threadsafe(_end_tasks(), loop).result(10)
        loop.call_soon_threadsafe(loop.stop)
        thread.join(10)
        loop.close()


async def _end_tasks() -> None:
    others = asyncio.all_tasks() - {asyncio.current_task()}
    for task in others:
        task.cancel()
    await asyncio.gather(*others, return_exceptions=True)
