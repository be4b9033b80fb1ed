"""Processor time and memory that hostile archives cost, read in confined children within the limits of the service."""

import asyncio
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from stridelab.service.kinds.registry import READING
from stridelab.service.processes.pool import IsolatedPool
from stridelab.service.processes.running_child import IsolatedOutcome
from stridelab.service.settings import Settings
from support.robots.hostile_archives import EXPENSIVE, GOOD, HOSTILE, one

MAX_PROCESSOR_S = 10.0
MAX_MEMORY_BYTES = 1 << 30
LIMITS = Settings.model_fields
TARGET = "support.service.hostile_readers:read_and_measure"
ARCHIVES = {**{name: make for name, (make, _) in HOSTILE.items()}, **EXPENSIVE}

Read = Callable[[bytes, Path], IsolatedOutcome]


@pytest.fixture(scope="module")
def read() -> Iterator[Read]:
    """``read(content, folder)``: the outcome of a child that reads the upload as ``POST /robots`` does."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(Path(__file__).parents[3]))
        runner = asyncio.Runner()
        pool = IsolatedPool((*READING, TARGET.partition(":")[0]))  # or each child imports pinocchio and others: 0.36 s

        def run(content: bytes, folder: Path) -> IsolatedOutcome:
            (folder / "upload").write_bytes(content)
            task = {"file": "upload", "filename": "robot.zip", "name": "small"}
            memory_mb = LIMITS["parse_memory_mb"].default
            # the limit of the service is wall-clock time, which other work delays: the child's own time is compared
            reading = pool.run(TARGET, task, folder, timeout_s=120.0, memory_mb=memory_mb, low_priority=False)
            return runner.run(reading)

        try:
            yield run
        finally:
            runner.run(pool.close())
            runner.close()


def test_limits_of_the_service_are_those_that_are_promised() -> None:
    assert LIMITS["parse_timeout_s"].default <= MAX_PROCESSOR_S
    assert LIMITS["parse_memory_mb"].default << 20 <= MAX_MEMORY_BYTES


def test_a_good_description_is_read_and_measured(read: Read, tmp_path: Path) -> None:
    outcome = read(one(GOOD), tmp_path)
    assert outcome.state == "ok"
    assert outcome.value["code"] is None
    assert outcome.value["processor_s"] > 0.0
    assert outcome.value["peak_bytes"] > 0


@pytest.mark.parametrize("make", ARCHIVES.values(), ids=ARCHIVES.keys())
def test_hostile_archives_are_refused_within_time_and_memory(
    make: Callable[[], bytes], read: Read, tmp_path: Path
) -> None:
    outcome = read(make(), tmp_path)
    assert outcome.state == "ok", (outcome.state, outcome.log_tail)  # not killed: it refused by itself
    assert outcome.value["code"] is not None
    assert outcome.value["processor_s"] < MAX_PROCESSOR_S
    assert outcome.value["peak_bytes"] < MAX_MEMORY_BYTES
