"""Limits on connections and on slow clients, for which uvicorn has no options.

A client must send the head and the body of a request within time limits. The number of open connections is limited in
total and per address. At a limit, a new connection replaces one whose client keeps the service waiting, so that
incomplete requests (Slowloris) cannot exhaust the connections.

Times are counted in ticks of an event loop timer. If the loop was blocked, data that arrived in time is read before the
next tick.
"""

import asyncio
import resource
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final, Literal

import h11
import structlog
from uvicorn.middleware.proxy_headers import _TrustedHosts
from uvicorn.protocols.http.h11_impl import H11Protocol

from stridelab.service.api import problems
from stridelab.service.settings import Settings

TICK_S: Final = 1.0
MAX_WRITE_PAUSE_S: Final = 60.0
"""Time after which a client that reads nothing of its response is disconnected."""
MIN_BODY_BYTES_HZ: Final = 250.0
"""Minimum average rate at which a body must arrive, in bytes per second."""
RESERVED_FILES: Final = 200
"""File descriptors reserved for the database, child processes, and files."""
BACKLOG: Final = 128
"""Number of connections that the event loop accepts per iteration."""
ROUNDS_TO_CLOSE: Final = 3
"""Iterations of the event loop until a replaced connection is closed: one creates the new transport, the next calls its
protocol, which aborts the replaced connection, and the third closes the file descriptor of that one."""
MAX_OPEN_FILES: Final = 65_536
_LOG_INTERVAL_S: Final = 60.0

State = Literal["idle", "head", "body", "answer"]
log = structlog.get_logger(__name__)


@dataclass
class ConnectionLimiter:
    """Open connections of one server and their limits; ``is_proxy`` tells which addresses are reverse proxies."""

    connections: int
    per_address: int
    head_s: float
    body_s: float
    is_proxy: Callable[[str], bool] = lambda _: False
    _open: "dict[GuardedProtocol, None]" = field(default_factory=dict)
    _by_address: Counter[str] = field(default_factory=Counter)
    _closed: Counter[str] = field(default_factory=Counter)
    _logged_at_s: float = float("-inf")
    _timer: asyncio.TimerHandle | None = None

    @staticmethod
    def from_settings(
        settings: Settings, open_files: int, trusted_proxies: str | list[str] | None
    ) -> "ConnectionLimiter":
        """Take the limits from ``settings``, reduced to what ``open_files`` permits; trusted addresses are proxies."""
        proxies = _TrustedHosts(trusted_proxies or "127.0.0.1")
        room = max(open_files - RESERVED_FILES - ROUNDS_TO_CLOSE * BACKLOG, 1)
        return ConnectionLimiter(
            connections=min(settings.connection_limit, room),
            per_address=settings.address_connection_limit,
            head_s=settings.header_timeout_s,
            body_s=settings.body_timeout_s,
            is_proxy=lambda host: host in proxies,
        )

    def register_connection(self, newcomer: "GuardedProtocol") -> None:
        """Register a new connection; at a limit, close a waiting connection or refuse the new one."""
        self._open[newcomer] = None
        self._by_address[newcomer.address] += 1
        if self._timer is None:
            self._timer = asyncio.get_running_loop().call_later(TICK_S, self._check_connections)
        is_crowd = not self.is_proxy(newcomer.address) and self._by_address[newcomer.address] > self.per_address
        if is_crowd or len(newcomer.connections) > self.connections:  # websockets among them
            address = newcomer.address if is_crowd else None
            loser = next(self._replaceable_connections(newcomer, address), newcomer)
            self._closed["crowded"] += 1
            if loser is newcomer:
                loser.refuse(503, "too-many-connections", "Too many connections are open. Try again shortly.")
            else:
                loser.transport.abort()
                loser.connections.discard(loser)
                self.remove_connection(loser)

    def remove_connection(self, connection: "GuardedProtocol") -> None:
        """Remove a closed connection."""
        if connection in self._open:
            del self._open[connection]
            self._by_address[connection.address] -= 1
            if not self._by_address[connection.address]:
                del self._by_address[connection.address]

    def _replaceable_connections(self, newcomer: "GuardedProtocol", address: str | None) -> "Iterator[GuardedProtocol]":
        """Connections that may be replaced: idle ones, oldest first, then slow bodies, then unread responses."""

        def other_connections() -> "Iterator[GuardedProtocol]":
            return (one for one in self._open if one is not newcomer and address in (None, one.address))

        yield from (one for one in other_connections() if one.state in ("idle", "head"))
        yield from (one for one in other_connections() if one.state == "body" and one.is_slow)
        yield from (one for one in other_connections() if one.state == "answer" and one.flow.write_paused)

    def _check_connections(self) -> None:
        self._timer = None
        for connection in list(self._open):
            self._check_timeouts(connection)
        if self._closed and time.monotonic() - self._logged_at_s > _LOG_INTERVAL_S:
            log.warning("connections closed", **{why: self._closed[why] for why in sorted(self._closed)})
            self._logged_at_s = time.monotonic()
            self._closed.clear()
        if self._open:
            self._timer = asyncio.get_running_loop().call_later(TICK_S, self._check_connections)

    def _check_timeouts(self, connection: "GuardedProtocol") -> None:
        state = connection.count_tick()
        waited_s = connection.ticks * TICK_S
        if state == "head" and waited_s > self.head_s:
            connection.refuse(
                408, "request-timeout", f"The head of the request did not arrive within {self.head_s:g} s."
            )
        elif state == "body" and (waited_s > self.body_s or connection.is_below_minimum_rate(self.body_s)):
            connection.refuse(408, "request-timeout", "The body of the request arrived too slowly.")
        elif state == "answer" and waited_s > MAX_WRITE_PAUSE_S:
            connection.transport.abort()
        else:
            return
        self._closed["late"] += 1


class GuardedProtocol(H11Protocol):
    """uvicorn's HTTP/1.1 protocol with connection limits, which a subclass per server holds."""

    limiter: ConnectionLimiter

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.address = ""
        self.ticks = 0
        """Number of ticks for which the service has been waiting for the client."""
        self._state: State = "head"
        self._has_sent = False
        self._body_bytes = 0
        self._body_ticks = 0

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Called by the transport."""
        super().connection_made(transport)
        self.address = self.client[0] if self.client else ""
        self.limiter.register_connection(self)

    def connection_lost(self, exc: Exception | None) -> None:
        """Called by the transport."""
        self.limiter.remove_connection(self)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Called by the transport."""
        if self.transport.is_closing():
            return
        self._has_sent = True
        if self.state == "body":
            self.ticks = 0
            self._body_bytes += len(data)
        super().data_received(data)

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        """Hand the connection over to the websocket protocol, to which these limits do not apply."""
        self.limiter.remove_connection(self)
        super().handle_websocket_upgrade(event)

    @property
    def state(self) -> State:
        """State of the connection, by what it waits for."""
        if self.flow.write_paused:  # also if uvicorn has already written the complete response
            return "answer"
        if self.conn.their_state is h11.IDLE:
            return "head" if self.timeout_keep_alive_task is None else "idle"
        return "body" if self.conn.their_state is h11.SEND_BODY else "answer"

    @property
    def is_slow(self) -> bool:
        """Whether the body has stalled or has just begun."""
        return self.ticks > 0 or self._body_bytes < MIN_BODY_BYTES_HZ

    def count_tick(self) -> State:
        """Count the time for which the service waits for the client; return the state of the connection."""
        state = self.state
        if state != self._state:
            self.ticks = self._body_ticks = self._body_bytes = 0
            self._state = state
        is_ours = state == "idle" or (state == "body" and self.flow.read_paused)
        if is_ours or (state == "answer" and not self.flow.write_paused):
            self.ticks = 0
        else:
            self.ticks += 1
            self._body_ticks += 1
        return state

    def is_below_minimum_rate(self, grace_s: float) -> bool:
        """Whether the body arrives below the minimum average rate, after ``grace_s``."""
        passed_s = self._body_ticks * TICK_S
        return passed_s > grace_s and self._body_bytes < MIN_BODY_BYTES_HZ * passed_s

    def refuse(self, status: int, code: str, detail: str) -> None:
        """Close the connection, after an error response if a request has begun and has no response yet."""
        may_answer = self.conn.our_state in (h11.IDLE, h11.SEND_RESPONSE)
        if self.cycle is not None and self.state != "head":
            may_answer = may_answer and not self.cycle.response_started
            self.cycle.disconnected = True
        if may_answer and (self._has_sent or status != 408):
            body = problems.make_problem(status, code, detail).model_dump_json(exclude_none=True).encode()
            head = (
                f"HTTP/1.1 {status} {problems.make_problem(status, code, detail).title}\r\n"
                f"Content-Type: {problems.MEDIA_TYPE}\r\nContent-Length: {len(body)}\r\nConnection: close\r\n\r\n"
            )
            self.transport.write(head.encode() + body)
        self.transport.close()


def guarded_protocol(limiter: ConnectionLimiter) -> type[GuardedProtocol]:
    """Create the protocol class of a server with these limits."""
    return type("GuardedProtocolOfServer", (GuardedProtocol,), {"limiter": limiter})


def raise_file_limit() -> int:
    """Raise the soft limit of open files as far as the system allows, at most to ``MAX_OPEN_FILES``; returns it."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MAX_OPEN_FILES if hard == resource.RLIM_INFINITY else min(hard, MAX_OPEN_FILES)
    if soft == resource.RLIM_INFINITY or soft >= wanted:
        return MAX_OPEN_FILES if soft == resource.RLIM_INFINITY else soft
    resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
    return wanted
