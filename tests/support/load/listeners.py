"""Many listeners to the events of one running job: how long after the event's time each of them has it.

``PYTHONPATH=tests python -m support.load.listeners --listeners 500 --seconds 20`` starts a service, and one job that
reports progress five times per second. Prints the lag of all received events and the processor time of the web server.
"""

import argparse
import asyncio
import json
import os
import time
from datetime import datetime

import psutil

from support.load.load import Connection
from support.service.processes import Service, running_service


async def listen(port: int, job_id: str, lags_s: list[float], connected: asyncio.Semaphore) -> int:
    """Follow the job to its end; returns the number of events."""
    events = 0
    async with connected:
        stream = Connection(port).stream(f"/api/v1/jobs/{job_id}/events")
        status, lines = await stream.__aenter__()
        assert status == 200
        connected_s = time.time()
    rest = b""
    try:
        async for chunk in lines:
            *messages, rest = (rest + chunk).split(b"\n\n")
            now_s = time.time()
            for message in messages:
                if b"\ndata: " in message:
                    event = json.loads(message.partition(b"\ndata: ")[2])
                    written_s = datetime.fromisoformat(event["at"]).timestamp()
                    if written_s > connected_s:  # others were written before
                        lags_s.append(now_s - written_s)
                    events += 1
    except (ValueError, asyncio.IncompleteReadError):
        pass  # the last chunk is empty
    await stream.__aexit__(None, None, None)
    return events


async def measure(service: Service, listeners: int, seconds: float) -> None:
    job_id = await asyncio.to_thread(service.jobs.submit, "work", work_s=seconds)
    await asyncio.to_thread(service.jobs.until_running, job_id)
    lags_s: list[float] = []
    connected = asyncio.Semaphore(50)
    api = service.member("support.service.web_server")
    before, began_s = api.cpu_times(), time.monotonic()
    counts = await asyncio.gather(*(listen(service.port, job_id, lags_s, connected) for _ in range(listeners)))
    took_s, after = time.monotonic() - began_s, api.cpu_times()
    busy = (after.user + after.system - before.user - before.system) / took_s
    stored = len(await asyncio.to_thread(service.jobs.states, job_id))
    late = sorted(lags_s)
    p50, p99 = (1e3 * late[int(share * (len(late) - 1))] for share in (0.5, 0.99))
    print(
        f"{listeners} listeners, {len(late)} events in {took_s:.1f} s, {stored} stored, load {os.getloadavg()[0]:.1f}"
    )
    print(f"events per listener: {min(counts)} to {max(counts)}")
    print(f"lag p50 {p50:.0f} ms, p99 {p99:.0f} ms, longest {1e3 * late[-1]:.0f} ms; web server {busy:.0%} of one core")


def main() -> None:
    """Start a service and measure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--listeners", type=int, default=500)
    parser.add_argument("--seconds", type=float, default=20.0)
    arguments = parser.parse_args()
    os.nice(5)
    limits = {"STRIDELAB_ADDRESS_CONNECTION_LIMIT": str(arguments.listeners + 100), "STRIDELAB_RATE_LIMIT_HZ": "0"}
    psutil.Process().rlimit(psutil.RLIMIT_NOFILE, (4096, psutil.Process().rlimit(psutil.RLIMIT_NOFILE)[1]))
    with running_service(**limits) as service:
        asyncio.run(measure(service, arguments.listeners, arguments.seconds))


if __name__ == "__main__":
    main()
