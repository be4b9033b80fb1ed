"""Fixtures of tests of the reproduction: criteria are checked on both sides, and the numbers on the way to claims."""

from collections.abc import Iterator

import pytest

from support.flipped_verdicts import remembered_criteria
from support.recorded_claims import assert_steps_as_recorded
from support.recorded_steps import recorded_steps


@pytest.fixture(scope="session", autouse=True)
def criteria_of_claims() -> Iterator[None]:
    """Remember the criterion of every claim, for ``assert_flips``."""
    with remembered_criteria():
        yield


@pytest.fixture(autouse=True)
def steps_of_test(request: pytest.FixtureRequest) -> Iterator[None]:
    """Compare what a test calls of the reproduction with its record; items are recorded where they are computed."""
    has_items = request.path.name == "test_reproduction.py"
    if has_items or "stridelab.reproduction" not in request.path.read_text(encoding="utf-8"):
        yield
        return
    with recorded_steps() as steps:
        yield
    if steps:
        assert_steps_as_recorded(request.node.nodeid.removeprefix("tests/"), steps)
