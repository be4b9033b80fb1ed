"""Walks that several tests look at; simulating one takes about two seconds."""

import pytest

from stridelab.reproduction.studies.estimator_study import clean_motion
from stridelab.simulation.human.walker import HumanWalker, Walk
from stridelab.simulation.robot.walker import RobotWalk


@pytest.fixture(scope="session")
def steady_walk() -> Walk:
    """A woman who is already walking."""
    return HumanWalker(seed=1).walk()


@pytest.fixture(scope="session")
def man_from_rest() -> Walk:
    """A man: rest, walk, rest."""
    walker = HumanWalker(height_m=1.82, mass_kg=81.0, sex="male", speed_m_s=1.0, duration_s=8.0, seed=4, from_rest=True)
    return walker.walk()


@pytest.fixture(scope="session")
def quiet_standing() -> Walk:
    return HumanWalker(speed_m_s=0.0, duration_s=12.0, seed=2).walk()


@pytest.fixture(scope="session")
def brisk_walk() -> RobotWalk:
    """TALOS at a person's cadence."""
    return clean_motion("human")


@pytest.fixture(scope="session")
def robot_run() -> RobotWalk:
    """TALOS running."""
    return clean_motion("running")
