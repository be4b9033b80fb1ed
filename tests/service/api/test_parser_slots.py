"""Bulk uploads do not take the slots in which single files are parsed."""

import asyncio
import threading
import time
from pathlib import Path
from typing import Any

import httpx
import pytest

from stridelab.service.kinds.registry import PARSE_BATCH
from support.service.web_server import Served


def test_a_single_upload_does_not_wait_for_batches(
    service: Served, http: httpx.Client, trial: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two batches are under way and stay so; a file is parsed all the same, and the batches end as usual."""
    parse = service.parts.pool.run
    under_way, may_go_on = threading.Semaphore(0), threading.Event()

    async def run(target: str, *arguments: Any, **options: Any) -> Any:
        if target == PARSE_BATCH:
            under_way.release()
            while not may_go_on.is_set():
                await asyncio.sleep(0.02)
        return await parse(target, *arguments, **options)

    monkeypatch.setattr(service.parts.pool, "run", run)
    content, answers = trial.read_bytes(), []

    def send_batch(n: int) -> None:
        files = [("file", (f"batch-{n}.c3d", content + bytes([n]) * 512))]
        with service.http(timeout=120.0) as client:
            answers.append(client.post("/api/v1/recordings/batch", files=files).status_code)

    batches = [threading.Thread(target=send_batch, args=(n,)) for n in (1, 2)]
    try:
        for batch in batches:
            batch.start()
        for _ in batches:
            assert under_way.acquire(timeout=30)
        began = time.monotonic()
        answer = http.post("/api/v1/recordings", files={"file": ("walk.c3d", content)}, timeout=20.0)
        assert answer.status_code == 201, answer.text
        assert time.monotonic() - began < 20.0
    finally:
        may_go_on.set()
        for batch in batches:
            batch.join(60)
    assert answers == [201, 201]
