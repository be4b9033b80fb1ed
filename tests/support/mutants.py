"""Mutation testing: ``python -m support.mutants contacts --sample 300`` (``make mutants``).

mutmut changes the package's code in one place at a time and runs those of its own tests that reach the place, the
shortest first, ten seconds of them. Prints how many there are, were tried and noticed, and every change that was not;
``--named`` tries those again, ``--within`` with more time. docs/tests.md has the results.

The module is also a plugin of pytest for every run of tests on a mutant. mutmut forks a process that has run all tests
already, so caches are full of results of the code as it is: they are emptied, or a change behind a cache would never be
seen. A fixture that several tests of a file share reaches the code in the first of them only, and counts for all. Of
the tests that reach the mutant, the shortest run, as many as fit into
``WITHIN_S``: a minute of planners for each mutant that gets through would make hours of a thousand.
"""

import argparse
import gc
import importlib
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter, defaultdict
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
    """Clear caches of runs before the change."""
    gc.unfreeze()  # tests/conftest.py has put what was imported out of sight
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
    used, n_selected = 0.0, 0
    while n_selected < len(items) and (
        n_selected == 0 or used + seconds.get(items[n_selected].nodeid, 0.0) <= WITHIN_S
    ):
        used, n_selected = used + seconds.get(items[n_selected].nodeid, 0.0), n_selected + 1
    config.hook.pytest_deselected(items=items[n_selected:])
    del items[n_selected:]


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Fixtures may be shared by all tests of a file, and any of them may be the one that pays."""
    if report.when == "call":
        calls[report.nodeid] += report.duration
    else:
        fixtures[report.nodeid.partition("::")[0]] += report.duration


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Written once, by the run of all tests."""
    if not session.config.option.collectonly and not DURATIONS.exists():
        seconds = {name: seconds_taken + fixtures[name.partition("::")[0]] for name, seconds_taken in calls.items()}
        DURATIONS.write_text(json.dumps(seconds), encoding="utf-8")
        mutmut = importlib.import_module("mutmut.state")  # is in the environment of this run alone
        for reaching in mutmut.state().tests_by_mangled_function_name.values():
            reaching.update(*(shared[name] for name in reaching))


def _note_shared(items: list[pytest.Item]) -> None:
    users = defaultdict[tuple[str, str], set[str]](set)
    for item in items:
        for name, definitions in item._fixtureinfo.name2fixturedefs.items():  # type: ignore[attr-defined]
            if definitions[-1].scope != "function":
                users[item.nodeid.partition("::")[0], name].add(item.nodeid)
    for tests in users.values():
        for test in tests:
            shared[test] |= tests


ROOT = Path(__file__).parents[2]
PACKAGES = ("dynamics", "estimation", "contacts")
CONFIGURATION = """
[tool.mutmut]
source_paths = ["src"]
only_mutate = ["src/stridelab/{package}/*"]
also_copy = ["models", "scripts", "docs"]
pytest_add_cli_args = ["-q", "-p", "no:cacheprovider", "-p", "support.mutants", "--hypothesis-seed=0"]
pytest_add_cli_args_test_selection = ["tests/{package}"]
track_dependencies = false
timeout_constant = 40.0
timeout_multiplier = 0.5
"""
"""A mutant may take 20 s and half of what all its tests take: ten seconds of them run, maybe on a busy machine."""
NONE = "stridelab.no.mutant.is.called.so"


def prepare(folder: Path, package: str) -> None:
    """A copy of the code in the form that mutmut knows: below ``src``."""
    without = shutil.ignore_patterns("__pycache__", "native", "*.so")
    shutil.copytree(ROOT / "backend" / "stridelab", folder / "src" / "stridelab", ignore=without)
    for name in ("tests", "models", "scripts", "docs"):
        shutil.copytree(ROOT / name, folder / name, ignore=without)
    settings = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    (folder / "pyproject.toml").write_text(settings + CONFIGURATION.format(package=package), encoding="utf-8")


def mutmut(folder: Path, *arguments: str) -> str:
    """Run mutmut in ``folder``; returns its output."""
    run = subprocess.run(
        [sys.executable, "-m", "mutmut", *arguments], cwd=folder, capture_output=True, text=True, check=False
    )
    return run.stdout


def verdicts(folder: Path) -> dict[str, str]:
    """Outcome of every mutant by name."""
    return dict(re.findall(r"^ +(\S+): (.+)$", mutmut(folder, "results", "--all", "true"), re.MULTILINE))


def change(folder: Path, mutant: str) -> str:
    """The changed line before and after, with its file."""
    lines = mutmut(folder, "show", mutant).splitlines()
    file = next(line.removeprefix("--- src/stridelab/") for line in lines if line.startswith("--- "))
    before = [line[1:].strip() for line in lines if line.startswith("-") and not line.startswith("---")]
    after = [line[1:].strip() for line in lines if line.startswith("+") and not line.startswith("+++")]
    return f"{mutant}\n  {file}\n  - {' '.join(before)}\n  + {' '.join(after)}"


def survey(package: str, arguments: argparse.Namespace) -> str:
    """Try the mutants of a package, or some of them; returns a line of Markdown and those that got through."""
    with tempfile.TemporaryDirectory(prefix="stridelab-mutants-") as place:
        folder = Path(place)
        prepare(folder, package)
        mutmut(folder, "run", NONE)  # makes them all and tries none
        every = sorted(verdicts(folder))
        if not every:
            raise SystemExit(f"mutmut made no mutant of {package}")
        tried = [name for name in every if name in arguments.named] if arguments.named else every
        if arguments.sample is not None:
            tried = random.Random(arguments.seed).sample(tried, min(arguments.sample, len(tried)))
        report = mutmut(folder, "run", "--max-children", str(arguments.processes), *tried)
        results = {name: verdict for name, verdict in verdicts(folder).items() if name in set(tried)}
        counts = Counter(results.values())
        if counts["not checked"]:
            raise SystemExit(f"{counts['not checked']} mutants of {package} were not tried:\n{report[-2000:]}")
        missed = sorted(name for name, verdict in results.items() if verdict in {"survived", "no tests"})
        noticed = len(results) - len(missed)
        head = f"| {package} | {len(every)} | {len(tried)} | {noticed} | {100 * noticed / len(tried):.1f} % |"
        return "\n".join([head, "", *(change(folder, name) for name in missed)])


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(prog="make mutants", description=__doc__)
    parser.add_argument("packages", nargs="*", default=PACKAGES, help=f"of {', '.join(PACKAGES)} or any other")
    parser.add_argument("--sample", type=int, help="so many mutants of each, drawn at random")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--named", nargs="+", default=(), help="these mutants only, as an earlier run named them")
    parser.add_argument("--within", default="10", help="seconds of tests for each, the shortest first")
    arguments = parser.parse_args()
    os.environ["STRIDELAB_MUTANTS_WITHIN_S"] = arguments.within
    for package in arguments.packages:
        print(survey(package, arguments), flush=True)


if __name__ == "__main__":
    main()
