"""What every run of tests on a mutant needs: a plugin of pytest, for ``support.mutation``.

mutmut forks a process that has run all tests already, so caches are full of results of the code as it is: they are
emptied, or a change behind a cache would never be seen. And of the tests that reach the mutant, the shortest run, as
many as fit into ``WITHIN_S``: a minute of planners for each mutant that gets through would make hours of a thousand.
"""

import gc
import json
import os
from collections import defaultdict
from functools import _lru_cache_wrapper
from pathlib import Path
from typing import Final

import pytest

WITHIN_S: Final = float(os.environ.get("STRIDELAB_MUTANTS_WITHIN_S", "10"))
DURATIONS: Final = Path("seconds-of-tests.json")
"""How long each test takes with the fixtures of its file, from the first run, in which all run."""

calls, fixtures = defaultdict[str, float](float), defaultdict[str, float](float)


def pytest_sessionstart() -> None:
    """Nothing is remembered from runs before the change."""
    for thing in gc.get_objects():
        if isinstance(thing, _lru_cache_wrapper):
            thing.cache_clear()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """The shortest tests first, and before them what was written since; until the time is full, one in any case."""
    if config.option.collectonly or not DURATIONS.exists():
        return
    seconds = json.loads(DURATIONS.read_text(encoding="utf-8"))
    items.sort(key=lambda item: seconds.get(item.nodeid, 0.0))
    used, kept = 0.0, 0
    while kept < len(items) and (kept == 0 or used + seconds.get(items[kept].nodeid, 0.0) <= WITHIN_S):
        used, kept = used + seconds.get(items[kept].nodeid, 0.0), kept + 1
    config.hook.pytest_deselected(items=items[kept:])
    del items[kept:]


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Fixtures may be shared by all tests of a file, and any of them may be the one that pays."""
    if report.when == "call":
        calls[report.nodeid] += report.duration
    else:
        fixtures[report.nodeid.partition("::")[0]] += report.duration


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Written once, by the run of all tests."""
    if not session.config.option.collectonly and not DURATIONS.exists():
        seconds = {name: taken + fixtures[name.partition("::")[0]] for name, taken in calls.items()}
        DURATIONS.write_text(json.dumps(seconds), encoding="utf-8")
