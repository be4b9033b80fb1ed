"""COMMITs whose answer is lost or late, and workers that are signalled meanwhile: every schedule has a number.

``scripts/chaos --schedule 17`` repeats one, ``--schedules 0:128`` runs many. In each, a worker does one job through a
proxy that breaks at one chosen transaction; another worker, which is not disturbed, takes over what is left. In the
end the job has ended once, every file that its row names is there, and the janitor finds nothing to take that is
needed (``support.service.processes``).

The proxy is a relay to PostgreSQL that understands enough of its protocol to break the connection at a chosen COMMIT.

Messages are described in chapter "Frontend/Backend Protocol" of PostgreSQL's manual. A commit point is what makes a
transaction that wrote something final: an explicit COMMIT, or the end of a statement outside of a transaction.
"""

import contextlib
import os
import re
import signal
import socket
import struct
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from queue import SimpleQueue
from subprocess import TimeoutExpired
from typing import Final, Literal

from stridelab.schemas.jobs import FINAL_STATES
from stridelab.service.postgres import embedded
from stridelab.service.storage.database import parse_url
from support.service.database import TestDatabases, databases, remove_orphans_now, run_with_engine, socket_of
from support.service.processes import Jobs, assert_sound, wait_until, worker

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
    """One client's connection and the state of its transaction."""

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
    proxy = CommitProxy(target, plan)
    try:
        yield proxy
    finally:
        proxy.close()


Signal = Literal["no signal", "SIGTERM", "SIGSTOP", "SIGKILL"]
SIGNALS: Final[tuple[Signal, ...]] = ("no signal", "SIGTERM", "SIGSTOP", "SIGKILL")
TRANSACTIONS: Final[dict[str, str]] = {
    "claim": r"UPDATE job SET state = 'running', attempt = attempt",
    "publish": r"UPDATE job SET .*finished_at = now\(\).*job\.attempt = ",
}
"""What a worker commits while it does a job, in this order, and how the statements are recognised."""
HAND_BACK: Final = r"UPDATE job SET .*returned = job\.returned \+"
STALL_S: Final = 3.0
DELAY_S: Final = 6.0
"""Longer than a stopping worker waits for its jobs, and than the stall time of a silent one."""


@dataclass(frozen=True)
class Schedule:
    """One job, one transaction, the fault of its COMMIT, and the signal to the worker at that moment."""

    kind: str
    transaction: str
    fault: Fault
    signal: Signal

    def __str__(self) -> str:
        return f"{self.kind}: {self.fault} of the COMMIT of '{self.transaction}', {self.signal}"


SCHEDULES: Final[tuple[Schedule, ...]] = (
    *(Schedule(*each) for each in product(("work", "stop-half-way"), TRANSACTIONS, FAULTS, SIGNALS)),
    *(Schedule("long-work", "hand back", *each) for each in product(FAULTS, ("no signal", "SIGKILL"))),
)
"""A schedule's number is its place here; new ones go to the end."""


def run(schedule: Schedule, url: str, folder: Path) -> str:
    """Do it on an empty database; returns how the job ended. Raises ``AssertionError`` naming all that is wrong."""
    jobs, blobs = Jobs(url), {"STRIDELAB_BLOB_URL": (folder / "blobs").as_uri(), "STRIDELAB_STALL_S": str(STALL_S)}
    hands_back = schedule.transaction == "hand back"
    job_id = jobs.submit(schedule.kind, **({"work_s": 3.0} if hands_back else {}))
    pattern = re.compile(TRANSACTIONS.get(schedule.transaction, HAND_BACK), re.DOTALL)
    pid = 0

    def send() -> None:
        if schedule.signal != "no signal":
            os.kill(pid, getattr(signal, schedule.signal))

    plan = Plan(lambda text: pattern.search(text) is not None, schedule.fault, DELAY_S, send)
    with contextlib.ExitStack() as stack:
        proxy = stack.enter_context(commit_proxy(socket_of(url), plan))
        first = stack.enter_context(worker(through_proxy(url, proxy), folder / "a", **blobs))
        pid = first.pid
        if hands_back:
            jobs.until(job_id, lambda record: record.state == "running" and record.message.startswith("step"))
            first.send_signal(signal.SIGTERM)
        wait_until(proxy.struck.is_set, 60, f"a COMMIT of '{schedule.transaction}'")
        stack.enter_context(worker(url, folder / "b", **blobs))
        wait_until(proxy.over.is_set, 60, "the end of the fault")
        if schedule.signal == "SIGSTOP":
            time.sleep(2 * STALL_S if schedule.fault.startswith("lost") else 0.0)
            os.kill(pid, signal.SIGCONT)
        record = jobs.until_final(job_id, 90)
        time.sleep(1.0)  # what the first worker has to say, it says now
        if schedule.signal in ("SIGTERM", "SIGKILL") or hands_back:
            try:
                first.wait(30)
            except TimeoutExpired as error:
                raise AssertionError("the worker did not stop within 30 s") from error
        expected = "failed" if schedule.kind == "stop-half-way" else "succeeded"
        assert record.state == expected, f"{record.state}: {record.error}"
        if record.error is not None:
            assert record.error["code"] == "stopped", record.error
        assert record.state in FINAL_STATES
        assert_sound(url, folder / "blobs", [job_id])
        removed = run_with_engine(url, lambda engine: remove_orphans_now(engine, folder / "blobs"))
        assert_sound(url, folder / "blobs", [job_id])
        result_files = list((folder / "blobs" / "results").rglob("*.csv"))
        assert len(result_files) == 1, f"{len(result_files)} files after the janitor"
        starts = jobs.get(job_id).attempt
    return f"{record.state} after {starts} starts, {len(removed)} prefixes left to the janitor"


def through_proxy(url: str, proxy: CommitProxy) -> str:
    """URL of the same database by way of ``proxy``."""
    address = parse_url(url)
    return f"postgresql://{address.username}@127.0.0.1:{proxy.port}/{address.database}?sslmode=disable"


def run_numbered(number: int, url: str, folder: Path) -> str:
    """``run`` of the schedule ``number``."""
    return f"({SCHEDULES[number]}): {run(SCHEDULES[number], url, folder)}"


def run_all(
    numbers: Iterable[int],
    server: TestDatabases,
    folder: Path,
    *,
    at_once: int = 4,
    say: Callable[[str], None] = print,
    run_one: Callable[[int, str, Path], str] = run_numbered,
) -> list[int]:
    """Run schedules, some at the same time; returns the numbers of those that failed."""
    failed: list[int] = []
    free: SimpleQueue[str] = SimpleQueue()

    def one(number: int) -> None:
        began, url = time.monotonic(), free.get()
        try:
            report = run_one(number, url, folder / str(number))
        except Exception as error:
            report = f"FAILED: {error or ''.join(traceback.format_exception(error))}"
            failed.append(number)
        server.empty(url)
        free.put(url)
        say(f"schedule {number} {report} [{time.monotonic() - began:.0f} s]")

    with ExitStack() as made, ThreadPoolExecutor(at_once) as threads:
        for _ in range(at_once):
            free.put(made.enter_context(server.fresh()))
        list(threads.map(one, numbers))
    return sorted(failed)


def main(
    numbers: list[int],
    folder: Path,
    at_once: int,
    option: str = "--schedule",
    run_one: Callable[[int, str, Path], str] = run_numbered,
) -> int:
    """Run schedules from the command line; returns an exit status."""
    embedded._OPTIONS["max_connections"] = str(20 * at_once + 20)
    with databases() as server:
        failed = run_all(
            numbers, server, folder, at_once=at_once, say=lambda line: print(line, flush=True), run_one=run_one
        )
    again = " ".join(f"scripts/chaos {option} {number};" for number in failed)
    print(f"{len(numbers)} schedules, {len(failed)} failed. {again}")
    return 1 if failed else 0
