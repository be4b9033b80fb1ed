"""One planned walk for all tests that read its files."""

import pytest

from support.robots.plans import Planned, run, short_walk


@pytest.fixture(scope="session")
def walked(tmp_path_factory: pytest.TempPathFactory) -> Planned:
    return run(tmp_path_factory.mktemp("walk"), short_walk(), whole_body=True, replay=True)
