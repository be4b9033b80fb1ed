"""An HTTP client that costs little: what it takes from the processor is missing to the service that it measures.

Many clients at a service: who asks for what, how long the answers take, and whose jobs wait.

Each client does something once per second: looks at a job (most often), lists jobs, follows one, or submits one. Times
count from the moment a request was due, so that a slow answer is not hidden by the requests that it held up.
"""

import asyncio
import json
import random
import time
from collections import Counter, defaultdict
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any, Final

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


SHARES: Final = {"look": 0.80, "list": 0.05, "follow": 0.10, "submit": 0.05}
"""What a client does with its second."""
PATHS: Final = {
    "look": "GET /jobs/{id}",
    "list": "GET /jobs",
    "follow": "GET /jobs/{id}/events, first event",
    "submit": "POST /jobs/{kind}",
}
FOLLOWED_S: Final = 5.0
MANY: Final = 100
"""Jobs that one user has submitted ahead of all others."""


@dataclass
class Tally:
    """What was seen."""

    took_s: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    statuses: Counter[tuple[str, int]] = field(default_factory=Counter)
    refusals: Counter[str] = field(default_factory=Counter)
    failures: Counter[str] = field(default_factory=Counter)
    accepted: list[str] = field(default_factory=list)
    events: int = 0
    late_s: list[float] = field(default_factory=list)
    """How late requests went out: the clients' own want of processor."""
    overtaken: list[int] = field(default_factory=list)
    """How many jobs of the one with many were started while somebody's single job waited."""
    waited_s: list[float] = field(default_factory=list)

    def note(self, what: str, answer: Answer, took_s: float) -> None:
        self.took_s[what].append(took_s)
        self.statuses[what, answer.status] += 1
        if answer.status == 429:
            self.refusals[answer.json()["code"]] += 1

    @property
    def worse(self) -> int:
        """Answers with 5xx, and requests that got none."""
        return self.failures.total() + sum(n for (_, status), n in self.statuses.items() if status >= 500)

    def table(self) -> str:
        """Markdown: times in ms per kind of request."""
        lines = ["| request | answers | p50 | p90 | p99 | longest | 429 | 5xx |", "| --- " * 8 + "|"]
        for what, path in PATHS.items():
            took = sorted(self.took_s[what])
            if took:
                at = [f"{1e3 * share_of(took, share):.0f}" for share in (0.5, 0.9, 0.99, 1.0)]
                bad = sum(n for (kind, status), n in self.statuses.items() if kind == what and status >= 500)
                cells = [f"`{path}`", str(len(took)), *at, str(self.statuses[what, 429]), str(bad)]
                lines.append(f"| {' | '.join(cells)} |")
        return "\n".join(lines)


def share_of(ordered: list[float], share: float) -> float:
    """The value that ``share`` of the ordered values do not exceed."""
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


@dataclass(frozen=True)
class Load:
    """``clients`` at the service on ``port`` for ``seconds``; ``task`` is (kind, body) of what they submit.

    Users log in by ``tokens``: the first submits ``MANY`` jobs at once, the second a single one now and then, and all
    others are shared by the clients.
    """

    port: int
    tokens: tuple[str, ...]
    task: tuple[str, dict[str, Any]]
    clients: int
    seconds: float
    seed: int = 0
    many: int = MANY

    async def run(self) -> Tally:
        """Do it."""
        tally = Tally()
        first, single, *others = self.tokens
        line = Connection(self.port, first)
        answers = [await self._submit(line, tally) for _ in range(self.many)]
        many = [job_id for job_id in answers if job_id is not None]
        ends_at = time.perf_counter() + self.seconds
        tokens = [others[number % len(others)] for number in range(self.clients)]
        crowd = [self._client(number, token, ends_at, tally) for number, token in enumerate(tokens)]
        singles, *_ = await asyncio.gather(self._single(Connection(self.port, single), ends_at, tally), *crowd)
        begun = [(await self._job(line, job_id))["started_at"] for job_id in many]
        for job_id in singles:
            job = await self._job(line, job_id)
            tally.overtaken.append(sum(at is not None and job["created_at"] < at < job["started_at"] for at in begun))
        line.close()
        return tally

    async def _client(self, number: int, token: str, ends_at: float, tally: Tally) -> None:
        dice = random.Random(f"{self.seed} {number}")
        line, side = Connection(self.port, token), Connection(self.port, token)
        following: asyncio.Task[None] | None = None
        due_at = time.perf_counter() + dice.random()
        own = dice.choice(tally.accepted)
        while due_at < ends_at:
            await asyncio.sleep(max(0.0, due_at - time.perf_counter()))
            tally.late_s.append(time.perf_counter() - due_at)
            what = dice.choices(list(SHARES), list(SHARES.values()))[0]
            try:
                if what == "follow":
                    if following is None or following.done():
                        following = asyncio.create_task(self._follow(side, own, due_at, tally))
                elif what == "submit":
                    own = await self._submit(line, tally, due_at) or own
                else:
                    place = f"/api/v1/jobs/{own}" if what == "look" else "/api/v1/jobs?limit=20"
                    answer = await line.call("GET", place)
                    tally.note(what, answer, time.perf_counter() - due_at)
            except (ConnectionError, asyncio.IncompleteReadError) as error:
                tally.failures[f"{what}: {type(error).__name__}"] += 1
            due_at = max(due_at + 1.0, time.perf_counter())
        if following is not None:
            await following
        line.close()

    async def _submit(self, line: Connection, tally: Tally, due_at: float | None = None) -> str | None:
        kind, body = self.task
        began = time.perf_counter() if due_at is None else due_at
        answer = await line.call("POST", f"/api/v1/jobs/{kind}", body)
        if due_at is not None:
            tally.note("submit", answer, time.perf_counter() - began)
        if answer.status != 202:
            return None
        tally.accepted.append(str(answer.json()["id"]))
        return tally.accepted[-1]

    async def _follow(self, line: Connection, job_id: str, due_at: float, tally: Tally) -> None:
        """Read events for some seconds, or to the end; what counts is the time to the first."""
        try:
            async with asyncio.timeout(FOLLOWED_S), line.stream(f"/api/v1/jobs/{job_id}/events") as (status, chunks):
                is_first = True
                async for chunk in chunks:
                    told = chunk.count(b"\ndata: ")
                    tally.events += told
                    if told and is_first:
                        tally.note("follow", Answer(status, {}, b""), time.perf_counter() - due_at)
                        is_first = False
        except TimeoutError:
            return  # followed long enough
        except (ConnectionError, asyncio.IncompleteReadError) as error:
            tally.failures[f"follow: {type(error).__name__}"] += 1

    async def _single(self, line: Connection, ends_at: float, tally: Tally) -> list[str]:
        """Submit one job at a time and wait until it starts; returns those that did."""
        made = []
        while time.perf_counter() < ends_at:
            began = time.perf_counter()
            job_id = await self._submit(line, tally)
            if job_id is not None:
                while (await self._job(line, job_id))["state"] == "queued":
                    await asyncio.sleep(0.2)
                tally.waited_s.append(time.perf_counter() - began)
                made.append(job_id)
            await asyncio.sleep(2.0)
        line.close()
        return made

    async def _job(self, line: Connection, job_id: str | None) -> Any:
        return (await line.call("GET", f"/api/v1/jobs/{job_id}")).json()
