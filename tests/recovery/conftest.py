"""Recovery tests start real processes and kill them; all are marked, and one service serves most of them."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from support.service.processes import Service, running_service


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.recovery)
            item.add_marker(pytest.mark.timeout(1200))  # their own limits grow with the load of the machine


@pytest.fixture(scope="module")
def service() -> Iterator[Service]:
    with running_service() as made:
        yield made
