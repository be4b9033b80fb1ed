"""Fixtures of tests of the reproduction: criteria are checked on both sides, and the numbers on the way to claims.

What slow functions outside of the reproduction return is computed once for all of its tests (``result_memo``).
"""

from collections.abc import Iterator

import pytest

from support.flipped_verdicts import remembered_criteria
from support.recorded_claims import assert_steps_as_recorded
from support.recorded_steps import recorded_steps
from support.result_memo import share_in_tests, sharing

share_in_tests()


class RisingProgress:
    """Progress of a computation, which never falls and does not exceed 1."""

    def __init__(self) -> None:
        self.share = 0.0

    def __call__(self, share: float, _message: str) -> None:
        """Raises ``AssertionError`` if less is done than before."""
        assert self.share <= share <= 1.0, f"{share} after {self.share}"
        self.share = share


@pytest.fixture(scope="session", autouse=True)
def criteria_of_claims() -> Iterator[None]:
    """Remember the criterion of every claim, for ``assert_flips``."""
    with remembered_criteria():
        yield


@pytest.fixture(scope="module", autouse=True)
def shared_results() -> Iterator[None]:
    """Estimates, fits and plans of the same arguments are computed once."""
    with sharing():
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
