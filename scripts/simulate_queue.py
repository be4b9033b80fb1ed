"""How many slots a crowd of users needs: a simulation of the queue with the measured costs of docs/job_costs.json.

Jobs arrive at random (Poisson) at the rate of the busiest hour, kinds by their shares, and take the processor time that
was measured for them, spread out. Slots serve as the workers' do: first come first served, and beside every
``GENERAL_PER_SHORT`` slots for any job there is one for short jobs alone. Prints the tables of the sizing page.
usage: simulate_queue.py
"""

import heapq
import json
import math
import random
import sys
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

COSTS = Path(__file__).parents[1] / "docs" / "job_costs.json"
JOBS_PER_USER_AND_DAY, HOURS_PER_DAY, BUSIEST = 12.0, 8.0, 2.5
"""Assumed: a user's jobs on a working day, and how much busier than the mean the busiest hour is."""
SHARES = {
    "estimate-com": 0.35,
    "fit-cycloid": 0.15,
    "compare-estimators": 0.08,
    "study-population": 0.02,
    "simulate-recording": 0.05,
    "plan-motion": 0.20,
    "plan-contacts": 0.05,
    "plan-receding": 0.03,
    "sweep": 0.03,
    "reproduce": 0.03,
    "learn-reachability": 0.01,
}
"""Assumed: what these jobs are."""
SPREAD = 0.6
"""Assumed: standard deviation of the logarithm of a job's size beside the measured one."""
SHORT = frozenset({"compare-estimators", "estimate-com", "fit-cycloid", "plan-contacts"})
"""Kinds of the short lane."""
GENERAL_PER_SHORT = 4
READINGS_PER_JOB = 20
"""Assumed: how often a page or a script looks at a job."""
REPORTS_PER_S = 5.0
"""The most that a running job reports (``PROGRESS_S`` of the errand); most say less."""
WORKING_DAYS_STORED = 64
"""Working days within the 90 days that results are kept."""
CROWDS = (10, 1000, 100_000)
PATIENCE_S = {True: 2.0, False: 60.0}
"""Waits that 95 of 100 jobs stay below: short ones, and others."""


@dataclass(frozen=True)
class Arrival:
    """One job: when it comes, how long it takes, whether it counts as short."""

    at_s: float
    takes_s: float
    short: bool


def waits(arrivals: Sequence[Arrival], general: int, reserved: int) -> list[tuple[float, bool]]:
    """Wait of every job in seconds, and whether it was a short one; ``reserved`` slots serve short jobs alone."""
    free = {True: reserved, False: general}
    queues: dict[bool, deque[Arrival]] = {True: deque(), False: deque()}
    busy: list[tuple[float, bool]] = []
    waited: list[tuple[float, bool]] = []

    def begin(job: Arrival, now_s: float, slot: bool) -> None:
        free[slot] -= 1
        waited.append((now_s - job.at_s, job.short))
        heapq.heappush(busy, (now_s + job.takes_s, slot))

    def release(until_s: float) -> None:
        while busy and busy[0][0] <= until_s:
            now_s, slot = heapq.heappop(busy)
            free[slot] += 1
            mine = [queues[True]] if slot else [queue for queue in queues.values() if queue]
            nearest = min((queue for queue in mine if queue), key=lambda queue: queue[0].at_s, default=None)
            if nearest is not None:
                begin(nearest.popleft(), now_s, slot)

    for job in arrivals:
        release(job.at_s)
        slot = job.short and free[True] > 0
        if slot or free[False] > 0:
            begin(job, job.at_s, slot)
        else:
            queues[job.short].append(job)
    release(math.inf)
    return waited


def stream(
    rate_per_s: float, number: int, draw: Callable[[], tuple[float, bool]], dice: random.Random
) -> list[Arrival]:
    """``number`` jobs that come at random at a rate."""
    now_s, arrivals = 0.0, []
    for _ in range(number):
        now_s += dice.expovariate(rate_per_s)
        arrivals.append(Arrival(now_s, *draw()))
    return arrivals


def measured(costs: dict[str, list[dict[str, float]]], dice: random.Random) -> Callable[[], tuple[float, bool]]:
    """Draws a kind by its share, and one of its measured costs, spread out around the same mean."""
    names, shares = list(SHARES), list(SHARES.values())

    def draw() -> tuple[float, bool]:
        (kind,) = dice.choices(names, shares)
        size = dice.lognormvariate(-(SPREAD**2) / 2, SPREAD)
        return size * dice.choice(costs[kind])["cpu_s"], kind in SHORT

    return draw


def mean_cost_s(costs: dict[str, list[dict[str, float]]]) -> float:
    """Processor seconds of a job, by the shares."""
    return sum(share * sum(one["cpu_s"] for one in costs[kind]) / len(costs[kind]) for kind, share in SHARES.items())


def late(waited: list[tuple[float, bool]], short: bool, share: float = 0.95) -> float:
    """The wait that ``share`` of the jobs of a sort stay below."""
    mine = sorted(wait for wait, is_short in waited if is_short is short)
    return mine[min(len(mine) - 1, int(share * len(mine)))]


def fewest_slots(arrivals: list[Arrival], offered: float) -> int:
    """The fewest general slots with which both sorts of jobs wait no longer than ``PATIENCE_S``."""

    def suffices(general: int) -> bool:
        waited = waits(arrivals, general, reserved(general))
        return all(late(waited, short) <= patience_s for short, patience_s in PATIENCE_S.items())

    low, high = 0, max(2, math.ceil(2.0 * offered) + 4)
    while not suffices(high):
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if suffices(middle) else (middle, high)
    return high


def reserved(general: int) -> int:
    """Slots for short jobs beside ``general`` others."""
    return max(1, round(general / GENERAL_PER_SHORT))


def rows(costs: dict[str, list[dict[str, float]]], crowds: Sequence[int], number: int) -> Iterator[list[str]]:
    """One row of the table per number of users."""
    for users in crowds:
        dice = random.Random(users)  # noqa: S311 (no secret hangs on it)
        rate_per_s = users * JOBS_PER_USER_AND_DAY / (HOURS_PER_DAY * 3600) * BUSIEST
        offered = rate_per_s * mean_cost_s(costs)
        arrivals = stream(rate_per_s, number, measured(costs, dice), dice)
        general = fewest_slots(arrivals, offered)
        waited = waits(arrivals, general, reserved(general))
        yield [
            _spaced(users),
            f"{rate_per_s:.3g}",
            f"{offered:.3g}",
            f"{general} + {reserved(general)}",
            f"{late(waited, True, 0.5):.1f} / {late(waited, True):.1f} s",
            f"{late(waited, False, 0.5):.1f} / {late(waited, False):.1f} s",
        ]


def loads(measurements: dict[str, Any], crowds: Sequence[int]) -> Iterator[list[str]]:
    """Further loads of so many users, by arithmetic: processors of web servers, progress reports, storage."""
    kinds, calls = measurements["kinds"], measurements["calls"]
    job_bytes = sum(share * sum(one["bytes"] for one in kinds[k]) / len(kinds[k]) for k, share in SHARES.items())
    for users in crowds:
        jobs_per_day = users * JOBS_PER_USER_AND_DAY
        rate_per_s = jobs_per_day / (HOURS_PER_DAY * 3600) * BUSIEST
        web_ms = calls["submission_cpu_ms"] + READINGS_PER_JOB * calls["reading_cpu_ms"]
        n_stored = jobs_per_day * WORKING_DAYS_STORED
        yield [
            _spaced(users),
            f"{rate_per_s * web_ms / 1e3:.3g}",
            f"{rate_per_s * mean_cost_s(kinds) * REPORTS_PER_S:.3g}",
            f"{n_stored / 1e6:.3g} million",
            f"{n_stored * job_bytes / 1e12:.3g} TB",
        ]


def _spaced(number: int) -> str:
    return f"{number:,}".replace(",", " ")


def main() -> None:
    """Print the tables."""
    measurements = json.loads(COSTS.read_text(encoding="utf-8"))
    costs = measurements["kinds"]
    sys.stdout.write(f"mean cost of a job: {mean_cost_s(costs):.2f} s of one core\n\n")
    heads = ["users", "jobs/s", "cores busy", "slots (any + short)", "short: p50 / p95 wait", "others: p50 / p95 wait"]
    _print(heads, rows(costs, CROWDS, 40_000))
    more = ["users", "web cores", "reports of progress/s", "jobs kept 90 days", "their results"]
    _print(more, loads(measurements, CROWDS))


def _print(heads: list[str], table: Iterator[list[str]]) -> None:
    for row in (heads, ["---"] * len(heads), *table):
        sys.stdout.write(f"| {' | '.join(row)} |\n")
    sys.stdout.write("\n")


if __name__ == "__main__":
    main()
