"""An HTTP client that costs little: what it takes from the processor is missing to the service that it measures."""

import asyncio
import json
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any

RESTS_S = 3.0
"""A connection that has rested longer is not used again: the service may be about to close it."""


@dataclass(frozen=True)
class Answer:
    """What came back."""

    status: int
    headers: dict[str, str]
    body: bytes

    def json(self) -> Any:
        return json.loads(self.body)


class Connection:
    """One connection to a loopback port, kept open; one request at a time."""

    def __init__(self, port: int, token: str | None = None) -> None:
        self._port = port
        self._login = "" if token is None else f"Authorization: Bearer {token}\r\n"
        self._pair: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None
        self._used_at = 0.0

    async def call(self, method: str, path: str, body: object = None) -> Answer:
        """Ask, and wait for the whole answer."""
        if time.monotonic() - self._used_at > RESTS_S:
            self.close()
        try:
            head, reader = await self._ask(method, path, body)
            status, headers = _read_head(head)
            content = await reader.readexactly(int(headers.get("content-length", "0")))
        except BaseException:
            self.close()
            raise
        self._used_at = time.monotonic()
        return Answer(status, headers, content)

    @asynccontextmanager
    async def stream(self, path: str) -> AsyncIterator[tuple[int, AsyncIterator[bytes]]]:
        """Status and lines of an answer without an end; the connection is closed afterwards."""
        self.close()
        head, reader = await self._ask("GET", path, None)
        status, _ = _read_head(head)
        try:
            yield status, _chunks(reader)
        finally:
            self.close()

    def close(self) -> None:
        if self._pair is not None:
            self._pair[1].close()
            self._pair = None

    async def _ask(self, method: str, path: str, body: object) -> tuple[bytes, asyncio.StreamReader]:
        if self._pair is None:
            self._pair = await asyncio.open_connection("127.0.0.1", self._port)
        reader, writer = self._pair
        content = b"" if body is None else json.dumps(body).encode()
        kind = "Content-Type: application/json\r\n" if content else ""
        head = f"{method} {path} HTTP/1.1\r\nHost: 127.0.0.1:{self._port}\r\n{self._login}{kind}"
        writer.write(f"{head}Content-Length: {len(content)}\r\n\r\n".encode() + content)
        return await reader.readuntil(b"\r\n\r\n"), reader


def _read_head(head: bytes) -> tuple[int, dict[str, str]]:
    first, *lines = head.decode("latin-1").rstrip().split("\r\n")
    pairs = (line.partition(":") for line in lines)
    return int(first.split()[1]), {name.lower(): value.strip() for name, _, value in pairs}


async def _chunks(reader: asyncio.StreamReader) -> AsyncIterator[bytes]:
    while size := int(await reader.readline(), 16):
        chunk = await reader.readexactly(size + 2)
        yield chunk[:-2]
