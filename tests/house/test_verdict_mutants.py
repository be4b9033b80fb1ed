"""What the mutants of verdicts stand on: records of numbers on the way, tests by the lines they run, stored results."""

from math import cos, log
from pathlib import Path

import numpy as np
import pytest

from stridelab.reproduction.common import estimator_errors, intervals
from support.mutant_tests import ExecutedTests
from support.recorded_steps import recorded_steps, step_differences
from support.result_memo import _key_of, _memoised

MODULE = """
LIMIT = 0.5
TWICE = 2.0 * LIMIT


def one(x):
    return (
        x
        < LIMIT
    )


def two(x):
    if x > TWICE:
        return 1.0
    return x
"""


def test_a_sign_a_size_and_a_call_more_differ_from_the_record() -> None:
    def steps_of(*values: float, calls: int = 1) -> dict[str, dict[str, list[float]]]:
        with recorded_steps() as steps:
            for _ in range(calls):
                estimator_errors.as_columns([{"a": value} for value in values])
        return steps

    record = steps_of(1.0, -2.0)
    weighted = (1.5 * log(1.0 + 1.0 / 1e-4) - (1.0 + 0.5 * cos(1.0)) * log(1.0 + 2.0 / 1e-4)) / 2
    assert record["common.estimator_errors.as_columns"]["returned"] == [
        1,
        2,
        -0.5,
        1.5,
        pytest.approx(weighted, rel=1e-5),
    ]
    assert not step_differences(steps_of(1.0, -2.001), record, 2e-3)
    for changed in (steps_of(1.0, 2.0), steps_of(1.0, -2.1), steps_of(1.0, -2.0, calls=2), steps_of(1.0), {}):
        assert step_differences(changed, record, 2e-3)


def test_calls_inside_of_a_function_are_recorded_and_undone() -> None:
    before = intervals.resampled_interval
    with recorded_steps() as steps:
        intervals.interval_of([1.0, 2.0, 4.0])
        assert intervals.resampled_interval is not before
    assert intervals.resampled_interval is before
    assert {"common.intervals.interval_of", "common.intervals.resampled_interval"} <= steps.keys()


def test_tests_are_those_that_run_the_statement_or_read_its_name(tmp_path: Path) -> None:
    (tmp_path / "module.py").write_text(MODULE)
    executed = {
        "a": {"seconds": 3.0, "lines": [["module.py", 7]]},
        "b": {"seconds": 1.0, "lines": [["module.py", 14], ["module.py", 16]]},
        "c": {"seconds": 2.0, "lines": [["module.py", 14], ["module.py", 15]]},
    }
    tests = ExecutedTests(tmp_path, executed)
    assert tests.tests_of("module.py", 9) == ["a"], "a statement over several lines"
    assert tests.tests_of("module.py", 14) == ["b", "c"], "the shortest in front"
    assert tests.tests_of("module.py", 15) == ["c"]
    assert tests.tests_of("module.py", 3) == ["b", "c"]
    assert tests.tests_of("module.py", 2) == ["b", "c", "a"], "read by way of another constant"


@pytest.mark.parametrize(
    ("source", "is_tried"),
    [
        ("from package import module\n\nassert module.LIMIT == 0.5\n", True),
        ("from package import module as other\n\nassert other.LIMIT == 0.5\n", True),
        ("from package.module import LIMIT\n", True),
        ("from package import module\n\nassert module.one(1.0)\n", False),
        ("from package.another import LIMIT\n", False),
    ],
)
def test_tests_that_name_a_constant_of_the_module_are_tried(tmp_path: Path, source: str, is_tried: bool) -> None:
    """Also if they execute nothing: a page is compared with the size of a sample."""
    package = tmp_path / "backend" / "stridelab" / "reproduction"
    package.mkdir(parents=True)
    (package / "module.py").write_text(MODULE)
    (tmp_path / "test_page.py").write_text(source)
    executed = {
        "test_run.py::a": {"seconds": 3.0, "lines": [["module.py", 7]]},
        "test_page.py::b[0.5]": {"seconds": 1.0, "lines": []},
        "test_page.py::b[1.5]": {"seconds": 1.5, "lines": []},
    }
    tests = ExecutedTests(package, executed)
    assert tests.tests_of("module.py", 2) == [*(["test_page.py::b"] if is_tried else []), "test_run.py::a"]
    assert tests.tests_of("module.py", 9) == ["test_run.py::a"], "not for the functions"


def test_results_are_stored_by_the_content_of_arguments() -> None:
    assert _key_of("f", (np.ones(2), "x"), {}) == _key_of("f", (np.ones(2), "".join("x")), {})
    assert _key_of("f", (np.ones(2),), {}) != _key_of("f", (np.ones(3),), {})
    assert _key_of("f", (intervals.interval_of,), {}) is None, "a mutant may change it"
    assert _key_of("f", (lambda: 1,), {}) is None


def test_a_random_generator_moves_on_in_every_call() -> None:
    drawn = _memoised("drawn", lambda rng: [rng.normal() for _ in range(100_000)][-1])
    rng = np.random.default_rng(1)
    assert drawn(rng) != drawn(rng)
    assert drawn(np.random.default_rng(1)) == drawn(np.random.default_rng(1))
