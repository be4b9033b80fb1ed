"""Mutation testing: ``python -m support.mutation.mutation contacts --sample 300`` (``make mutants``).

mutmut changes the package's code in one place at a time and runs those of its own tests that reach the place, the
shortest first, ten seconds of them (``support.mutation.session``). Prints how many there are, were tried and noticed,
and every change that was not; ``--named`` tries those again, ``--within`` with more time. docs/tests.md keeps the
record.
"""

import argparse
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[3]
PACKAGES = ("dynamics", "estimation", "contacts")
CONFIGURATION = """
[tool.mutmut]
source_paths = ["src"]
only_mutate = ["src/stridelab/{package}/*"]
also_copy = ["models", "scripts", "docs"]
pytest_add_cli_args = ["-q", "-p", "no:cacheprovider", "-p", "support.mutation.session", "--hypothesis-seed=0"]
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
    """Run it in ``folder``; returns what it says."""
    done = subprocess.run(
        [sys.executable, "-m", "mutmut", *arguments], cwd=folder, capture_output=True, text=True, check=False
    )
    return done.stdout


def verdicts(folder: Path) -> dict[str, str]:
    """What became of every mutant, by its name."""
    return dict(re.findall(r"^ +(\S+): (.+)$", mutmut(folder, "results", "--all", "true"), re.MULTILINE))


def change(folder: Path, mutant: str) -> str:
    """The changed line before and after, with its file."""
    lines = mutmut(folder, "show", mutant).splitlines()
    file = next(line.removeprefix("--- src/stridelab/") for line in lines if line.startswith("--- "))
    before = [line[1:].strip() for line in lines if line.startswith("-") and not line.startswith("---")]
    after = [line[1:].strip() for line in lines if line.startswith("+") and not line.startswith("+++")]
    return f"{mutant}\n  {file}\n  - {' '.join(before)}\n  + {' '.join(after)}"


def survey(package: str, asked: argparse.Namespace) -> str:
    """Try the mutants of a package, or some of them; returns a line of Markdown and those that got through."""
    with tempfile.TemporaryDirectory(prefix="stridelab-mutants-") as place:
        folder = Path(place)
        prepare(folder, package)
        mutmut(folder, "run", NONE)  # makes them all and tries none
        every = sorted(verdicts(folder))
        if not every:
            raise SystemExit(f"mutmut made no mutant of {package}")
        tried = [name for name in every if name in asked.named] if asked.named else every
        if asked.sample is not None:
            tried = random.Random(asked.seed).sample(tried, min(asked.sample, len(tried)))
        said = mutmut(folder, "run", "--max-children", str(asked.processes), *tried)
        found = {name: verdict for name, verdict in verdicts(folder).items() if name in set(tried)}
        counts = Counter(found.values())
        if counts["not checked"]:
            raise SystemExit(f"{counts['not checked']} mutants of {package} were not tried:\n{said[-2000:]}")
        missed = sorted(name for name, verdict in found.items() if verdict in {"survived", "no tests"})
        noticed = len(found) - len(missed)
        head = f"| {package} | {len(every)} | {len(tried)} | {noticed} | {100 * noticed / len(tried):.1f} % |"
        return "\n".join([head, "", *(change(folder, name) for name in missed)])


def main() -> None:
    """Entry point."""
    asked = argparse.ArgumentParser(prog="make mutants", description=__doc__)
    asked.add_argument("packages", nargs="*", default=PACKAGES, help=f"of {', '.join(PACKAGES)} or any other")
    asked.add_argument("--sample", type=int, help="so many mutants of each, drawn at random")
    asked.add_argument("--seed", type=int, default=0)
    asked.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    asked.add_argument("--named", nargs="+", default=(), help="these mutants only, as an earlier run named them")
    asked.add_argument("--within", default="10", help="seconds of tests for each, the shortest first")
    given = asked.parse_args()
    os.environ["STRIDELAB_MUTANTS_WITHIN_S"] = given.within
    for package in given.packages:
        print(survey(package, given), flush=True)


if __name__ == "__main__":
    main()
