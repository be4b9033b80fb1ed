"""The criteria of claims in the tests below are checked on both sides of their bounds."""

from collections.abc import Iterator

import pytest

from support.flipped_verdicts import remembered_criteria


@pytest.fixture(scope="session", autouse=True)
def _criteria() -> Iterator[None]:
    with remembered_criteria():
        yield
