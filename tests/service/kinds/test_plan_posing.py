"""From a scenario to a problem: what is missing is named before any solver."""

from pathlib import Path
from typing import Any

import pytest

from stridelab.errors import InvalidInput
from stridelab.reachability.store import load_proxies
from stridelab.service.jobs.kinds import plan_centroidal, plan_motion, plan_posing
from support.planning import plan_task
from support.quiet import quiet


def test_densities_that_lack_an_effector_are_named_before_any_solver(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def lacking(robot_name: str, measure: str) -> Any:
        return {name: proxy for name, proxy in load_proxies(robot_name, measure).items() if name != "right_foot"}

    monkeypatch.setattr(plan_posing, "load_proxies", lacking)
    monkeypatch.setattr(plan_centroidal, "solve", lambda *_args, **_options: pytest.fail("a solver was asked"))
    with pytest.raises(InvalidInput) as refusal:
        plan_motion.run(plan_task(whole_body=False), tmp_path, quiet)
    assert refusal.value.code == "proxy-missing"
    assert [fault.where for fault in refusal.value.faults] == ["right_foot", "stage: centroidal"]
    assert list(tmp_path.iterdir()) == []
