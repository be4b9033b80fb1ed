"""Shapes are checked at run time in the tests; real recordings come from STRIDELAB_TEST_DATA."""

import gc
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import jaxtyping
import pytest
from hypothesis import settings

from support.type_checks import OftenEnough, checked_once

if TYPE_CHECKING:
    from stridelab.simulation.robot.walker import RobotWalk
    from support.service.database import TestDatabases

type_checks = OftenEnough(checked_once)
vars(jaxtyping)["jaxtyped"] = type_checks  # the decorator that the hook puts on every function and dataclass
jaxtyping.install_import_hook(["stridelab", "experiments"], "beartype.beartype")
os.environ.pop("COLUMNS", None)  # test workers inherit the terminal's width, which a console would use

# How long one example takes depends on what else the machine does; no test is about that.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")


def pytest_configure() -> None:
    """While files are collected hardly anything becomes garbage."""
    gc.disable()


def pytest_collection_finish() -> None:
    """What is imported and collected stays until the end: it is not searched for garbage again and again."""
    gc.freeze()
    gc.set_threshold(5_000, 10, 10)
    gc.enable()


def pytest_runtest_setup() -> None:
    """Every test has all types checked, and settings of its own environment, whatever those before it called."""
    type_checks.next_test()
    if settings_module := sys.modules.get("stridelab.service.settings"):
        settings_module.current_settings.cache_clear()


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder with the real recordings (gait/, robots/); tests that need it skip as a module where it is absent."""
    return Path(os.environ.get("STRIDELAB_TEST_DATA", Path(__file__).parents[2] / "shared")).resolve()


@pytest.fixture(scope="session")
def gait(data_dir: Path) -> Path:
    """Folder of the real walks; tests on them are skipped where it is absent."""
    folder = data_dir / "gait"
    if not folder.is_dir():
        pytest.skip("real recordings are not on this machine (STRIDELAB_TEST_DATA)")
    return folder


@pytest.fixture(scope="session")
def postgres() -> "Iterator[TestDatabases]":
    """One PostgreSQL for all tests that need one."""
    from support.service.database import databases

    with databases() as made:
        yield made


@pytest.fixture(scope="session")
def service_url() -> Iterator[str]:
    """A whole service as ``make serve`` starts it, its own pages and samples and nothing else in it at first."""
    from support.service.processes import SERVE, running_service

    patient = {"STRIDELAB_PARSE_TIMEOUT_S": "60", "STRIDELAB_STALL_S": "60"}  # the machine does other things as well
    with running_service(*SERVE, STRIDELAB_MIN_FREE_DISK_MB="0", **patient) as service:
        yield f"http://127.0.0.1:{service.port}"


@pytest.fixture
def database_url(postgres: "TestDatabases") -> Iterator[str]:
    """A migrated database of this test's own."""
    with postgres.fresh() as url:
        yield url


@pytest.fixture(scope="session")
def robot_walk() -> "RobotWalk":
    """TALOS at its own cadence: rest, walk, rest."""
    from stridelab.reproduction.studies.estimator_study import clean_motion

    return clean_motion("robot")
