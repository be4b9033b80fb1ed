"""Processor time and memory that hostile terrains cost, read in confined children within the limits of the service."""

import asyncio
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from stridelab.service.kinds.registry import READING
from stridelab.service.processes.pool import IsolatedPool
from stridelab.service.processes.running_child import IsolatedOutcome
from stridelab.service.settings import Settings
from support.service.terrain_files import CODES, HOSTILE, stairs

MAX_PROCESSOR_S = 10.0
MAX_MEMORY_BYTES = 1 << 30
TARGET = "support.service.hostile_readers:read_terrain_and_measure"

Read = Callable[[str, bytes, Path], IsolatedOutcome]


@pytest.fixture(scope="module")
def read() -> Iterator[Read]:
    """``read(filename, content, folder)``: the outcome of a child that reads the upload as ``POST /terrains`` does."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
        runner = asyncio.Runner()
        pool = IsolatedPool((*READING, TARGET.partition(":")[0]))

        def run(filename: str, content: bytes, folder: Path) -> IsolatedOutcome:
            file = f"upload{Path(filename).suffix}"
            (folder / file).write_bytes(content)
            task = {"file": file, "filename": filename, "metres_per_unit": 1.0}
            memory_mb = Settings.model_fields["parse_memory_mb"].default
            reading = pool.run(TARGET, task, folder, timeout_s=120.0, memory_mb=memory_mb, low_priority=False)
            return runner.run(reading)

        try:
            yield run
        finally:
            runner.run(pool.close())
            runner.close()


def test_a_good_terrain_is_read_and_measured(read: Read, tmp_path: Path) -> None:
    outcome = read("stairs.stl", stairs(), tmp_path)
    assert (outcome.state, outcome.value["code"]) == ("ok", None), outcome.log_tail
    assert outcome.value["processor_s"] > 0.0


@pytest.mark.parametrize(("filename", "make"), HOSTILE.values(), ids=HOSTILE.keys())
def test_hostile_terrains_are_refused_within_time_and_memory(
    filename: str, make: Callable[[], bytes], read: Read, tmp_path: Path
) -> None:
    outcome = read(filename, make(), tmp_path)
    assert outcome.state == "ok", (outcome.state, outcome.log_tail)  # not killed: it refused by itself
    assert outcome.value["code"].startswith(CODES)
    assert outcome.value["processor_s"] < MAX_PROCESSOR_S
    assert outcome.value["peak_bytes"] < MAX_MEMORY_BYTES
