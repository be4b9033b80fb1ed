"""What every run of tests on a mutant needs: a plugin of pytest, for ``support.mutation.mutation``.

mutmut forks a process that has run all tests already, so caches are full of results of the code as it is: they are
emptied, or a change behind a cache would never be seen. A fixture that several tests of a file share reaches the code
in the first of them only, and counts for all. Of the tests that reach the mutant, the shortest run, as many as fit into
``WITHIN_S``: a minute of planners for each mutant that gets through would make hours of a thousand.
"""

import gc
import importlib
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

shared = defaultdict[str, set[str]](set)
"""The tests that have a fixture in common with a test."""
calls, fixtures = defaultdict[str, float](float), defaultdict[str, float](float)


def pytest_sessionstart() -> None:
    """Nothing is remembered from runs before the change."""
    for thing in gc.get_objects():
        if isinstance(thing, _lru_cache_wrapper):
            thing.cache_clear()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """The shortest tests first, and before them what was written since; until the time is full, one in any case."""
    if config.option.collectonly:
        return
    if not DURATIONS.exists():
        _note_shared(items)
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
        mutmut = importlib.import_module("mutmut.state")  # is in the environment of this run alone
        for reaching in mutmut.state().tests_by_mangled_function_name.values():
            reaching.update(*(shared[name] for name in reaching))


def _note_shared(items: list[pytest.Item]) -> None:
    users = defaultdict[tuple[str, str], set[str]](set)
    for item in items:
        for name, found in item._fixtureinfo.name2fixturedefs.items():  # type: ignore[attr-defined]
            if found[-1].scope != "function":
                users[item.nodeid.partition("::")[0], name].add(item.nodeid)
    for tests in users.values():
        for test in tests:
            shared[test] |= tests
