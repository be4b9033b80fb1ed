"""``make load``: 200 clients at a whole service while both cores solve; prints the table for docs/load.md.

Each client does something once per second: looks at a job (most often), lists jobs, follows one, submits one, or opens
a page. Times count from the moment a request was due, so that a slow answer is not hidden by the requests that it
delayed. The HTTP client is written for little processor time, which it takes from the service that it measures.
"""

import argparse
import asyncio
import json
import os
import random
import sys
import time
from collections import Counter, defaultdict
from collections.abc import AsyncIterator
from contextlib import AbstractContextManager, asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import psutil

from support.service.processes import SERVE, Service, running_service

RESTS_S = 3.0
"""A connection that has rested longer is not used again: the service may be about to close it."""


@dataclass(frozen=True)
class Answer:
    """Answer of the service."""

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


SHARES: Final = {"look": 0.68, "list": 0.05, "follow": 0.10, "submit": 0.05, "page": 0.12}
"""What a client does with its second."""
PAGES: Final = ("/", "/recordings", "/jobs", "/scenarios", "/subjects", "/robots")
PATHS: Final = {
    "look": "GET /jobs/{id}",
    "list": "GET /jobs",
    "follow": "GET /jobs/{id}/events, first event",
    "submit": "POST /jobs/{kind}",
    "page": "pages: home and lists",
}
FOLLOWED_S: Final = 5.0
MANY: Final = 100
"""Jobs that one user has submitted ahead of all others."""


@dataclass
class Tally:
    """Counts and latencies."""

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
                    places = {
                        "look": f"/api/v1/jobs/{own}",
                        "list": "/api/v1/jobs?limit=20",
                        "page": dice.choice(PAGES),
                    }
                    answer = await line.call("GET", places[what])
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
                    n_events = chunk.count(b"\ndata: ")
                    tally.events += n_events
                    if n_events and is_first:
                        tally.note("follow", Answer(status, {}, b""), time.perf_counter() - due_at)
                        is_first = False
        except TimeoutError:
            return  # followed long enough
        except (ConnectionError, asyncio.IncompleteReadError) as error:
            tally.failures[f"follow: {type(error).__name__}"] += 1

    async def _single(self, line: Connection, ends_at: float, tally: Tally) -> list[str]:
        """Submit one job at a time and wait until it starts; returns those that did."""
        job_ids = []
        while time.perf_counter() < ends_at:
            began = time.perf_counter()
            job_id = await self._submit(line, tally)
            if job_id is not None:
                while (await self._job(line, job_id))["state"] == "queued":
                    await asyncio.sleep(0.2)
                tally.waited_s.append(time.perf_counter() - began)
                job_ids.append(job_id)
            await asyncio.sleep(2.0)
        line.close()
        return job_ids

    async def _job(self, line: Connection, job_id: str | None) -> Any:
        return (await line.call("GET", f"/api/v1/jobs/{job_id}")).json()


WARM_UP_S: Final = 20.0
"""Time of the same load that is not counted: the second web server starts when the first one is busy."""
ADMIN: Final = "the-admin-of-the-load"
TASK: Final = ("estimate-com", {"recording_id": "sample-walk"})
LIMITS: Final = {"STRIDELAB_QUEUE_LIMIT": "1000", "STRIDELAB_USER_QUEUE_LIMIT": "100"}
"""Room for more than all users together may have waiting."""
PRODUCTION: Final = {"STRIDELAB_HEARTBEAT_S": "5", "STRIDELAB_STALL_S": "20", "STRIDELAB_WORKER_SLOTS": "2"}
NICENESS: Final = 5
"""The clients yield to the service, not to its computations, which are nicer (10): they stand for other machines."""


def users(port: int, number: int) -> tuple[str, ...]:
    """Tokens of a user with many jobs, of one with a single job, and of ``number`` others."""

    async def make() -> tuple[str, ...]:
        line = Connection(port, ADMIN)
        names = ["many", "single", *(f"user-{count}" for count in range(number))]
        answers = [await line.call("POST", "/api/v1/tokens", {"name": name, "scope": "submit"}) for name in names]
        line.close()
        return tuple(answer.json()["secret"] for answer in answers)

    return asyncio.run(make())


def real_service(**settings: str) -> AbstractContextManager[Service]:
    """The service as ``make serve`` starts it, with a folder of its own."""
    return running_service(*SERVE, **{**PRODUCTION, **LIMITS, "STRIDELAB_API_TOKEN": ADMIN, **settings})


def _own_s(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)


def _in_the_server(folder: Path, route: str) -> list[float]:
    """Milliseconds that the web server itself took for answers of ``route``, from its log, in order of size."""
    lags = []
    for line in (folder / "logs" / "api.log").read_text(encoding="utf-8").splitlines():
        if f'"{route}"' in line and line.startswith("{"):
            line_fields: dict[str, Any] = json.loads(line)
            if (
                line_fields.get("event") == "request"
                and line_fields["route"] == route
                and line_fields["method"] == "GET"
            ):
                lags.append(float(line_fields["took_ms"]))
    return sorted(lags)


def report(tally: Tally, clients: int, seconds: float, web_s: float, pages_s: float, inside_ms: list[float]) -> str:
    """Report of the load test."""
    late_ms = sorted(1e3 * late for late in tally.late_s)
    refusals = ", ".join(f"{n} {code}" for code, n in sorted(tally.refusals.items())) or "none"
    around = (
        f"{clients} clients, {seconds:.0f} s, load {os.getloadavg()[0]:.1f} at the end; {tally.events} events; "
        f"refused: {refusals}; 5xx or no answer: {tally.worse} {dict(tally.failures) or ''}"
    )
    inside = (
        f"In the web server `GET /jobs/{{id}}` took {share_of(inside_ms, 0.5):.1f} ms (p50), "
        f"{share_of(inside_ms, 0.99):.1f} ms (p99); it was busy for {100 * web_s / seconds:.0f} % of one core, "
        f"the server of pages for {100 * pages_s / seconds:.0f} %. "
        f"Requests went out {share_of(late_ms, 0.99):.0f} ms late (p99)."
    )
    turns = (
        f"{len(tally.waited_s)} single jobs waited {max(tally.waited_s, default=0.0):.1f} s at most, "
        f"for {max(tally.overtaken, default=0)} of the {MANY} jobs of another user at most."
    )
    return "\n".join((tally.table(), "", around, inside, turns))


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(prog="make load", description=__doc__)
    parser.add_argument("--clients", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--users", type=int, default=8, help="users that the clients share")
    arguments = parser.parse_args()
    with real_service() as service:
        os.nice(NICENESS)
        tokens = users(service.port, arguments.users)
        web = service.member("stridelab.service.api")
        time.sleep(10.0)  # what is got ready after the start
        warm_up = Load(service.port, tokens, TASK, arguments.clients, WARM_UP_S, many=1)
        asyncio.run(warm_up.run())
        pages = service.member("stridelab.service.page_server")
        before, pages_before = _own_s(web), _own_s(pages)
        load = Load(service.port, tokens, TASK, arguments.clients, arguments.seconds)
        tally = asyncio.run(load.run())
        web_s, pages_s = _own_s(web) - before, _own_s(pages) - pages_before
        inside_ms = _in_the_server(service.folder, "/jobs/{job_id}")
    sys.stdout.write(report(tally, arguments.clients, arguments.seconds, web_s, pages_s, inside_ms) + "\n")
    if tally.worse:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
