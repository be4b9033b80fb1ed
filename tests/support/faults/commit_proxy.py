"""A relay to PostgreSQL that understands enough of its protocol to break the connection at a chosen COMMIT.

Messages are described in chapter "Frontend/Backend Protocol" of PostgreSQL's manual. A commit point is what makes a
transaction that wrote something final: an explicit COMMIT, or the end of a statement outside of a transaction.
"""

import contextlib
import re
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Final, Literal

Fault = Literal["lost request", "lost answer", "late request", "late answer", "cut after"]
FAULTS: Final[tuple[Fault, ...]] = ("lost request", "lost answer", "late request", "late answer", "cut after")
"""Of a COMMIT or of its answer. ``cut after``: the answer is lost, and no connection can be made for a while."""
_REFUSED_REQUESTS: Final = (80877103, 80877104)
"""SSLRequest and GSSENCRequest."""
_WRITES: Final = re.compile(r"\b(INSERT|UPDATE|DELETE)\b", re.IGNORECASE)
_NEVER_COUNTED: Final = "last_heartbeat"
"""Heartbeats come by the clock."""


@dataclass(frozen=True)
class Plan:
    """Do ``fault`` at the first commit point whose transaction ``wanted`` accepts; lateness lasts ``delay_s``.

    ``at_fault`` is called while the client waits for its answer: after the server has committed, or before it was
    asked to, as the fault has it.
    """

    wanted: Callable[[str], bool]
    fault: Fault
    delay_s: float = 6.0
    at_fault: Callable[[], None] = lambda: None


class CommitProxy:
    """Listens on a TCP port of the loopback address and forwards to a server's Unix socket."""

    def __init__(self, target: str, plan: Plan | None = None) -> None:
        self._target, self._plan = target, plan
        self._lock = threading.Lock()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._sockets: list[socket.socket] = [self._listener]
        self._dark_until = 0.0
        self.commits: list[str] = []
        """The statements of every transaction that reached a commit point, in order."""
        self.struck = threading.Event()
        """Set once the fault has begun."""
        self.over = threading.Event()
        """Set once its lateness has ended or its connection is closed."""
        threading.Thread(target=self._accept, daemon=True).start()

    @property
    def port(self) -> int:
        return int(self._listener.getsockname()[1])

    def close(self) -> None:
        """End every connection."""
        for each in self._sockets:
            _shut(each)

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                near = self._listener.accept()[0]
                if time.monotonic() < self._dark_until:
                    _shut(near)
                    continue
                far = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
                self._sockets += [near, far]
                far.connect(self._target)
                connection = _Connection(near, far)
                threading.Thread(target=self._requests, args=(connection,), daemon=True).start()
                threading.Thread(target=connection.answers, daemon=True).start()

    def _requests(self, connection: "_Connection") -> None:
        try:
            if connection.greet():
                for message in _messages(connection.near):
                    text = connection.committed_by(message)
                    if text is None or not self._breaks(connection, message, text):
                        connection.far.sendall(message)
        except OSError:
            pass
        finally:
            connection.close()

    def _breaks(self, connection: "_Connection", message: bytes, text: str) -> bool:
        """Note a commit point; where the plan is for this one, carry it out and say so."""
        with self._lock:
            self.commits.append(text)
            if self._plan is None or self.struck.is_set() or not self._plan.wanted(text):
                return False
            self.struck.set()
        plan = self._plan
        try:
            if plan.fault.endswith(("answer", "after")):
                connection.held.clear()
                connection.answered.clear()
                connection.far.sendall(message)
                connection.answered.wait(30)
            if plan.fault == "cut after":
                self._dark_until = time.monotonic() + plan.delay_s
                for each in self._sockets[1:]:
                    _shut(each)
            plan.at_fault()
            if plan.fault.startswith(("late", "cut")):
                time.sleep(plan.delay_s)
            if plan.fault == "late request":
                connection.far.sendall(message)
            elif plan.fault == "late answer":
                connection.held.set()
            else:
                connection.close()
        finally:
            self.over.set()
        return True


@dataclass
class _Connection:
    """One client's connection, and what is known of its transaction."""

    near: socket.socket
    far: socket.socket
    status: str = "I"
    texts: list[str] = field(default_factory=list)
    prepared: dict[bytes, str] = field(default_factory=dict)
    answered: threading.Event = field(default_factory=threading.Event)
    held: threading.Event = field(default_factory=threading.Event)
    """Answers pass while it is set."""
    _portal: str = ""
    _executed: str = ""

    def __post_init__(self) -> None:
        self.held.set()

    def greet(self) -> bool:
        """Forward the start of a session, in plain text; False for a request to cancel, which is one message."""
        while True:
            head = _exactly(self.near, 8)
            size, code = struct.unpack("!II", head)
            if code in _REFUSED_REQUESTS:
                self.near.sendall(b"N")
                continue
            self.far.sendall(head + _exactly(self.near, size - 8))
            return code >> 16 == 3

    def committed_by(self, message: bytes) -> str | None:
        """The statements that ``message`` makes final if the server gets it; None where it is no commit point."""
        kind, body = message[:1], message[5:]
        if kind == b"P":
            name, statement, _ = body.split(b"\0", 2)
            self.prepared[name] = statement.decode()
        elif kind == b"B":
            self._portal = self.prepared.get(body.split(b"\0", 2)[1], "")
        elif kind == b"E":
            self._executed = self._portal
        elif kind in (b"Q", b"S"):
            text = body.rstrip(b"\0").decode() if kind == b"Q" else self._executed
            self._executed = ""
            if self.status == "I":
                self.texts = []
            self.texts.append(text)
            whole = "; ".join(self.texts)
            explicit = self.status == "T" and text.strip().upper().startswith("COMMIT")
            implicit = self.status == "I" and not text.startswith("BEGIN")
            if (explicit or implicit) and _WRITES.search(whole) and _NEVER_COUNTED not in whole:
                return whole
        return None

    def answers(self) -> None:
        """Forward what the server says, unless it is held back."""
        waiting = b""
        try:
            for message in _messages(self.far):
                waiting += message
                if message[:1] == b"Z":
                    self.status = chr(message[5])
                    self.answered.set()
                    self.held.wait()
                if self.held.is_set():
                    self.near.sendall(waiting)
                    waiting = b""
        except OSError:
            pass
        finally:
            self.close()

    def close(self) -> None:
        _shut(self.near)
        _shut(self.far)
        self.held.set()


def _messages(source: socket.socket) -> Iterator[bytes]:
    """Typed messages: a byte, the length of the rest, the rest."""
    while True:
        head = _exactly(source, 5)
        (size,) = struct.unpack("!I", head[1:])
        yield head + _exactly(source, size - 4)


def _exactly(source: socket.socket, size: int) -> bytes:
    got = bytearray()
    while len(got) < size:
        piece = source.recv(size - len(got))
        if not piece:
            raise ConnectionResetError
        got += piece
    return bytes(got)


def _shut(one: socket.socket) -> None:
    with contextlib.suppress(OSError):
        one.shutdown(socket.SHUT_RDWR)
    if one.type == socket.SOCK_STREAM:
        with contextlib.suppress(OSError):
            one.close()


@contextlib.contextmanager
def commit_proxy(target: str, plan: Plan | None = None) -> Iterator[CommitProxy]:
    """A proxy to the Unix socket ``target`` until the end of the block."""
    made = CommitProxy(target, plan)
    try:
        yield made
    finally:
        made.close()
