"""One robot and one cloud of its postures for all tests of this folder."""

from collections.abc import Iterator

import pytest
from threadpoolctl import threadpool_limits

from stridelab.reachability.learning.com_sampling import ComCloud, sample_com
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot


@pytest.fixture(scope="session", autouse=True)
def one_thread() -> Iterator[None]:
    """The arrays are small: more threads mostly wait for each other."""
    with threadpool_limits(1):
        yield


@pytest.fixture(scope="session")
def talos() -> Robot:
    return load_robot("talos")


@pytest.fixture(scope="session")
def fresh(talos: Robot) -> ComCloud:
    """2000 postures that no bundled number was learned from."""
    return sample_com(talos, tuple(talos.effectors), 2000, seed=20_240_517)
