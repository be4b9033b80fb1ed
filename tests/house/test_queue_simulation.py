"""The simulation behind the sizing page, against what queueing theory says exactly."""

import importlib.util
import json
import math
import random
from pathlib import Path
from types import ModuleType

import pytest

from stridelab.service.kinds.registry import KINDS

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def simulation() -> ModuleType:
    import sys

    spec = importlib.util.spec_from_file_location("simulate_queue", ROOT / "scripts" / "simulate_queue.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look there
    spec.loader.exec_module(module)
    return module


def erlang_c(slots: int, offered: float) -> float:
    """Share of jobs that wait, in M/M/c."""
    terms = [offered**k / math.factorial(k) for k in range(slots)]
    last = offered**slots / math.factorial(slots) * slots / (slots - offered)
    return last / (sum(terms) + last)


@pytest.mark.parametrize(("slots", "offered"), [(1, 0.7), (3, 2.4), (20, 17.0)])
def test_waiting_times_are_those_of_erlang(simulation: ModuleType, slots: int, offered: float) -> None:
    dice, mean_s = random.Random(7), 2.0
    arrivals = simulation.stream(offered / mean_s, 200_000, lambda: (dice.expovariate(1 / mean_s), False), dice)
    waited = [wait for wait, _ in simulation.waits(arrivals, slots, 0)]
    expected = erlang_c(slots, offered)
    assert sum(wait > 0 for wait in waited) / len(waited) == pytest.approx(expected, rel=0.05)
    assert sum(waited) / len(waited) == pytest.approx(expected * mean_s / (slots - offered), rel=0.08)


def test_equal_services_wait_as_pollaczek_and_khinchine_say(simulation: ModuleType) -> None:
    dice, load = random.Random(8), 0.8
    arrivals = simulation.stream(load, 200_000, lambda: (1.0, False), dice)
    waited = [wait for wait, _ in simulation.waits(arrivals, 1, 0)]
    assert sum(waited) / len(waited) == pytest.approx(load / (2 * (1 - load)), rel=0.06)


def test_no_job_is_lost_and_each_kind_keeps_its_order(simulation: ModuleType) -> None:
    dice = random.Random(9)
    arrivals = simulation.stream(3.0, 5000, lambda: (dice.expovariate(1.0), dice.random() < 0.5), dice)
    assert len(simulation.waits(arrivals, 3, 1)) == len(arrivals)


def test_a_reserved_slot_keeps_short_jobs_from_waiting_for_long_ones(simulation: ModuleType) -> None:
    dice = random.Random(10)

    def draw() -> tuple[float, bool]:
        short = dice.random() < 0.9
        return (0.1 if short else 300.0), short

    arrivals = simulation.stream(0.2, 3000, draw, dice)
    alone, beside = simulation.waits(arrivals, 7, 0), simulation.waits(arrivals, 6, 1)
    assert simulation.late(alone, True) > 60.0
    assert simulation.late(beside, True) < 0.2


def test_shares_and_lanes_are_those_of_the_service(simulation: ModuleType) -> None:
    costs = json.loads((ROOT / "docs" / "job_costs.json").read_text(encoding="utf-8"))["kinds"]
    assert sum(simulation.SHARES.values()) == pytest.approx(1.0)
    assert set(simulation.SHARES) <= set(KINDS)
    assert set(simulation.SHARES) <= set(costs)
    assert {kind for kind in simulation.SHARES if KINDS[kind].lane == "short"} == simulation.SHORT


def test_the_page_shows_the_figures_of_the_simulation(simulation: ModuleType) -> None:
    measurements = json.loads((ROOT / "docs" / "job_costs.json").read_text(encoding="utf-8"))
    costs, calls = measurements["kinds"], measurements["calls"]
    page = (ROOT / "docs" / "sizing.md").read_text(encoding="utf-8")
    for row in (*simulation.rows(costs, (10, 1000), 40_000), *simulation.loads(measurements, simulation.CROWDS)):
        assert f"| {' | '.join(row)} |" in page
    assert f"{simulation.mean_cost_s(costs):.2f} s" in page
    assert f"{calls['submission_cpu_ms']:.1f} ms" in page
    assert f"{calls['reading_cpu_ms']:.1f} ms" in page
    assert f"{measurements['progress']['reports_per_s']:.0f} reports" in page
    for kind, measured in costs.items():
        times = [one["cpu_s"] for one in measured]
        mean, spread = sum(times) / len(times), f"{min(times):.2f} to {max(times):.2f}"
        assert f"| `{kind}` | {mean:.2f} | {spread} | {measured[0]['bytes'] / 1e6:.2f} |" in page
