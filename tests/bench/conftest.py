"""Benchmarks measure what users run: without the run-time checks of annotations, which belong to the tests."""

from collections.abc import Callable, Iterator

import jaxtyping
import pytest
from pytest_benchmark.fixture import BenchmarkFixture


@pytest.fixture(autouse=True)
def as_in_production() -> Iterator[None]:
    """No shapes are checked while a benchmark runs."""
    before = jaxtyping.config.jaxtyping_disable
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", before)


@pytest.fixture
def note_rate(benchmark: BenchmarkFixture) -> Callable[[int], None]:
    """Call it with the samples of one round, after the benchmark: their rate goes into the table."""

    def note(samples: int) -> None:
        benchmark.extra_info["samples_per_s"] = round(samples / benchmark.stats.stats.median)

    return note
