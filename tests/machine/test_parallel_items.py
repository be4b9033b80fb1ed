"""One process per item: what crashes, hangs or refuses costs itself alone."""

import os
import time
from collections.abc import Iterator
from contextlib import nullcontext

import pytest

from stridelab.errors import NotEstimable, StridelabError
from stridelab.machine.parallel import map_isolated
from support.parallel_work import another_thread, behave, workers


@pytest.fixture(params=["one thread", "two threads"], autouse=True)
def threads(request: pytest.FixtureRequest) -> Iterator[None]:
    """A process with one thread forks itself; one with more asks a server."""
    with another_thread() if request.param == "two threads" else nullcontext():
        yield


def done(*hows: str, timeout_s: float = 30.0) -> dict[int, object]:
    items = [{"how": how, "n": n} for n, how in enumerate(hows)]
    return dict(map_isolated(behave, items, preload=["support.parallel_work"], timeout_s=timeout_s))


def test_every_item_has_a_process_of_its_own() -> None:
    outcomes = done("work", "work", "work", "work", "work")
    answers = [outcomes[n] for n in range(5)]
    assert [a["twice"] for a in answers if isinstance(a, dict)] == [0, 2, 4, 6, 8]
    pids = {a["pid"] for a in answers if isinstance(a, dict)}
    assert len(pids) == 5
    assert os.getpid() not in pids


def test_a_failing_item_does_not_affect_the_others() -> None:
    outcomes = done("crash", "work", "exit", "hang", "refuse", "break", "large", timeout_s=3.0)
    assert len(outcomes) == 7
    codes = {n: e.code for n, e in outcomes.items() if isinstance(e, StridelabError)}
    assert codes == {
        0: "computation-crashed",
        2: "computation-crashed",
        3: "computation-timed-out",
        4: "no-step",
        5: "computation-crashed",
    }
    refusal = outcomes[4]
    assert isinstance(refusal, NotEstimable)
    assert refusal.faults[0].where == "walk.c3d"
    large = outcomes[6]
    assert isinstance(large, dict)
    assert len(large["text"]) == 3_000_000


def test_a_closed_iterator_leaves_no_process_of_an_item() -> None:
    answers = map_isolated(
        behave, [{"how": h, "n": 1} for h in ("work", "hang", "hang")], preload=["support.parallel_work"]
    )
    next(answers)
    assert workers() != []
    answers.close()
    until = time.monotonic() + 10
    while workers() and time.monotonic() < until:
        time.sleep(0.05)
    assert workers() == []


def test_no_items_give_no_answers() -> None:
    assert done() == {}


@pytest.mark.parametrize("processes", [1, 3])
def test_any_number_of_processes_gives_the_same_outcomes(processes: int) -> None:
    items = [{"how": "work", "n": n} for n in range(4)]
    outcomes = dict(map_isolated(behave, items, preload=["support.parallel_work"], processes=processes))
    assert sorted(outcomes) == [0, 1, 2, 3]


def test_no_more_at_a_time_than_cores_that_may_be_used(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine of 64 cores, two of them ours: of six requested processes, two run at a time."""
    monkeypatch.setattr(os, "cpu_count", lambda: 64)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _pid: {0, 1})
    items = [{"how": "interval", "n": n} for n in range(6)]
    answers = [answer for _, answer in map_isolated(behave, items, preload=["support.parallel_work"], processes=6)]
    intervals_s = [answer["interval_s"] for answer in answers if isinstance(answer, dict)]
    assert len(intervals_s) == 6
    assert max(sum(a <= began <= b for a, b in intervals_s) for began, _ in intervals_s) <= 2
