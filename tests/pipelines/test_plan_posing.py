"""From a scenario to a problem: what is missing is named before any solver."""

from pathlib import Path
from typing import Any

import pytest

from stridelab.errors import InvalidInput
from stridelab.pipelines import plan_centroidal, plan_problem
from stridelab.reachability.store import load_proxies
from stridelab.service.kinds.plan_motion import run as plan_motion
from support.command_line import quiet
from support.robots.plans import plan_task


def test_densities_that_lack_an_effector_are_named_before_any_solver(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def lacking(robot_name: str, measure: str) -> Any:
        return {name: proxy for name, proxy in load_proxies(robot_name, measure).items() if name != "right_foot"}

    monkeypatch.setattr(plan_problem, "load_proxies", lacking)
    monkeypatch.setattr(plan_centroidal, "solve", lambda *_args, **_options: pytest.fail("a solver was asked"))
    with pytest.raises(InvalidInput) as refusal:
        plan_motion.run(plan_task(whole_body=False), tmp_path, quiet)
    assert refusal.value.code == "proxy-missing"
    assert [fault.where for fault in refusal.value.faults] == ["right_foot", "stage: centroidal"]
    assert list(tmp_path.iterdir()) == []
