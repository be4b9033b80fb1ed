"""Bulk uploads, robots and terrains do not take the slots in which single files are parsed."""

import asyncio
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest

from stridelab.service.kinds.registry import PARSE_BATCH, READ_TERRAIN
from stridelab.service.stored_robots import READ_ROBOT
from support.robots.humanoid import Humanoid, archive
from support.service.terrain_files import stairs
from support.service.web_server import Served

Send = Callable[[httpx.Client, bytes, int], int]
ROBOT = archive({"robot.urdf": Humanoid(foot="sphere").urdf()})


def send_batch(http: httpx.Client, content: bytes, n: int) -> int:
    files = [("file", (f"batch-{n}.c3d", content + bytes([n]) * 512))]
    return http.post("/api/v1/recordings/batch", files=files).status_code


def send_robot(http: httpx.Client, _content: bytes, n: int) -> int:
    files = {"file": ("robot.zip", ROBOT)}
    return http.post("/api/v1/robots", files=files, data={"name": f"robot-{n}"}).status_code


def send_terrain(http: httpx.Client, _content: bytes, _n: int) -> int:
    return http.post("/api/v1/terrains", files={"file": ("stairs.stl", stairs())}).status_code


@pytest.mark.parametrize(
    ("target_held", "send", "status"),
    [(PARSE_BATCH, send_batch, 201), (READ_ROBOT, send_robot, 422), (READ_TERRAIN, send_terrain, 200)],
)
def test_a_single_upload_does_not_wait_for_long_ones(
    service: Served,
    http: httpx.Client,
    trial: Path,
    monkeypatch: pytest.MonkeyPatch,
    target_held: str,
    send: Send,
    status: int,
) -> None:
    """Two batches, robots or terrains are under way and stay so; a file is parsed all the same, and they end."""
    parse = service.parts.pool.run
    under_way, may_go_on = threading.Semaphore(0), threading.Event()

    async def run(target: str, *arguments: Any, **options: Any) -> Any:
        if target == target_held:
            under_way.release()
            while not may_go_on.is_set():
                await asyncio.sleep(0.02)
        return await parse(target, *arguments, **options)

    monkeypatch.setattr(service.parts.pool, "run", run)
    content, answers = trial.read_bytes(), []

    def send_long(n: int) -> None:
        with service.http(timeout=120.0) as client:
            answers.append(send(client, content, n))

    long_ones = [threading.Thread(target=send_long, args=(n,)) for n in (1, 2)]
    try:
        for one in long_ones:
            one.start()
        for _ in long_ones:
            assert under_way.acquire(timeout=30)
        began = time.monotonic()
        answer = http.post("/api/v1/recordings", files={"file": ("walk.c3d", content)}, timeout=20.0)
        assert answer.status_code == 201, answer.text
        assert time.monotonic() - began < 20.0
    finally:
        may_go_on.set()
        for one in long_ones:
            one.join(60)
    assert answers == [status, status]
