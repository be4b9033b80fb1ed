"""``make load``: 200 clients at a whole service while both cores solve; prints the table for docs/load.md."""

import argparse
import asyncio
import json
import os
import sys
import time
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Final

import psutil

from support.load.clients import MANY, Connection, Load, Tally, share_of
from support.service.processes import SERVE, Service, running_service

ADMIN: Final = "the-admin-of-the-load"
TASK: Final = ("estimate-com", {"recording_id": "sample-walk"})
LIMITS: Final = {"STRIDELAB_QUEUE_LIMIT": "1000", "STRIDELAB_USER_QUEUE_LIMIT": "100"}
"""Room for more than all users together may have waiting."""
PRODUCTION: Final = {"STRIDELAB_HEARTBEAT_S": "5", "STRIDELAB_STALL_S": "20", "STRIDELAB_WORKER_SLOTS": "2"}
NICENESS: Final = 5
"""The clients yield to the service, not to its computations, which are nicer (10): they stand for other machines."""


def users(port: int, number: int) -> tuple[str, ...]:
    """Tokens of somebody with many jobs, somebody with a single one, and ``number`` others."""

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
    found = []
    for line in (folder / "logs" / "api.log").read_text(encoding="utf-8").splitlines():
        if f'"{route}"' in line and line.startswith("{"):
            told: dict[str, Any] = json.loads(line)
            if told.get("event") == "request" and told["route"] == route and told["method"] == "GET":
                found.append(float(told["took_ms"]))
    return sorted(found)


def report(tally: Tally, clients: int, seconds: float, web_s: float, inside_ms: list[float]) -> str:
    """What to write down."""
    late_ms = sorted(1e3 * late for late in tally.late_s)
    refusals = ", ".join(f"{n} {code}" for code, n in sorted(tally.refusals.items())) or "none"
    around = (
        f"{clients} clients, {seconds:.0f} s, load {os.getloadavg()[0]:.1f} at the end; {tally.events} events; "
        f"refused: {refusals}; 5xx or no answer: {tally.worse} {dict(tally.failures) or ''}"
    )
    inside = (
        f"In the web server `GET /jobs/{{id}}` took {share_of(inside_ms, 0.5):.1f} ms (p50), "
        f"{share_of(inside_ms, 0.99):.1f} ms (p99); it was busy for {100 * web_s / seconds:.0f} % of one core. "
        f"Requests went out {share_of(late_ms, 0.99):.0f} ms late (p99)."
    )
    turns = (
        f"{len(tally.waited_s)} single jobs waited {max(tally.waited_s, default=0.0):.1f} s at most, "
        f"for {max(tally.overtaken, default=0)} of the {MANY} jobs of another user at most."
    )
    return "\n".join((tally.table(), "", around, inside, turns))


def main() -> None:
    """Entry point."""
    asked = argparse.ArgumentParser(prog="make load", description=__doc__)
    asked.add_argument("--clients", type=int, default=200)
    asked.add_argument("--seconds", type=float, default=120.0)
    asked.add_argument("--users", type=int, default=8, help="users that the clients share")
    given = asked.parse_args()
    with real_service() as service:
        os.nice(NICENESS)
        tokens = users(service.port, given.users)
        web = service.member("stridelab.service.api")
        time.sleep(10.0)  # what is got ready after the start
        before = _own_s(web)
        load = Load(service.port, tokens, TASK, given.clients, given.seconds)
        tally = asyncio.run(load.run())
        web_s = _own_s(web) - before
        inside_ms = _in_the_server(service.folder, "/jobs/{job_id}")
    sys.stdout.write(report(tally, given.clients, given.seconds, web_s, inside_ms) + "\n")
    if tally.worse:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
