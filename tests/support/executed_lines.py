"""Plugin of pytest that writes which lines of the reproduction each test executes, and for how long it runs.

The file is named by ``STRIDELAB_EXECUTED_LINES``. Fixtures that several tests share count for each of them, and cached
results of the reproduction are computed again in each test.
"""

import json
import os
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import pytest

REPRODUCTION: Final = "stridelab.reproduction"
PACKAGE: Final = Path("backend/stridelab/reproduction")
_coverage: Any = import_module("coverage").Coverage(data_file=None, source=[str(PACKAGE)], config_file=False)
_seconds = defaultdict[str, float](float)
_fixtures_of: dict[str, list[str]] = {}
_failed: set[str] = set()
_skipped: set[str] = set()
_running: list[tuple[str, float]] = []
"""Contexts that are entered, the innermost last, and the processor time spent in those inside of each."""


assert not any(name.startswith(REPRODUCTION) for name in sys.modules), "its lines would not be seen"
_coverage.start()
_coverage.switch_context("import")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Attribute lines to the test."""
    _clear_caches()
    definitions = item._fixtureinfo.name2fixturedefs.values()  # type: ignore[attr-defined]
    _fixtures_of[item.nodeid] = [
        _name_of(definition) for of_name in definitions for definition in of_name if definition.scope != "function"
    ]
    return (yield from _attributed(item.nodeid))


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: Any) -> Iterator[None]:
    """Attribute lines to the fixture, if several tests may share it."""
    if fixturedef.scope == "function":
        return (yield)
    return (yield from _attributed(_name_of(fixturedef)))


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """A test that fails or is skipped without a change says nothing on one."""
    if not report.passed:
        (_failed if report.failed else _skipped).add(report.nodeid)


def pytest_sessionfinish() -> None:
    """Write lines and seconds per test, those of its fixtures included, and whether it has failed."""
    _coverage.stop()
    data = _coverage.get_data()
    lines = defaultdict[str, set[tuple[str, int]]](set)
    for path in data.measured_files():
        file = Path(path).relative_to(PACKAGE.resolve()).as_posix()
        for line, contexts in data.contexts_by_lineno(path).items():
            for context in contexts:
                lines[context].add((file, line))
    tests = {
        test: {
            "seconds": _seconds[test] + sum(_seconds[name] for name in fixtures),
            "lines": sorted(lines[test].union(*(lines[name] for name in fixtures))),
            "failed": test in _failed,
        }
        for test, fixtures in _fixtures_of.items()
        if test not in _skipped
    }
    Path(os.environ["STRIDELAB_EXECUTED_LINES"]).write_text(json.dumps(tests), encoding="utf-8")


def _name_of(definition: Any) -> str:
    return f"fixture {definition.baseid} {definition.argname}"


def _attributed(context: str) -> Iterator[None]:
    _coverage.switch_context(context)
    start_s, nested_s = time.process_time(), 0.0
    _running.append((context, 0.0))
    try:
        return (yield)
    finally:
        whole_s = time.process_time() - start_s
        _, nested_s = _running.pop()
        _seconds[context] += whole_s - nested_s
        if _running:
            outer, inside_s = _running.pop()
            _running.append((outer, inside_s + whole_s))
            _coverage.switch_context(outer)
        else:
            _coverage.switch_context("between tests")


def _clear_caches() -> None:
    """Clear the reproduction's caches; the library's remain, since no mutant changes their functions."""
    for name, module in list(sys.modules.items()):
        if name.startswith(REPRODUCTION):
            for thing in list(vars(module).values()):
                if str(getattr(thing, "__module__", "")).startswith(REPRODUCTION):
                    with suppress(AttributeError):
                        thing.cache_clear()
