"""Claims of the tests below are asked what their verdicts on other numbers would be."""

from collections.abc import Iterator

import pytest

from support.flipped_verdicts import remembered_criteria


@pytest.fixture(scope="session", autouse=True)
def _criteria() -> Iterator[None]:
    with remembered_criteria():
        yield
