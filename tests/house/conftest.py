"""Tests of the house share the syntax trees of the product: each file is parsed once."""

from collections.abc import Iterator

import pytest

from support.docs.book import syntax_tree


@pytest.fixture(scope="package", autouse=True)
def release_syntax_trees() -> Iterator[None]:
    """The trees take 190 MB, which no test of another folder needs."""
    yield
    syntax_tree.cache_clear()
