"""Mutants of what verdicts stand on: ``python -m support.verdict_mutants --seed 1 --sample 100 --log FILE``.

Changes the reproduction in one place at a time: bounds, sizes of samples, seeds, signs, comparisons, reductions, the
estimator, gait, noise or robot that is compared. Not changed are texts, tables, drawings and progress, nor what has no
effect when the program runs (``NO_EFFECT``); a change into a name that does not exist would be noticed by any test, and
is not made. For each mutant the tests that import the changed module run, the shortest first, until one fails. The log
has a line per mutant; a run with the same log goes on where the former one stopped.
"""

import argparse
import ast
import copy
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

from support.mutant_tests import ExecutedTests

ROOT: Final = Path(__file__).parents[2]
PACKAGE: Final = Path("backend/stridelab/reproduction")
MODULES: Final = ("claims.py", "chapter2", "chapter3", "chapter4", "common", "studies")
RECORDED: Final = "tests/reproduction/test_reproduction.py::test_what_verdicts_stand_on_is_as_recorded"
OF_ITEMS: Final = ("tests/reproduction/test_reproduction.py", "tests/reproduction/test_collected_reproduction.py")
"""Tests of all items, or of the page: of the former the records alone are tried, and what computes no item."""
WITHOUT_ITEMS: Final = (
    "the_contract_names_what_there_is", "the_verdict_is_that_of_the_worst_claim",
    "unknown_items_and_numbers_of_seeds_are_refused", "a_bias_of_the_force_acts_at_the_plate",
    "a_masked_second_holds_a_full_single_support_and_only_it_has_force",
)  # fmt: skip
TESTS: Final = (
    RECORDED,
    *(f"{OF_ITEMS[0]}::test_{name}" for name in WITHOUT_ITEMS),
    OF_ITEMS[1],
    *sorted(
        path
        for path, text in (
            (file.relative_to(ROOT).as_posix(), file.read_text(encoding="utf-8"))
            for folder in ("reproduction", "studies")
            for file in (ROOT / "tests" / folder).rglob("test_*.py")
        )
        if path not in OF_ITEMS and "stridelab.reproduction" in text
    ),
)
"""Tests of the reproduction, the records of its items in front."""
SLOW_TESTS: Final = (
    "tests/reproduction/chapter3/test_people_figures.py::test_a_simulated_population_gives_no_verdict_on_people",
    "tests/reproduction/report/test_sampled_figures.py::test_other_seeds_are_other_people",
)
"""Half a minute each: they are not tried on mutants."""
LIMIT_S: Final = 120.0
UNCHANGED_LIMIT_S: Final = 3600.0
UNSEEN: Final = re.compile(
    r"^_?draw_|_panels?$|curves?$|_bars$|(?<!wrong)(?<!rigid)_table$|_columns$|_rows?$|svg|_map|label|_text$|^_?spots$|^panel_"
)
"""Functions of tables and drawings."""
UNSEEN_CALLS: Final = frozenset(
    {"tell", "render_svg", "Panel", "Curve", "Bars", "says", "PrintedColumn", "lru_cache", "dataclass"}
)
COMPARISONS: Final = {ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq,
                      ast.NotEq: ast.Eq, ast.In: ast.NotIn, ast.NotIn: ast.In}  # fmt: skip
OPERATORS: Final = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.BitAnd: ast.BitOr}
PAIRS: Final = (
    ("at_most", "at_least"), ("above", "below"), ("mean", "max"), ("median", "max"), ("min", "max"), ("any", "all"),
    ("nanmean", "nanmax"), ("THESIS", "KALMAN"), ("SMOOTHER", "THESIS"), ("GEOMETRY", "SMOOTHER"), ("RTS", "KALMAN"),
    ("AUTO", "THESIS"), ("fast", "comfortable"), ("robot", "human"), ("left", "right"),
    ("right_foot", "left_foot"), ("uniform", "conditioned"), ("with", "without"), ("hrp2", "talos"), ("thesis", "none"),
    ("marker-like", "thesis"), ("words", "ours"), ("met", "not_met"), ("thesis_in_error", "not_met"), ("x", "y"),
)  # fmt: skip
"""Names, attributes and words that stand for each other."""
CALLED: Final = frozenset({"at_most", "at_least", "above", "below", "min", "max"})
OTHER: Final = {one: other for a, b in PAIRS for one, other in ((b, a), (a, b))}
ATTRIBUTES: Final = frozenset({"mean", "median", "min", "max", "any", "all", "nanmean", "nanmax"})
"""Attributes that are changed, beside those in capitals; others, such as ``trial.robot``, would not exist."""
CRITERIA: Final = frozenset({"at_most", "at_least", "above", "below", "within"})
THRESHOLDS: Final = {"thesis": "words", "words": "ours", "ours": "thesis"}
"""Whose a bound is, in calls of ``CRITERIA``; elsewhere "thesis" is a noise or a cone."""
THRESHOLD: Final = "threshold"
NO_EFFECT: Final = (ast.JoinedStr, ast.Import, ast.ImportFrom, ast.arguments)
"""Messages, imports and defaults with annotations; of a class its body alone is changed, since a keyword of its
definition (``total`` of a ``TypedDict``) is read by type checkers and by nothing else."""


@dataclass(frozen=True)
class Mutant:
    """A module with one change."""

    file: str
    line: int
    before: str
    after: str
    source: str

    @property
    def name(self) -> str:
        """File, line and change."""
        return f"{self.file}:{self.line}: {self.before} -> {self.after}"


def mutants_of(path: Path, file: str, imported: AbstractSet[str]) -> Iterator[Mutant]:
    """Every change of a module; ``imported`` are names that other modules use."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for call in ast.walk(tree):
        if isinstance(call, ast.Call) and getattr(call.func, "id", "") in CRITERIA:
            for argument in call.args:
                if isinstance(argument, ast.Constant) and argument.value in THRESHOLDS:
                    argument.kind = THRESHOLD
    for place in _places(tree, _used_names(tree, imported)):
        if _is_changeable(place):
            before = ast.unparse(place)
            undo = _change_in_place(place)
            yield Mutant(file, place.lineno, before[:90], ast.unparse(place)[:90], ast.unparse(tree))
            undo()


def _used_names(tree: ast.AST, imported: AbstractSet[str]) -> set[str]:
    """Names that are read outside of texts, tables and drawings, also by way of other such names."""
    used: set[str] = set()
    while True:
        now = {place.id for place in _places(tree, used | imported) if isinstance(place, ast.Name)} | imported
        if now <= used:
            return used
        used |= now


def _is_unused(node: ast.AST, used: AbstractSet[str]) -> bool:
    """Whether a node assigns to names that only texts, tables and drawings read."""
    if not isinstance(node, (ast.Assign, ast.AnnAssign)):
        return False
    targets = node.targets if isinstance(node, ast.Assign) else [node.target]
    parts = [part for target in targets for part in ast.walk(target) if isinstance(part, ast.expr)]
    names = [part.id for part in parts if isinstance(part, ast.Name)]
    return all(isinstance(part, (ast.Name, ast.Tuple)) for part in parts) and not any(name in used for name in names)


def _places(tree: ast.AST, used: AbstractSet[str]) -> Iterator[ast.expr]:
    """Expressions that a verdict may stand on."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef) and UNSEEN.search(node.name):
            continue
        if _is_unused(node, used):
            continue
        if isinstance(node, NO_EFFECT):
            continue
        if isinstance(node, ast.ClassDef):
            yield from _places(ast.Module(node.body, []), used)
            continue
        if isinstance(node, ast.keyword) and node.arg in ("note", "drawing", "tables", "says", "references", "strict"):
            continue
        if isinstance(node, ast.Call):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if name == "says":  # Measured(...).says(words): the numbers are on the left, n and interval are keywords
                yield from _places(node.func, used)
                for keyword in node.keywords:
                    yield from _places(keyword, used)
                continue
            if name in UNSEEN_CALLS or UNSEEN.search(name):
                continue
        if isinstance(node, ast.AnnAssign):
            if node.value is not None:
                yield from _places(ast.Expr(node.value), used)
            continue
        if isinstance(node, ast.FunctionDef):
            for part in node.body:
                yield from _places(ast.Module([part], []), used)
            continue
        if isinstance(node, ast.expr):
            yield node
        yield from _places(node, used)


def _is_changeable(node: ast.expr) -> bool:
    if isinstance(node, ast.Constant):
        return isinstance(node.value, (bool, int, float)) or (isinstance(node.value, str) and node.value in OTHER)
    if isinstance(node, ast.Compare):
        return len(node.ops) == 1 and type(node.ops[0]) in COMPARISONS
    if isinstance(node, ast.BinOp):
        return type(node.op) in OPERATORS and not _is_text(node)
    if isinstance(node, ast.Name):
        return node.id in OTHER and (node.id.isupper() or node.id in CALLED)
    if isinstance(node, ast.Attribute):
        return node.attr in ATTRIBUTES or (node.attr in OTHER and node.attr.isupper())
    return isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub)


def _is_text(node: ast.BinOp) -> bool:
    return any(isinstance(part, ast.JoinedStr) or (isinstance(part, ast.Constant) and isinstance(part.value, str))
               for part in ast.walk(node))  # fmt: skip


def _change_in_place(node: ast.expr) -> Callable[[], None]:
    """Change a node; returns what undoes it."""
    old = copy.copy(node.__dict__)

    def undo() -> None:
        node.__dict__.clear()
        node.__dict__.update(old)

    if isinstance(node, ast.Constant):
        value = node.value
        if isinstance(value, bool):
            node.value = not value
        elif isinstance(value, int):
            node.value = value + 1
        elif isinstance(value, float):
            node.value = float(f"{1.3 * value:.12g}") if value else 1.0
        else:
            node.value = THRESHOLDS[str(value)] if node.kind == THRESHOLD else OTHER[str(value)]
    elif isinstance(node, ast.Compare):
        node.ops = [COMPARISONS[type(node.ops[0])]()]
    elif isinstance(node, ast.BinOp):
        node.op = OPERATORS[type(node.op)]()
    elif isinstance(node, ast.Name):
        node.id = OTHER[node.id]
    elif isinstance(node, ast.Attribute):
        node.attr = OTHER[node.attr]
    elif isinstance(node, ast.UnaryOp):
        node.op = ast.UAdd()
    return undo


class Copy:
    """A copy of the project in a folder, of which one module at a time is changed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        shutil.copytree(ROOT / "backend", folder / "backend", symlinks=True)
        shutil.copytree(ROOT / "tests", folder / "tests", symlinks=True)
        for name in ("models", "scripts", "docs", "frontend", "pyproject.toml", "shared"):
            if (ROOT / name).exists():
                (folder / name).symlink_to(ROOT / name)

    def __enter__(self) -> Self:
        """Start the process that runs tests on the copy."""
        path = os.pathsep.join(str(self.folder / name) for name in ("backend", "tests", "scripts"))
        command = [sys.executable, "-m", "support.mutant_judge"]
        environment = os.environ | {"PYTHONPATH": path}
        self._judge = subprocess.Popen(
            command, cwd=self.folder, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        return self

    def __exit__(self, *_error: object) -> None:
        """End that process."""
        self._judge.communicate()

    def notices(self, mutant: Mutant, tests: Sequence[str], limit_s: float) -> str:
        """The first test that fails with the change, "too slow", or an empty text."""
        file = self.folder / PACKAGE / mutant.file
        original, times = file.read_bytes(), file.stat()
        file.write_text(mutant.source, encoding="utf-8")
        try:
            return self.first_failure(tests, limit_s)
        finally:
            file.write_bytes(original)
            os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))  # its compiled form is valid again

    def first_failure(self, tests: Sequence[str], limit_s: float, **files: str) -> str:
        """The first test that fails with the code as it is in the copy, "too slow", or an empty text."""
        assert self._judge.stdin is not None
        assert self._judge.stdout is not None
        print(json.dumps({"tests": tests, "limit_s": limit_s, **files}), file=self._judge.stdin, flush=True)
        return str(json.loads(self._judge.stdout.readline()))

    def executed_tests(self, results: Path | None, lines: Path | None) -> ExecutedTests:
        """Run all tests on the code as it is: which lines each of them executes.

        ``results`` is a file of results of slow functions outside of the reproduction that runs have in common,
        ``lines`` that of the lines, which is only written if it does not exist. Tests that fail run once more: what
        fails twice is not used, and named.
        """
        results = results or self.folder / "results.pickle"
        lines = lines or self.folder / "lines.json"
        tests = [*TESTS, *(f"--deselect={test}" for test in SLOW_TESTS)]
        files = {"results": str(results.resolve()), "lines": str(lines.resolve())}
        if lines.exists():
            self.first_failure([RECORDED + "[fig-2.5]"], UNCHANGED_LIMIT_S, results=files["results"])
            return ExecutedTests(self.folder / PACKAGE, json.loads(lines.read_text(encoding="utf-8")))
        for _ in range(1 if results.exists() else 2):  # also with stored results: tests are in the order of that time
            start_s = time.monotonic()
            self.first_failure(tests, UNCHANGED_LIMIT_S, **files)
            print(f"Without a change: {time.monotonic() - start_s:.0f} s", flush=True)
        executed: dict[str, dict[str, Any]] = json.loads(lines.read_text(encoding="utf-8"))
        if failed := _failed_tests(executed):
            again = self.folder / "again.json"
            self.first_failure(failed, UNCHANGED_LIMIT_S, lines=str(again))
            executed |= json.loads(again.read_text(encoding="utf-8"))
        for test in _failed_tests(executed):
            print(f"Fails twice without a change, and is not used: {test}", flush=True)
            del executed[test]
        lines.write_text(json.dumps(executed), encoding="utf-8")
        return ExecutedTests(self.folder / PACKAGE, executed)


def _failed_tests(executed: Mapping[str, Mapping[str, Any]]) -> list[str]:
    return [test for test, of in executed.items() if of["failed"]]


def _imported_names() -> set[str]:
    """Names that modules of the package import from others."""
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in (ROOT / PACKAGE).rglob("*.py")]
    return {
        alias.name for tree in trees for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }  # fmt: skip


def main() -> None:
    """Try a sample of mutants and print the share that is noticed."""
    parser = argparse.ArgumentParser(prog="scripts/mutants verdicts", description=__doc__)
    parser.add_argument("--sample", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--log", type=Path, default=Path("mutants-of-verdicts.jsonl"))
    parser.add_argument("--limit", type=float, default=LIMIT_S, help="seconds of tests for each")
    parser.add_argument(
        "--part", default="1/1", help="2/3: the second of three parts of the sample, with a log of its own"
    )
    parser.add_argument("--first", type=int, default=0, help="leave out so many at the beginning of the sample")
    parser.add_argument("--results", type=Path, help="file with results of slow functions that runs have in common")
    parser.add_argument("--lines", type=Path, help="file with the lines of each test, while no test changes")
    parser.add_argument("--list", action="store_true", help="print the sample and try none")
    arguments = parser.parse_args()
    files = sorted(
        path.relative_to(ROOT / PACKAGE).as_posix()
        for name in MODULES
        for path in ([ROOT / PACKAGE / name] if name.endswith(".py") else (ROOT / PACKAGE / name).glob("*.py"))
    )
    imported = _imported_names()
    every = [mutant for file in files for mutant in mutants_of(ROOT / PACKAGE / file, file, imported)]
    sample = random.Random(arguments.seed).sample(every, min(arguments.sample, len(every)))
    part, parts = map(int, arguments.part.split("/"))
    sample = sample[part - 1 :: parts]
    print(f"{len(every)} mutants, {len(sample)} drawn with seed {arguments.seed}", flush=True)
    if arguments.list:
        print("\n".join(mutant.name for mutant in sample))
        return
    lines = arguments.log.read_text(encoding="utf-8").splitlines() if arguments.log.exists() else []
    tried = {(line["name"], line["place"]): line["by"] for line in map(json.loads, lines)}
    with (
        tempfile.TemporaryDirectory(prefix="stridelab-mutants-") as place,
        arguments.log.open("a") as log,
        Copy(Path(place)) as copied,
    ):
        executed = copied.executed_tests(arguments.results, arguments.lines)
        for k, mutant in enumerate(sample):
            if k < arguments.first or (mutant.name, k) in tried:
                continue
            start_s = time.monotonic()
            by = copied.notices(mutant, executed.tests_of(mutant.file, mutant.line), arguments.limit)
            tried[mutant.name, k] = by
            log.write(json.dumps({"name": mutant.name, "place": k, "by": by}) + "\n")
            log.flush()
            print(f"{by or 'NOT NOTICED'} {time.monotonic() - start_s:.0f} s: {mutant.name}", flush=True)
    noticed = sum(by not in ("", "too slow") for by in tried.values())
    print(f"{noticed} of {len(tried)} noticed")


if __name__ == "__main__":
    main()
