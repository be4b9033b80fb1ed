"""The pages on a fake interface, called without a network."""

from collections.abc import Callable

import httpx
import pytest

from support.fakes.service import FakeService
from support.fakes.web_app import make_client


@pytest.fixture
def fake() -> FakeService:
    return FakeService()


@pytest.fixture
def browse(fake: FakeService) -> Callable[[str], httpx.Response]:
    """GET a page."""
    return make_client(fake).get
