"""The grid of rails and stairs: its cases can be planned, and a result says what became of them."""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from experiments.climbing_grid import (
    FAST,
    FLIGHTS,
    RAILS,
    Case,
    CaseResult,
    Flight,
    GridReport,
    Proxies,
    climbing_cases,
    run_case,
    run_grid,
    stairs_case,
)
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenarios.stairs import flat_walk
from stridelab.contacts.validation.validate import validate_scenario
from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.schemas.scenarios import Scenario
from stridelab.wholebody.certificate.certificate import Check

WAIT_S = 60.0
ONE_STAIR = stairs_case(Flight(0.10, 0.30, FAST), number=1)


class Deadly(dict[str, Any]):
    """Ends the process that looks into it."""

    def get(self, *_: object) -> Any:
        os._exit(3)


class Unreadable(dict[str, Any]):
    """Raises an error that is none of ours where it is looked into."""

    def get(self, *_: object) -> Any:
        return int("no number")


@pytest.fixture(scope="module")
def talos() -> Robot:
    return load_robot("talos")


def feet_at(height_m: float, sd_m: float) -> Proxies:
    """One normal density for both feet: the CoM so high above each, between them."""
    covariance = np.diag([0.2, 0.15, sd_m])[None] ** 2
    return {
        name: Proxy(Mixture(np.ones(1), np.array([[0.0, side * 0.09, height_m]]), covariance))
        for name, side in (("left_foot", -1), ("right_foot", 1))
    }


def test_there_are_enough_rails_and_stairs_and_no_two_are_the_same() -> None:
    cases = climbing_cases()
    assert len({case.name for case in cases}) == len(cases)
    assert len(RAILS) >= 8
    assert len(FLIGHTS) >= 12
    for varied in ("height_m", "depth_m", "timing", "footing"):
        assert len({getattr(flight, varied) for flight in FLIGHTS}) >= 2


@pytest.mark.parametrize("case", climbing_cases(), ids=lambda case: case.name)
def test_every_case_passes_the_judge(case: Case) -> None:
    report = validate_scenario(Scenario.model_validate(case.scenario).model_dump(mode="json"), effector_shapes("talos"))
    assert report.faults == ()
    assert "swing-obstructed" not in {remark.code for remark in report.remarks}


def test_one_stair_is_climbed_in_a_process_of_its_own(talos: Robot) -> None:
    heard: list[CaseResult] = []
    (result,) = run_grid(talos, feet_at(0.8, 0.1), [ONE_STAIR], processes=1, tell=heard.append)
    assert result.succeeded
    assert result.reason == ""
    assert heard == [result]
    assert result.replayed
    assert result.replay_error_m is not None
    assert result.replay_error_m < 0.03
    low_m, high_m = result.com_height_m or (0.0, 0.0)
    assert 0.75 < low_m < high_m < 0.95
    outcome = result.check_named("com_error_max")
    assert outcome is not None
    assert outcome.passed
    # the processes compute what this one does, to the rounding of two address spaces
    again = run_case(talos, feet_at(0.8, 0.1), ONE_STAIR)
    assert [check.name for check in again.checks] == [check.name for check in result.checks]
    for here, there in zip(again.checks, result.checks, strict=True):
        assert here.value == pytest.approx(there.value, rel=1e-6, abs=1e-9), here.name
    assert again.replay_error_m == pytest.approx(result.replay_error_m, rel=1e-4)
    bare = {"cpu_s": 0.0, "checks": (), "replay_error_m": None, "com_height_m": None}
    assert replace(again, **bare) == replace(result, **bare)


def test_densities_far_above_the_knees_fail_where_the_body_cannot_follow(talos: Robot) -> None:
    result = run_case(talos, feet_at(1.05, 0.01), ONE_STAIR)
    assert result.stage in {"whole body", "certificate"}
    assert result.reason
    assert result.com_height_m is not None
    assert result.com_height_m[1] > 0.95


def test_a_scenario_that_the_judge_refuses_fails_as_one(talos: Robot) -> None:
    nowhere = flat_walk(2)
    nowhere["phases"][0]["contacts"][0]["position_m"][2] = 0.5
    result = run_case(talos, feet_at(0.8, 0.1), Case("in the air", "stairs", nowhere))
    assert result.stage == "scenario"
    assert "phases[0]" in result.reason
    assert result.checks == ()
    assert result.replayed is None


def test_what_crashes_is_recorded_and_takes_nothing_else_along(talos: Robot) -> None:
    deadly = Case("deadly", "rail", Deadly())
    foreign = Case("foreign", "rail", Unreadable())
    refused = replace(ONE_STAIR, name="refused", scenario={**ONE_STAIR.scenario, "friction": -1.0})
    results = run_grid(talos, feet_at(0.8, 0.1), [deadly, refused, foreign], processes=2)
    assert [result.case for result in results] == ["deadly", "refused", "foreign"]
    assert [result.stage for result in results] == ["crash", "scenario", "crash"]
    assert "exit code 3" in results[0].reason
    assert "exit code 1" in results[2].reason


def test_processes_end_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    root = Path(__file__).parents[2]
    folders = [str(root / "tests"), str(root / "scripts")]
    environment = {**os.environ, "NOTED": str(tmp_path), "PYTHONPATH": os.pathsep.join(folders)}
    parent = subprocess.Popen([sys.executable, "-m", "support.parallel_work", "grid"], env=environment)
    try:
        assert until(lambda: any(tmp_path.iterdir()))
        (child,) = (int(path.name) for path in tmp_path.iterdir())
        assert psutil.pid_exists(child)
    finally:
        parent.kill()
        parent.wait()
    assert until(lambda: not psutil.pid_exists(child))


def until(true: Callable[[], bool]) -> bool:
    end = time.monotonic() + WAIT_S
    while not true() and time.monotonic() < end:
        time.sleep(0.05)
    return true()


def test_a_report_counts_by_kind_and_stage() -> None:
    check_ = Check("com_error_max", 1.0, "m", 0.5)
    results = (
        CaseResult("a", "rail", None, replayed=True),
        CaseResult("b", "rail", "plan", "did not converge"),
        CaseResult("c", "stairs", "certificate", "far off", checks=(check_,), replayed=True),
        CaseResult("d", "stairs", "certificate", "far off", replayed=False),
        CaseResult("e", "stairs", None, replayed=False),
    )
    report = GridReport("some", results)
    assert (report.n_successes, report.n_replayed) == (2, 2)
    assert (report.of_kind("rail").n_successes, report.of_kind("stairs").n_successes) == (1, 1)
    assert report.of_kind("rail").label == "some"
    assert report.failures_by_stage == {"plan": 1, "certificate": 2}
    assert results[2].check_named("com_error_max") == check_
    assert results[2].check_named("another") is None
